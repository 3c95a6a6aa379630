"""Taking a participant out of a study, everywhere.

What is ours is cleaned where it stands: tables, files of records, copies of the database, journal,
database. What was made of a person's answers, such as a report, is deleted, and it is said how it
is made again; of a comparison that names nobody that is said, and it stays. Then the whole folder
is searched for all that the person is called, and what is still left is named, for the researcher
to clean by hand.
"""

import os
import time
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pourcast.errors import InputError, StoreError
from pourcast.experiment.data.file_search import LEFT_OUT, Findings, search_folder
from pourcast.experiment.data.person import Person, names_in_lines, person_called
from pourcast.experiment.data.removal import remove_from_file
from pourcast.experiment.design.links import codes_of
from pourcast.experiment.storage.database import database_files
from pourcast.experiment.storage.journal import Journal, journal_words
from pourcast.experiment.storage.storage import Storage
from pourcast.files import is_temporary
from pourcast.study.folder import DATABASE

_BEING_WRITTEN = 60.0
"""A temporary file that is younger may be another command's, which writes it now [s]."""

_AGREEMENT = "agreement.csv"
"""What is in a folder of tables that `compare -o` or `report` wrote."""


@dataclass
class Withdrawal:
    """What became of a withdrawal.

    Parameters
    ----------
    person
        Who withdrew.
    deleted
        What was deleted, a line each.
    left
        What still has something of the person and must be cleaned by hand, a line each.
    notes
        What else the researcher should know, a line each.
    """

    person: Person
    deleted: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def withdraw(
    study: Path,
    storage: Storage | None,
    journal: Journal,
    who: str,
    *,
    tables: Collection[str] = (),
) -> Withdrawal:
    """Delete a participant everywhere in a study folder, and in its database.

    It can be interrupted and begun again: the database, which tells who they are, comes last; and
    what is left in files is found even if the database has nothing of them any more. A server may
    run.

    Parameters
    ----------
    study
        The study folder.
    storage, journal
        Its data; no storage if the database was lost.
    who
        Code of the participant or of the session, or the platform's id.
    tables
        Names of the tables that a comparison is written to.

    Raises
    ------
    InputError
        If nothing is known of such a participant, and no file names them.
    StoreError
        If journal or database can't be changed.
    """
    person = find_person(storage, journal, who)
    done = Withdrawal(person)
    findings = _search(study, storage, person)
    named = person.distinctive or any(one in person.codes for one in _words(findings))
    if not person.sessions and not (findings.found and named):
        raise InputError(
            f"withdraw: there is no participant {who!r}; neither the database nor any file of "
            f"{study} has anything of them"
        )
    live = _live_files(study, storage, journal)
    others = [path for path in findings.found if path.resolve() not in live]
    _delete_derived(study, others, tables, done)
    _note_numbers(study, done)
    for path in others:
        _clean_file(study, path, person, done)
    _clean_stores(storage, journal, done)
    _look_again(study, storage, journal, done)
    return done


def find_person(storage: Storage | None, journal: Journal, who: str) -> Person:
    """Who is called so, as far as database and journal tell.

    Raises
    ------
    InputError
        If it is no name.
    StoreError
        If database or journal can't be read.
    """
    if not who.strip():
        raise InputError("withdraw: expected a participant's code or id, found nothing")
    lines = list(journal.lines())
    words = journal_words(journal.path)
    secret = bytes.fromhex(words.get("secret", "")) if storage is None else storage.secret
    if storage is not None:
        lines += [dict(line) for line in storage.journal_lines()]
    return person_called(who, names_in_lines(lines), codes_of(who, secret) if secret else ())


def _search(study: Path, storage: Storage | None, person: Person) -> Findings:
    if storage is not None:
        storage.close()  # SQLite's files are read; it opens them again when it is asked
    return search_folder(study, person.needles())


def _live_files(study: Path, storage: Storage | None, journal: Journal) -> set[Path]:
    """Files that are cleaned by who keeps them: the database's and the journal."""
    database = study / DATABASE
    if storage is not None and storage.url.get_backend_name() == "sqlite":
        database = Path(str(storage.url.database))
    return {path.resolve() for path in (*database_files(database), journal.path)}


def _clean_file(study: Path, path: Path, person: Person, done: Withdrawal) -> None:
    """Take a person out of a file of ours; a temporary one left behind goes as a whole."""
    name = _shown(path, study)
    try:
        if is_temporary(path):
            if time.time() - path.stat().st_mtime > _BEING_WRITTEN:
                path.unlink()
                done.deleted.append(f"{name}: a temporary file that was left behind")
            return
        removed = remove_from_file(path, person)
    except FileNotFoundError:
        return
    except (OSError, InputError, ValueError) as error:
        done.notes.append(f"{name}: could not be cleaned ({error})")
        return
    if removed:
        done.deleted.append(f"{name}: {removed}")


def _delete_derived(
    study: Path, found: Sequence[Path], tables: Collection[str], done: Withdrawal
) -> None:
    """Delete reports and tables of comparisons that were made with the person's answers."""
    derived = {one for path in found if (one := _derived(path, study)) is not None}
    for folder in sorted(derived):
        page = folder / "report.html"
        is_report = page.is_file()
        files = [page] if is_report else [folder / f"{name}.csv" for name in tables]
        if is_report:
            files += [*(folder / "tables").glob("*.csv"), *(folder / "figures").glob("*.svg")]
            files += (folder / "figures").glob("*.png")
        files = [file for file in files if file.is_file()]
        for file in files:
            file.unlink()
        done.deleted.append(
            f"{_shown(folder, study)}: {len(files)} files, made with this person's answers; "
            f"{_made_again(folder, study)} makes them again without"
        )


def _note_numbers(study: Path, done: Withdrawal) -> None:
    """Tell of reports and comparisons that name nobody: their numbers may be of the person, too."""
    for path in sorted(study.rglob(_AGREEMENT)):
        folder = _derived(path, study)
        if folder is not None:
            done.notes.append(
                f"{_shown(folder, study)}: its numbers may be made with this person's answers; "
                f"{_made_again(folder, study)} makes them again without"
            )


def _made_again(folder: Path, study: Path) -> str:
    """The command that writes a report or a comparison anew."""
    command = "report" if (folder / "tables").is_dir() else "compare"
    output = "" if folder == study / "report" else f" -o {folder}"
    return f"`pourcast {command} {study}{output}`"


def _derived(path: Path, study: Path) -> Path | None:
    """The folder of the report or comparison that a file belongs to, inside the study."""
    for folder in path.parents:
        if folder == study:
            return None
        if (folder / "report.html").is_file() and (folder / "tables" / _AGREEMENT).is_file():
            return folder
        if (folder / _AGREEMENT).is_file() and not (folder.parent / "report.html").is_file():
            return folder
    return None


def _clean_stores(storage: Storage | None, journal: Journal, done: Withdrawal) -> None:
    """Clean journal and database; the database last, as it tells who they are."""
    person = done.person
    lines = _remove_from_journal(journal, person)
    if storage is not None:
        numbers = {one.number for one in storage.sessions() if one.key in person.keys}
        rows = storage.delete(numbers) if numbers else {}
        # A server that saved something in the meantime appended it; from now on it can't.
        lines += _remove_from_journal(journal, person)
        done.deleted += [
            f"database: {count} rows of {table}" for table, count in rows.items() if count
        ]
        try:
            storage.write_anew()
        except StoreError as error:
            done.left.append(str(error))
        if storage.url.get_backend_name() == "postgresql":
            done.notes.append(
                "PostgreSQL's own write-ahead log, its replicas and its backups are its server's: "
                "they have the rows until they are recycled"
            )
    done.deleted.insert(0, f"{journal.path.name}: {lines} lines")


def _remove_from_journal(journal: Journal, person: Person) -> int:
    return journal.remove(person.keys, person.distinctive | person.participants)


def _look_again(study: Path, storage: Storage | None, journal: Journal, done: Withdrawal) -> None:
    """Search the whole folder once more, and name what is left."""
    findings = _search(study, storage, done.person)
    if journal.path in findings.found:
        _remove_from_journal(journal, done.person)
        findings = _search(study, storage, done.person)
    for path, labels in findings.found.items():
        why = "; it is being written: say this again in a minute" if is_temporary(path) else ""
        done.left.append(f"{_shown(path, study)}: has {_listed(labels)}{why}")
    done.left += [f"{_shown(p, study)}: {why}" for p, why in findings.unread.items()]
    done.notes += _search_notes(study, findings)


def _words(findings: Findings) -> set[str]:
    """The last words of what was found: of codes, the codes themselves."""
    return {label.rpartition(" ")[2] for labels in findings.found.values() for label in labels}


def _search_notes(study: Path, findings: Findings) -> list[str]:
    notes = [f"looked through {findings.searched} files of {study}"]
    if findings.left_out:
        notes[0] += f"; not through {findings.left_out} ({LEFT_OUT})"
    if findings.shown:
        names = [_shown(path, study) for path in findings.shown]
        notes.append(f"what pictures, films and PDFs show was not looked at: {_listed(names, 10)}")
    return notes


def _shown(path: Path, study: Path) -> str:
    """A path inside the study as it can be printed, whatever its name is written in."""
    return os.fsencode(path.relative_to(study)).decode("utf-8", "replace")


def _listed(names: Iterable[str], most: int = 5) -> str:
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
