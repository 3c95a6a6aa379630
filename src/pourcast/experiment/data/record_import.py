"""Records from files: those that a participant downloaded, or that JATOS or DataPipe kept."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pourcast.errors import InputError, one_line
from pourcast.experiment.design.links import marked, visitor
from pourcast.experiment.design.steps import Schedule, Step
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_bodies import canonical
from pourcast.experiment.storage.records import Record
from pourcast.experiment.storage.sessions import Arrival, Session
from pourcast.experiment.storage.storage import Storage

FORMAT = "pourcast-records"


class _Opening(BaseModel):
    """First line of a session in a file."""

    model_config = ConfigDict(extra="ignore")

    format: str
    session: str = Field(min_length=8, max_length=100)
    entry: str = Field(default="static", max_length=20)
    identifiers: dict[str, str] = Field(default_factory=dict, max_length=20)
    group: int | None = Field(default=None, ge=0)
    place: int | None = Field(default=None, ge=0)


class _Line(BaseModel):
    """A record in a file."""

    model_config = ConfigDict(extra="ignore")

    session: str
    seq: int = Field(ge=0)
    body: dict[str, Any]


@dataclass(frozen=True)
class ImportSummary:
    """What was read from a file: sessions, and what became of its records."""

    sessions: int
    new: int
    repeated: int
    conflicts: int


def import_records(
    path: Path,
    storage: Storage,
    journal: Journal,
    schedule: Schedule,
    now: float,
) -> ImportSummary:
    """Take in a file of records: one that a participant downloaded, or that JATOS or DataPipe kept.

    Parameters
    ----------
    path
        JSON Lines: a line that opens each session, and a line each record.
    storage, journal
        Where they go.
    schedule
        From group and place to a session's steps, of sessions that the database does not know.
    now
        Seconds since 1970.

    Raises
    ------
    InputError
        One line that names the file, the line and what was expected. Nothing of the
        file is taken in then.
    """
    sources: dict[str, _Source] = {}
    checked: list[tuple[str, int, str, str]] = []
    for number, content in _json_lines(path):
        where = f"{path}: line {number}"
        try:
            if "format" in content:
                opening = _Opening.model_validate(content)
                sources[opening.session] = _source(opening, storage, schedule, where)
            else:
                checked.append(_checked(_Line.model_validate(content), sources, where))
        except ValidationError as error:
            raise InputError(f"{where}: {one_line(error)}") from None
    sessions = {
        name: source.known or _opened(source, storage, now) for name, source in sources.items()
    }
    records = [
        Record(sessions[name].number, seq, kind, body, now) for name, seq, kind, body in checked
    ]
    results = storage.save(records) if records else []
    for session in sessions.values():
        if len(storage.saved_steps(session.number)) == len(session.steps):
            storage.end(session.number, "complete")
    journal.catch_up(storage.journal_lines())
    counts = Counter(result.status for result in results)
    return ImportSummary(len(sessions), counts["new"], counts["repeated"], counts["conflict"])


@dataclass(frozen=True)
class _Source:
    """A session in a file: known to the database, or to be opened with its steps."""

    opening: _Opening
    known: Session | None
    steps: Sequence[Step]


def _checked(line: _Line, sources: Mapping[str, _Source], where: str) -> tuple[str, int, str, str]:
    """A record's session, step, kind and body."""
    source = sources.get(line.session)
    if source is None:
        raise InputError(f"{where}: session: no line before opens it")
    if line.seq >= len(source.steps):
        raise InputError(f"{where}: seq: expected below {len(source.steps)}")
    kind = source.steps[line.seq].kind
    return line.session, line.seq, kind, canonical(kind, line.body)


def _json_lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file ({error})") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            content = json.loads(line)
        except ValueError as error:
            raise InputError(f"{path}: line {number}: not JSON ({error})") from None
        if not isinstance(content, dict):
            raise InputError(f"{path}: line {number}: expected an object")
        yield number, content


def _source(opening: _Opening, storage: Storage, schedule: Schedule, where: str) -> _Source:
    """What an opening line speaks of; nothing is written yet."""
    if opening.format != FORMAT:
        raise InputError(f"{where}: format: expected {FORMAT}, found {opening.format}")
    # A token, in files of pages that knew no key.
    known = storage.session_with_key(opening.session) or storage.session_of(opening.session)
    if known is not None:
        return _Source(opening, known, known.steps)
    if opening.group is None or opening.place is None:
        raise InputError(f"{where}: session: not one of this study's")
    try:
        return _Source(opening, None, schedule(opening.group, opening.place))
    except IndexError:
        raise InputError(f"{where}: group: this study has no group {opening.group}") from None


def _opened(source: _Source, storage: Storage, now: float) -> Session:
    """A session that was run without our server."""
    opening = source.opening
    who = visitor(opening.identifiers, storage.secret)
    arrival = Arrival(
        f"import {opening.session}",
        opening.entry,
        marked(opening.identifiers),
        tab="",
        participant=who.participant if who else "",
        key=opening.session,
    )
    assert opening.group is not None
    assert opening.place is not None
    return storage.insert(arrival, opening.group, opening.place, source.steps, now)
