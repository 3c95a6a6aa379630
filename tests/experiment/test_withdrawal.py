"""Who withdraws is nowhere in the study folder any more, or it is said where; nobody else is hurt."""

import gzip
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import unicodedata
import zipfile
from contextlib import closing
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
import sqlalchemy as sa

from pourcast import cli
from pourcast.experiment.data import file_search, withdrawal
from pourcast.experiment.data.file_search import Needle, search_folder
from pourcast.experiment.design.links import link_key
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage
from pourcast.tables import read_table
from tests.experiment.conftest import api_of, fresh_database
from tests.experiment.make import answer, small_study
from tests.experiment.server_process import ServerProcess, Sturdy

PID, OTHER = "5f0c1e9ab3d4e5f60718293a", "60aa1e9ab3d4e5f60718293b"


def call(*arguments):
    return cli.run(["experiment", *map(str, arguments)])


def link_of(pid):
    return {"PROLIFIC_PID": pid, "STUDY_ID": "study-7", "SESSION_ID": f"visit-of-{pid[:4]}"}


def take_part(api, request, link):
    told = api.begin(request, link=link).json()
    api.run(told)
    return told


@pytest.fixture(scope="module")
def study_of_two(tmp_path_factory):
    study = small_study(tmp_path_factory.mktemp("two") / "s")
    with api_of(study) as api:
        take_part(api, "browser-request-1", link_of(PID))
        take_part(api, "browser-request-2", link_of(OTHER))
    return study


@pytest.fixture
def collected(study_of_two, tmp_path):
    """A study of two people from Prolific; and what only the first one is called."""
    study = shutil.copytree(study_of_two, tmp_path / "s")
    return study, names_of(study, PID)


def names_of(study, pid):
    """All that one person is called, as the database has it."""
    with closing(sqlite3.connect(study / "responses.sqlite")) as database:
        where = f"%{pid}%"
        rows = database.execute(
            "SELECT key, request, participant, code, id FROM sessions WHERE identifiers LIKE ?",
            (where,),
        ).fetchall()
        digests = [
            digest
            for row in rows
            for (digest,) in database.execute(
                "SELECT digest FROM tokens WHERE session = ?", row[4:]
            )
        ]
    assert rows
    return [pid, *(name for row in rows for name in row[:4]), *digests, f"visit-of-{pid[:4]}"]


def files_with(folder, names):
    """Plain bytes of all files: what has one of the names?"""
    return sorted(
        f"{path.relative_to(folder)}: {name}"
        for path in folder.rglob("*")
        if path.is_file()
        for name in names
        if name.encode() in path.read_bytes() or name in path.name
    )


def write_copies(study, names):
    """All that our commands write, and copies of it by other names, in other forms."""
    call("data", study, "--identifiers")
    call("data", study, "--format", "psych-ds", "-o", study / "for others")
    people = pd.read_csv(study / "data" / "participants.csv", dtype=str)
    trials = pd.read_csv(study / "data" / "trials.csv", dtype=str)
    old = study / "old"
    old.mkdir()
    people.to_csv(old / "a.tsv", sep="\t", index=False)
    trials.to_csv(old / "excel (1).csv", sep=";", index=False, encoding="utf-16")
    trials.astype({"participant": "category"}).to_parquet(old / "x.parquet")
    shutil.copy(study / "responses.jsonl", old / "journal of may")
    with (
        closing(sqlite3.connect(study / "responses.sqlite")) as database,
        closing(sqlite3.connect(old / "backup.db")) as copy,
    ):
        database.backup(copy)
    temporary = old / ".trials-0123456789abcdef.csv"
    temporary.write_text(f"participant\n{names[3]}\n")
    os.utime(temporary, (1.0, 1.0))
    for folder in (study / "report", study / "report of may"):
        for part in ("tables", "figures"):
            (folder / part).mkdir(parents=True)
        (folder / "report.html").write_text(f"excluded: {names[3]}")
        (folder / "tables" / "agreement.csv").write_text("model\n")
        (folder / "tables" / "participants.csv").write_text(f"participant\n{names[3]}\n")
        (folder / "figures" / "people.svg").write_text("<svg/>")
    (study / "numbers").mkdir()
    (study / "numbers" / "agreement.csv").write_text("model\n")
    (study / "compared").mkdir()
    (study / "compared" / "agreement.csv").write_text("model\n")
    (study / "compared" / "participants.csv").write_text(f"participant\n{names[3]}\n")
    for keep in ("report/my notes.txt", "compared/mine.csv"):
        (study / keep).write_text("nobody")
    return trials


DELETED = (
    "responses.jsonl: 16 lines", "data/participants.csv: 1 row", "data/trials.csv: 7 rows",
    "old/a.tsv: 1 row", "old/excel (1).csv: 7 rows", "old/x.parquet: 7 rows",
    "old/journal of may: ", "old/backup.db: 1 session",
    "for others/data/study-s_description-participants_data.csv: 1 row",
    "old/.trials-0123456789abcdef.csv: a temporary file that was left behind",
    "report: 4 files, made with this person's answers; `pourcast report ",
    "report of may: 4 files, made with this person's answers; `pourcast report ",
    "compared: 2 files, made with this person's answers; `pourcast compare ",
    "database: 1 rows of sessions",
)  # fmt: skip


def test_all_that_is_ours_is_cleaned_and_nobody_elses(collected, capsys):
    study, names = collected
    trials = write_copies(study, names)
    other = trials["participant"].tolist()[-1]
    before = {name: (study / name).read_bytes() for name in ("scenes.json", "experiment.toml")}
    capsys.readouterr()
    assert call("data", study, "--withdraw", PID) == 0
    said = capsys.readouterr().out
    assert [line for line in DELETED if f"deleted: {line}" not in said] == []
    assert f"`pourcast report {study} -o {study / 'report of may'}` makes them again" in said
    numbers = f"`pourcast compare {study} -o {study / 'numbers'}` makes them again without"
    assert f"note: numbers: its numbers may be made with this person's answers; {numbers}" in said
    assert said.count("its numbers may be") == 1
    assert f"look for: {', '.join(sorted([*names[:2], *names[3:5], names[-1]]))}\n" in said
    assert files_with(study, names) == []
    for keep in ("report/my notes.txt", "compared/mine.csv"):
        assert (study / keep).read_text() == "nobody"
    assert not (study / "report" / "report.html").exists()
    assert {name: (study / name).read_bytes() for name in before} == before
    # The other one has all of it still.
    old = study / "old"
    assert pd.read_csv(old / "a.tsv", sep="\t", dtype=str)["participant"].tolist() == [other]
    kept = pd.read_csv(old / "excel (1).csv", sep=";", encoding="utf-16", dtype=str)
    theirs = trials[trials["participant"] == other].reset_index(drop=True)
    pd.testing.assert_frame_equal(kept, theirs)
    table = pq.read_table(old / "x.parquet")
    assert set(table["participant"].to_pylist()) == {other}
    assert "dictionary" in str(table.schema.field("participant").type)
    with closing(sqlite3.connect(old / "backup.db")) as copy:
        assert copy.execute("SELECT count(*) FROM sessions").fetchone() == (1,)
        assert copy.execute("SELECT count(*) FROM records").fetchone() == (14,)
    assert call("data", study, "--withdraw", OTHER) == 0


def test_what_is_not_ours_is_named_and_left_as_it_is(collected, capsys):
    study, names = collected
    left = {
        "notes.txt": f"wrote to {PID}, twice".encode(),
        "utf16.txt": f"wrote to {PID}".encode("utf-16"),
        "mail.html.gz": gzip.compress(f"<p>{names[4]}</p>".encode()),
        f"{PID}.pdf": b"%PDF- packed",
        "one-line.json": json.dumps([{"session": names[1], "seq": 1}]).encode(),
        "submissions.csv": f"Submission id,Status\nvisit-of-{PID[:4]},APPROVED\n".encode(),
        "prolific_export.csv": f"Submission id,Participant id\n1,{PID}\n".encode(),
    }
    for name, content in left.items():
        (study / name).write_bytes(content)
    with zipfile.ZipFile(study / "book.xlsx", "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("xl/sharedStrings.xml", f"<t>{names[3]}</t>")
    (study / ".new-0123456789abcdef.csv").write_text(PID)  # a command writes it just now
    assert call("data", study, "--withdraw", PID) == 1
    said = capsys.readouterr()
    lines = [line[6:] for line in said.out.splitlines() if line.startswith("left: ")]
    named = {line.partition(": has ")[0] for line in lines}
    assert named == {*left, "book.xlsx", ".new-0123456789abcdef.csv"}
    assert "it is being written: say this again in a minute" in said.out
    assert "not all could be cleaned (9 named above); clean or delete the rest by hand" in said.err
    assert "note: looked through " in said.out
    assert "(pictures, films and pours in stimuli/, simulation results in sweep/)" in said.out
    assert f"note: what pictures, films and PDFs show was not looked at: {PID}.pdf" in said.out
    assert {name: (study / name).read_bytes() for name in left} == left
    for name in named:
        (study / name).unlink()
    assert files_with(study, names) == []
    # Once more: nothing is there.
    assert call("data", study, "--withdraw", PID) == 2
    assert f"there is no participant '{PID}'" in capsys.readouterr().err


@pytest.mark.parametrize("age", [0.0, 1e6])
def test_what_a_kill_left_of_the_journal_goes_with_the_person(collected, age):
    study, names = collected
    left = study / ".responses-0123456789abcdef.jsonl"
    shutil.copy(study / "responses.jsonl", left)
    os.utime(left, (left.stat().st_mtime - age,) * 2)
    assert call("data", study, "--withdraw", PID) == 0
    assert not left.exists()
    assert files_with(study, names) == []


def test_copies_of_older_databases_are_cleaned(collected, capsys):
    study, names = collected
    copy = study / "responses-schema-1.sqlite"
    with (
        closing(sqlite3.connect(study / "responses.sqlite")) as database,
        closing(sqlite3.connect(copy)) as old,
    ):
        database.backup(old)
        columns = [row[1] for row in old.execute("PRAGMA table_info(sessions)")]
        first = ", ".join(name for name in columns if name in FIRST_VERSION)
        old.execute(f"CREATE TABLE first AS SELECT {first} FROM sessions")
        old.execute("DROP TABLE sessions")
        old.execute("ALTER TABLE first RENAME TO sessions")
        old.execute("DROP TABLE browsers")
        old.commit()
    assert call("data", study, "--withdraw", PID) == 0
    assert "deleted: responses-schema-1.sqlite: 1 session" in capsys.readouterr().out
    assert files_with(study, names) == []
    with closing(sqlite3.connect(copy)) as old:
        assert old.execute("SELECT count(*) FROM records").fetchone() == (14,)


FIRST_VERSION = (
    "id", "request", "participant", "entry", "identifiers", "group_number", "place", "state", "tab",
    "code", "plan", "started", "last_seen",
)  # fmt: skip


def test_everything_is_clean_by_itself_where_only_our_commands_wrote(collected, capsys):
    study, names = collected
    call("data", study, "--identifiers")
    for _ in range(2):
        # By any name that is theirs, and with another session of theirs.
        assert call("data", study, "--withdraw", names[4]) in (0, 2)
        assert files_with(study, names) == []
    assert len(pd.read_csv(study / "data" / "participants.csv")) == 1


def test_whoever_is_asked_for_by_one_session_goes_with_all(tmp_path):
    study = small_study(tmp_path / "s")
    with api_of(study) as api:
        take_part(api, "request-one", link_of(PID))
        api.storage.drop_stale(0.0, 1e12)
        api.storage.engine.dispose()
    with closing(sqlite3.connect(study / "responses.sqlite")) as database:
        # A second session of the same person, as an import makes it.
        columns = [row[1] for row in database.execute("PRAGMA table_info(sessions)")]
        row = dict(zip(columns, database.execute("SELECT * FROM sessions").fetchone(), strict=True))
        row |= {"id": 99, "key": "k" * 32, "request": "import of a file", "code": "SECOND01"}
        marks = ", ".join("?" * len(row))
        database.execute(f"INSERT INTO sessions VALUES ({marks})", list(row.values()))
        database.commit()
    names = names_of(study, PID)
    assert call("data", study, "--withdraw", "SECOND01") == 0
    assert files_with(study, names) == []


STAGES = [
    ("remove_from_file", withdrawal), ("_delete_derived", withdrawal), ("_clean_stores", withdrawal),
    ("remove", Journal), ("delete", Storage), ("write_anew", Storage), ("_look_again", withdrawal),
]  # fmt: skip


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize(("stage", "owner"), STAGES)
def test_what_was_interrupted_is_done_when_it_is_said_again(
    collected, monkeypatch, stage, owner, after
):
    study, names = collected
    call("data", study, "--identifiers")
    original = getattr(owner, stage)

    def interrupted(*arguments, **options):
        if after:
            original(*arguments, **options)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(owner, stage, interrupted)
        assert call("data", study, "--withdraw", PID) not in (0, 2)
    # Done, or all of it was done before.
    assert call("data", study, "--withdraw", PID) in (0, 2)
    assert files_with(study, names) == []
    assert call("data", study, "--withdraw", OTHER) == 0


def test_tables_are_found_when_the_database_knows_nothing_any_more(collected, capsys):
    study, names = collected
    call("data", study)
    with closing(Storage.of_study(study)) as storage:
        [number] = [one.number for one in storage.sessions() if one.code == names[4]]
        storage.delete([number])
        storage.write_anew()
    assert call("data", study, "--withdraw", PID) == 0
    assert "deleted: data/participants.csv: 1 row" in capsys.readouterr().out
    assert files_with(study, names) == []


def test_a_study_whose_database_was_lost_is_cleaned_all_the_same(collected, capsys):
    study, names = collected
    call("data", study)
    for path in study.glob("responses.sqlite*"):
        path.unlink()
    assert call("data", study, "--withdraw", PID) == 0
    assert files_with(study, names) == []
    assert not (study / "responses.sqlite").exists()
    assert files_with(study, [OTHER]) != []


@pytest.mark.parametrize("earlier", [False, True])
def test_whoever_has_the_same_number_in_another_database_is_not_touched(collected, earlier):
    study, names = collected
    for path in study.glob("responses.sqlite*"):
        path.unlink()
    late = "70bb1e9ab3d4e5f60718293c"
    with api_of(study) as api:
        take_part(api, "browser-request-3", link_of(late))
    late_names = names_of(study, late)
    lines = (study / "responses.jsonl").read_bytes().splitlines()
    theirs = {
        who: [line for line in lines if key.encode() in line]
        for who, key in ((PID, names[1]), (late, late_names[1]))
    }
    gone, kept = (PID, late) if earlier else (late, PID)
    assert call("data", study, "--withdraw", gone) == 0
    left = (study / "responses.jsonl").read_bytes().splitlines()
    assert [line for line in left if line in theirs[kept]] == theirs[kept]
    assert not [line for line in left if line in theirs[gone]]
    assert len(theirs[kept]) >= 15


LAB_NAMES = [
    "12", "123", "Johann", "Johannes", "Ada Lovelace", "Zoë Müller", 'O"Neill', "a&b=<c>",
    "00123", "1E5", "=cmd", "'quoted",
]  # fmt: skip


@pytest.fixture(scope="module")
def study_of_names(tmp_path_factory):
    study = small_study(tmp_path_factory.mktemp("names") / "s", scenes=2)
    with api_of(study) as api:
        lab = link_key(api.storage.secret, "lab")
        for number, name in enumerate(LAB_NAMES):
            take_part(api, f"browser-request-{number:02}", {"lab": lab, "participant": name})
    call("data", study, "--identifiers")
    return study


@pytest.mark.parametrize("who", LAB_NAMES)
def test_names_that_the_lab_gave_are_told_from_others_that_begin_so(
    study_of_names, tmp_path, capsys, who
):
    study = shutil.copytree(study_of_names, tmp_path / "s")
    table = study / "data" / "participants.csv"
    before = read_table(table, text=("id_participant",))
    assert before["id_participant"].tolist() == LAB_NAMES
    capsys.readouterr()
    assert call("data", study, "--withdraw", who) == 0, capsys.readouterr().out
    after = read_table(table, text=("id_participant",))
    pd.testing.assert_frame_equal(
        after, before[before["id_participant"] != who].reset_index(drop=True)
    )
    with closing(Storage.of_study(study)) as storage:
        left = [one.identifiers["participant"] for one in storage.sessions()]
    assert left == [name for name in LAB_NAMES if name != who]


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le", "utf-16-be", "cp1252"])
def test_a_name_is_found_however_it_is_written(tmp_path, form, encoding):
    name = "Zoë Müller & Co"
    written = [
        unicodedata.normalize(form, name).encode(encoding, "replace"),
        json.dumps(name).encode(), b"/?participant=Zo%C3%AB%20M%C3%BCller%20%26%20Co HTTP",
        b"Zo%c3%ab+M%c3%bcller+%26+Co", "<p>Zoë Müller &amp; Co</p>".encode(),
    ]  # fmt: skip
    for number, content in enumerate(written):
        (tmp_path / str(number)).write_bytes(b"x" * 3000 + b" " + content + b" y")
    # What Windows' letters can't write isn't written.
    lost = {tmp_path / "0"} if (form, encoding) == ("NFD", "cp1252") else set()
    found = search_folder(tmp_path, [Needle(name, "name", whole=True)])
    assert set(found.found) == {tmp_path / str(k) for k in range(5)} - lost
    assert search_folder(tmp_path, [Needle("Zoë Mülle", "part", whole=True)]).found == {}


@pytest.mark.parametrize("before", range(5, 40, 5))
def test_a_word_that_is_parted_by_what_is_read_at_once_is_found(tmp_path, monkeypatch, before):
    monkeypatch.setattr(file_search, "_CHUNK", 16)
    monkeypatch.setattr(file_search, "_OVERLAP", 64)
    (tmp_path / "long.txt").write_bytes(b"x " * before + PID.encode() + b" y" * 40)
    assert len(search_folder(tmp_path, [Needle(PID, "id", whole=True)]).found) == 1


def test_folders_that_cannot_be_read_are_named(tmp_path, monkeypatch):
    (tmp_path / "closed").mkdir()
    scandir = os.scandir

    def closed(path):
        if str(path).endswith("closed"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", closed)
    unread = search_folder(tmp_path, []).unread
    assert unread == {tmp_path / "closed": "cannot be read (Permission denied)"}


def test_what_waits_for_the_journal_goes_with_the_person(tmp_path, monkeypatch):
    study = small_study(tmp_path / "s", scenes=2)

    def full(*_):
        raise OSError(28, "No space left on device")

    with api_of(study) as api:
        take_part(api, "browser-request-1", link_of(OTHER))
        with monkeypatch.context() as patched:
            patched.setattr("pourcast.experiment.storage.journal._append", full)
            take_part(api, "browser-request-2", link_of(PID))
            assert api.experiment.journal.waiting > 1
            names = names_of(study, PID)
            assert call("data", study, "--withdraw", PID) == 0
        take_part(api, "browser-request-3", {"lab": link_key(api.storage.secret, "lab")})
        assert api.experiment.journal.waiting == 0
        assert files_with(study, names) == []


def test_what_cannot_be_looked_through_is_named(collected, capsys):
    study, _ = collected
    (study / "cut.zip").write_bytes(b"PK\x03\x04 cut short")
    (study / "cut.csv.gz").write_bytes(gzip.compress(b"x" * 999)[:20])
    (study / "cut.parquet").write_bytes(b"PAR1 cut short")
    os.symlink(study, study / "round")
    assert call("data", study, "--withdraw", PID) == 1
    left = [line for line in capsys.readouterr().out.splitlines() if line.startswith("left: ")]
    assert [line.split(": ")[1] for line in left] == ["cut.csv.gz", "cut.parquet", "cut.zip"]
    assert all("damaged" in line for line in left)


@pytest.mark.parametrize("who", ["", " ", "session", "water", "study-7", "experiment", "3"])
def test_a_word_that_is_nobodys_name_deletes_nothing(collected, capsys, who):
    study, _ = collected
    with (study / "responses.jsonl").open("ab") as stream:
        stream.write(b'{"session": "cut sho\n')
    before = {path: path.read_bytes() for path in study.glob("responses.jsonl")}
    assert call("data", study, "--withdraw", who) == 2
    assert capsys.readouterr().err.startswith("pourcast: withdraw: ")
    assert {path: path.read_bytes() for path in study.glob("responses.jsonl")} == before


def test_a_server_may_run_and_its_open_tab_writes_nothing_any_more(tmp_path, capsys):
    study = small_study(tmp_path / "s")
    with ServerProcess(study) as server:
        people = [Sturdy(server.port, server.lab, number) for number in range(3)]
        people[0].take_part()
        begin = {"request": "request-of-the-tab", "tab": "tab-00000009",
                 "link": link_of(PID)}  # fmt: skip
        told = people[1].ask("POST", "/api/sessions", begin)
        body = {"tab": begin["tab"], "body": answer("consent")}
        people[1].ask("PUT", "/api/session/records/0", body, told["token"])
        names = names_of(study, PID)
        assert call("data", study, "--withdraw", PID) == 0, capsys.readouterr().out
        assert files_with(study, names) == []
        for seq in (0, 1):
            with pytest.raises(AssertionError, match="401"):
                people[1].ask("PUT", f"/api/session/records/{seq}", body, told["token"])
        people[2].take_part()
        assert files_with(study, names) == []
    assert files_with(study, names) == []
    with closing(Storage.of_study(study)) as storage:
        assert [one.state for one in storage.sessions()] == ["complete", "complete"]


@pytest.mark.slow  # SQLite waits for ten seconds
def test_a_reader_who_holds_the_log_up_is_told_of_and_the_rest_is_done_later(collected, capsys):
    study, names = collected
    with closing(sqlite3.connect(study / "responses.sqlite", isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM sessions").fetchone()
        assert call("data", study, "--withdraw", PID) == 1
        said = capsys.readouterr().out
        assert "its write-ahead log is being read by another program" in said
        reader.execute("COMMIT")
        capsys.readouterr()
    assert call("data", study, "--withdraw", PID) in (0, 2)
    assert files_with(study, names) == []


def test_postgresql_writes_its_tables_anew(tmp_path, postgresql, capsys):
    study = small_study(tmp_path / "s")
    with fresh_database(postgresql) as url, closing(Storage(url)) as storage:
        for number, pid in enumerate((PID, OTHER)):
            arrival = withdrawal_arrival(f"browser-request-{number}", pid)
            storage.begin(arrival, lambda *_: (), groups=1, places=None, largest_gap=9.0, now=1.0)
        names = [PID, *(name for s in storage.sessions()[:1] for name in (s.key, s.code))]
        assert call("data", study, "--withdraw", PID, "--database", url) == 0
        said = capsys.readouterr().out
        assert "note: PostgreSQL's own write-ahead log, its replicas and its backups" in said
        assert [one.identifiers["PROLIFIC_PID"] for one in storage.sessions()] == [OTHER]
        with storage.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.exec_driver_sql("CHECKPOINT")
            base = connection.scalar(sa.text("SHOW data_directory"))
            files = [
                connection.scalar(sa.text(f"SELECT pg_relation_filepath('{table}')"))
                for table in ("sessions", "tokens", "records")
            ]
        contents = [Path(base, file).read_bytes() for file in files]
    assert OTHER.encode() in contents[0]
    assert not any(name.encode() in content for name in names for content in contents)


def withdrawal_arrival(request, pid):
    from pourcast.experiment.storage.sessions import Arrival

    return Arrival(request, "prolific", link_of(pid), "tab-00000001", f"code-of-{pid[:4]}")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_withdrawal_that_is_killed_at_any_moment_is_done_the_next_time(tmp_path, seed):
    import random

    study, moments = small_study(tmp_path / "s"), random.Random(seed)
    with api_of(study) as api:
        take_part(api, "browser-request-1", link_of(PID))
        take_part(api, "browser-request-2", link_of(OTHER))
    call("data", study, "--identifiers")
    names = names_of(study, PID)
    command = [sys.executable, "-c", KILLED, str(study), PID, str(moments.random())]
    for _ in range(5):
        subprocess.run(command, check=False, capture_output=True)
        command[-1] = str(moments.random())
    for path in study.rglob(".*-????????????????.*"):
        os.utime(path, (1.0, 1.0))
    assert call("data", study, "--withdraw", PID) in (0, 2)
    assert files_with(study, names) == []
    assert call("data", study, "--withdraw", OTHER) == 0


KILLED = """
import os, random, signal, sys
study, who, at = sys.argv[1:]
from pourcast import cli
import pourcast.comparison.compare, pourcast.experiment.data.withdrawal, sqlalchemy
count = 0
def trace(frame, event, argument):
    global count
    count += 1
    if count == limit:
        os.kill(os.getpid(), signal.SIGKILL)
    return trace
limit = int(float(at) * 480000)
sys.settrace(trace)
cli.run(["experiment", "data", study, "--withdraw", who])
print(count)
"""
