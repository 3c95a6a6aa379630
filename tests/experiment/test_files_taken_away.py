"""What becomes of a study's files while it is served: noticed, told, and never acknowledged."""

import json
import shutil
import subprocess
import sys
import time

import pandas as pd
import pytest
import sqlalchemy as sa

from pourcast import cli
from pourcast.errors import StoreError
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import api_of, fresh_database
from tests.experiment.make import answer, small_study
from tests.experiment.server_process import Asker, ServerProcess
from tests.experiment.test_server import admin_page, wait_until
from tests.experiment.test_storage import begin, record


def delete(path):
    """Take a file away, so that it can be put back."""
    path.rename(path.with_name("elsewhere"))


def put_back(path):
    path.with_name("elsewhere").rename(path)


def replace_by_a_copy(path):
    """As a synchronizing program does."""
    copy = path.with_name("copy")
    shutil.copyfile(path, copy)
    delete(path)
    copy.rename(path)


def move_folder(path):
    path.parent.rename(path.parent.with_name("moved"))


def move_folder_back(path):
    path.parent.with_name("moved").rename(path.parent)


TAKEN = {
    "deleted": (delete, put_back, "was deleted or moved while it was open"),
    "replaced": (replace_by_a_copy, put_back, "was replaced by another file while it was open"),
    "moved": (move_folder, move_folder_back, "was deleted or moved while it was open"),
}


@pytest.mark.parametrize("how", TAKEN)
def test_a_database_that_is_taken_away_acknowledges_nothing_until_it_is_back(tmp_path, how, caplog):
    take, back, says = TAKEN[how]
    study = small_study(tmp_path / "study")
    path = study / "responses.sqlite"
    with api_of(study) as api:
        told = api.begin().json()
        api.put(told, 0, answer("consent"))
        take(path)
        for said in (
            api.put(told, 1, answer("check")),
            api.begin("request-2"),
            api.post(told, "resume", tab="tab-00000001"),
            api.post(told, "finish", state="screened_out"),
        ):
            assert (said.status_code, said.headers["retry-after"]) == (503, "2")
        assert len(api.experiment.failures) == 1
        failure = api.experiment.failures[0]
        assert failure.startswith(f"{path}: {says}")
        assert "nothing is saved until the file is put back" in failure
        page = admin_page(api)
        assert says in page
        assert "Sessions</h2>" not in page
        assert caplog.text.count(says) == 1
        back(path)
        wait_until(lambda: not api.experiment.failures)
        assert "works again" in caplog.text
        assert api.put(told, 0, answer("consent")).json()["saved"] == "repeated"
        assert api.run(told)["missing"] == []
        assert len(api.storage.records()) == len(told["steps"])
        assert says not in admin_page(api)
        seqs = [line["seq"] for line in api.experiment.journal.lines() if "seq" in line]
        assert sorted(seqs) == list(range(len(told["steps"])))


def test_it_is_noticed_within_a_second_though_nobody_answers(tmp_path):
    study = small_study(tmp_path / "study")
    with api_of(study) as api:
        api.begin()
        delete(study / "responses.sqlite")
        looks = api.experiment.storage_failures
        began = time.monotonic()
        wait_until(lambda: looks.current)
        # Looked at every half second; the rest is for a machine that has much else to do.
        assert time.monotonic() - began < 10.0
        # Nothing was made in its place, which somebody would take for the study's.
        assert not (study / "responses.sqlite").exists()
        put_back(study / "responses.sqlite")
        wait_until(lambda: not looks.current)


def test_what_was_committed_as_the_file_went_is_in_the_journal_when_it_is_back(
    tmp_path, monkeypatch
):
    """Committed, and yet not acknowledged: the page posts it again, and it is there once."""
    study = small_study(tmp_path / "study")
    path = study / "responses.sqlite"
    with api_of(study) as api:
        told = api.begin().json()
        really = sa.engine.default.DefaultDialect.do_commit

        def commit(dialect, connection):
            really(dialect, connection)
            if connection.execute("SELECT count(*) FROM records").fetchone()[0]:
                delete(path)
                patched.undo()

        with monkeypatch.context() as patched:
            patched.setattr(sa.engine.default.DefaultDialect, "do_commit", commit)
            assert api.put(told, 0, answer("consent")).status_code == 503
        put_back(path)
        wait_until(lambda: not api.experiment.failures)
        assert [r.seq for r in api.storage.records()] == [0]
        assert [line["seq"] for line in api.experiment.journal.lines() if "seq" in line] == [0]
        assert api.put(told, 0, answer("consent")).json()["saved"] == "repeated"


def test_a_log_that_is_deleted_stops_all_and_a_restart_has_everything(tmp_path):
    study = small_study(tmp_path / "study")
    with api_of(study) as api:
        told = api.begin().json()
        api.put(told, 0, answer("consent"))
        (study / "responses.sqlite-wal").unlink()
        assert api.put(told, 1, answer("check")).status_code == 503
        assert "write-ahead log responses.sqlite-wal was deleted" in api.experiment.failures[0]
        # A log of the same name may be another program's.
        (study / "responses.sqlite-wal").touch()
        assert api.put(told, 1, answer("check")).status_code == 503
        (study / "responses.sqlite-wal").unlink()
    with api_of(study) as api:
        assert [r.seq for r in api.storage.records()] == [0]
        assert api.put(told, 1, answer("check")).json()["saved"] == "new"


def test_a_log_that_is_deleted_is_told_to_who_looks_at_the_study(tmp_path, capsys):
    study = small_study(tmp_path / "study")
    with api_of(study) as api:
        api.begin()
        (study / "responses.sqlite-wal").unlink()
        assert cli.run(["experiment", "status", str(study)]) == 1
        assert "responses.sqlite-wal was deleted: end the server" in capsys.readouterr().err


def test_a_log_that_another_program_made_anew_is_not_taken_for_ours(tmp_path):
    study = small_study(tmp_path / "study")
    with api_of(study) as api:
        told = api.begin().json()
        api.put(told, 0, answer("consent"))
        other = study / "other-wal"
        other.touch()
        other.replace(study / "responses.sqlite-wal")  # before the server could look
        assert api.put(told, 1, answer("check")).status_code == 503
        assert "write-ahead log responses.sqlite-wal was deleted" in api.experiment.failures[0]
    with api_of(study) as api:
        assert [r.seq for r in api.storage.records()] == [0]


@pytest.mark.parametrize("how", ["deleted", "emptied", "replaced"])
def test_a_journal_that_is_taken_away_is_written_anew_and_told_of(tmp_path, how, caplog):
    study = small_study(tmp_path / "study")
    path = study / "responses.jsonl"
    with api_of(study) as api:
        told = api.begin().json()
        for seq in range(3):
            api.put(told, seq, answer(told["steps"][seq]["kind"]))
        before = list(api.experiment.journal.lines())
        if how == "emptied":
            path.write_text("")
        else:
            path.unlink()
        if how == "replaced":
            path.write_text("somebody's\n")
        wait_until(lambda: "was deleted, emptied or replaced while the study was" in caplog.text)
        assert api.experiment.journal.missing(before) == []
        # And none of it twice, nor is anything lost that comes at that moment.
        path.unlink()
        api.put(told, 3, answer("judgment"))
        seqs = [line["seq"] for line in api.experiment.journal.lines() if "seq" in line]
        assert seqs == [0, 1, 2, 3]
        assert api.experiment.failures == []


def test_a_postgresql_that_is_gone_is_told_of_and_another_one_is_not_taken_for_it(postgresql):
    with fresh_database(postgresql) as url:
        storage = Storage(url)
        session, _, _ = begin(storage, "r1")
        storage.check()
        with storage.engine.begin() as connection:
            connection.exec_driver_sql("UPDATE meta SET value = 'ab' WHERE name = 'secret'")
        with pytest.raises(StoreError, match="was replaced by another database"):
            storage.check()
        with storage.engine.begin() as connection:
            connection.exec_driver_sql("DROP TABLE records")
        with pytest.raises(StoreError, match='relation "records" does not exist'):
            storage.save([record(session)])
        storage.close()


HOLD_ROOT_TO_MODES = """
import ctypes, os, sys
if os.getuid() == 0:
    for capability in (1, 2):  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH; 24: PR_CAPBSET_DROP
        assert ctypes.CDLL(None).prctl(24, capability, 0, 0, 0) == 0
os.execv(sys.executable, [sys.executable, "-c", *sys.argv[1:]])
"""
"""Take from root what lets it do all that modes forbid, and go on as another Python."""


def unprivileged(script, *arguments):
    """Run Python as somebody whom the modes of files hold."""
    command = [sys.executable, "-c", HOLD_ROOT_TO_MODES, script, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


WATCHED = """
import sys
from pathlib import Path
from pourcast.errors import StoreError
from pourcast.experiment.storage.database_file import DatabaseFile
path = Path(sys.argv[1])
file = DatabaseFile(path)
file.check()
path.chmod(0o400)
try:
    file.check()
except StoreError as error:
    print(error)
path.chmod(0o600)
file.check()
"""


def test_a_database_that_is_made_read_only_is_told_of(tmp_path):
    said = unprivileged(WATCHED, tmp_path / "x.sqlite")
    assert said.stdout == (
        f"{tmp_path / 'x.sqlite'}: was made read-only while it was open; nothing is saved until "
        "it can be written\n"
    ), said.stderr


COMMANDS = """
import json, sys
from pourcast import cli
for arguments in json.loads(sys.argv[1]):
    print(arguments[:2], cli.run(arguments), flush=True)
"""


def close_to_writers(folder):
    for path in [*folder.rglob("*"), folder]:
        path.chmod(0o555 if path.is_dir() else 0o444)


def open_to_writers(folder):
    for path in [folder, *folder.rglob("*")]:
        path.chmod(0o755)


@pytest.fixture(params=[pytest.param("closed", marks=pytest.mark.slow), "killed"])
def read_only_copy(request, tmp_path):
    """A copy of a study that nobody can change, of a server that ended, or had no time to."""
    study = small_study(tmp_path / "study")
    with api_of(study) as api:
        done, half = api.begin("request-1").json(), api.begin("request-2").json()
        api.run(done)
        api.put(half, 0, answer("consent"))
        if request.param == "killed":
            shutil.copytree(study, tmp_path / "copy")
    if request.param == "closed":
        shutil.copytree(study, tmp_path / "copy")
    copy = tmp_path / "copy"
    (copy / "responses.sqlite-shm").unlink(missing_ok=True)
    left = {path.name for path in copy.glob("responses.sqlite-*")}
    assert left == ({"responses.sqlite-wal"} if request.param == "killed" else set())
    close_to_writers(copy)
    yield copy
    open_to_writers(copy)


def run_read_only(copy, *commands):
    """Run commands on a copy that nobody can change: what they said; nothing of it was changed."""
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    said = unprivileged(COMMANDS, json.dumps([[*map(str, one)] for one in commands]))
    assert "Traceback" not in said.stderr
    assert before == {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    return said


def test_the_commands_that_read_work_on_a_copy_that_cannot_be_written(read_only_copy, tmp_path):
    copy = read_only_copy
    said = run_read_only(
        copy,
        ["experiment", "status", copy],
        ["experiment", "data", copy, "-o", tmp_path / "data"],
        ["experiment", "data", copy, "--withdraw", "x"],
        ["experiment", "serve", copy, "--check"],
    )
    out, err = said.stdout, said.stderr
    assert "7 judgments saved" in out
    assert "2 participants, 7 judgments" in out
    for name, code in (("status", 0), ("data", 0), ("data", 2), ("serve", 1)):
        assert f"['experiment', '{name}'] {code}" in out, err
    assert len(pd.read_csv(tmp_path / "data" / "trials.csv")) == 7
    assert "pourcast: withdraw: there is no participant 'x'" in err
    assert f"pourcast: {copy}: cannot be written (Permission denied)" in err


@pytest.mark.slow
@pytest.mark.parametrize("swept", [False, True])
def test_compare_and_report_work_on_a_copy_that_cannot_be_written(read_only_copy, tmp_path, swept):
    copy = read_only_copy
    if swept:
        open_to_writers(copy)
        assert cli.run(["compare", str(copy), "-m", "gravity"]) == 0
        close_to_writers(copy)
    assert (copy / "sweep").exists() == swept
    said = run_read_only(
        copy,
        *(
            [name, copy, "-m", "gravity", "-o", tmp_path / name, *more]
            for name, more in (("compare", []), ("report", ["--films", 0, "--studies", 0]))
        ),
    )
    assert said.stdout.count("] 0\n") == 2, said.stderr
    assert (tmp_path / "report" / "report.html").exists()


@pytest.mark.slow
@pytest.mark.parametrize("how", TAKEN)
def test_a_server_says_in_its_terminal_what_became_of_its_database(tmp_path, how):
    take, back, says = TAKEN[how]
    study = small_study(tmp_path / "study")
    log = tmp_path / "log"
    with ServerProcess(study, log=log) as server:
        page = Asker(server)
        told = page.begin("request-1")
        assert page.put(told, 0, answer("consent"))[0] == 200
        take(study / "responses.sqlite")
        wait_until(lambda: says in log.read_text())
        assert page.put(told, 1, answer("check"))[0] == 503
        status, admin = page.ask("GET", server.admin, {})
        assert status == 200
        assert says in admin
        line = next(line for line in log.read_text().splitlines() if says in line)
        assert line.startswith(str(study / "responses.sqlite"))
        assert "put back" in line
        back(study / "responses.sqlite")
        wait_until(lambda: "works again" in log.read_text())
        assert page.put(told, 1, answer("check"))[1]["saved"] == "new"
    assert "Traceback" not in log.read_text()
    assert cli.run(["experiment", "status", str(study)]) == 0


def test_a_second_copy_that_cannot_be_read_stops_nobody(tmp_path):
    study = small_study(tmp_path / "study")
    journal = study / "responses.jsonl"
    with api_of(study, journal_retry=0.05) as api:
        told = api.begin().json()
        delete(journal)
        journal.mkdir()
        assert api.put(told, 0, answer("consent")).json()["saved"] == "new"
        other = api.begin("request-2").json()
        assert api.put(other, 0, answer("consent")).status_code == 200
        assert any("responses.jsonl: cannot be" in one for one in api.experiment.failures)
        journal.rmdir()
        put_back(journal)
        wait_until(lambda: not api.experiment.failures)
    (study / "responses.sqlite").unlink()
    with api_of(study) as api:
        assert [one.request for one in api.storage.sessions()] == ["request-1", "request-2"]
        assert len(api.storage.records()) == 2


@pytest.mark.parametrize("content", [b"SQLite format 3\0" + b"\xff" * 8000, b"no database" * 900])
def test_a_damaged_database_says_what_to_do(tmp_path, content, capsys):
    study = small_study(tmp_path / "study")
    with api_of(study) as api:
        api.run(api.begin().json())
    (study / "responses.sqlite").write_bytes(content)
    for command in ("status", "serve"):
        assert cli.run(["experiment", command, str(study)]) == 1
        said = capsys.readouterr().err
        assert "the file is damaged: end the server, move it away" in said
        assert said.count("\n") == 1
    (study / "responses.sqlite").rename(tmp_path / "damaged")
    with api_of(study) as api:
        assert len(api.storage.records()) == 14
