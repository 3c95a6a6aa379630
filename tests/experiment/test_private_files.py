"""What tells who people are is read by its owner alone, and stands in no table unasked."""

import json
import os
import stat
import subprocess
import sys
import threading

import pandas as pd
import pytest
import sqlalchemy as sa

from pourcast import cli
from pourcast.errors import StoreError
from pourcast.experiment.data.tables import (
    IDENTIFIER_PREFIX,
    PARTICIPANT_COLUMNS,
    TRIAL_COLUMNS,
    identifier_columns,
    participants_table,
    write_csv,
)
from pourcast.experiment.design.links import link_key
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.schema import SESSIONS
from pourcast.experiment.storage.sessions import Arrival
from pourcast.experiment.storage.storage import Storage
from pourcast.files import keep_private, left_behind, replacing, write_text
from pourcast.spreadsheets import guarded
from tests.experiment.conftest import api_of
from tests.experiment.make import EXP1, answer, small_study
from tests.experiment.server_process import ServerProcess, Sturdy

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows keeps no such modes")

KEPT = ("responses.sqlite", "responses.sqlite-wal", "responses.sqlite-shm", "responses.jsonl",
        "responses.lock", "experiment.lock")  # fmt: skip


def call(*arguments):
    return cli.run(["experiment", *map(str, arguments)])


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.fixture(params=["000", "022"])
def umask(request):
    old = os.umask(int(request.param, 8))
    yield
    os.umask(old)


def test_all_files_of_a_study_that_runs_are_their_owners(tmp_path, umask):
    study = small_study(tmp_path / "s")
    with ServerProcess(study) as server:
        Sturdy(server.port, server.lab, 1).take_part()
        assert {name: oct(mode(study / name)) for name in KEPT} == dict.fromkeys(KEPT, "0o600")
    assert call("data", study, "--identifiers") == 0
    assert mode(study / "data") == 0o700
    assert {oct(mode(path)) for path in (study / "data").iterdir()} == {"0o600"}
    assert call("data", study, "--withdraw", "nobody at all") == 2
    assert mode(study / "responses.jsonl") == 0o600


def test_files_that_others_could_read_are_tightened_and_it_is_said_once(tmp_path, caplog, umask):
    study = small_study(tmp_path / "s")
    with api_of(study) as api:
        api.begin()
    for name in KEPT[:1] + KEPT[3:5]:
        (study / name).chmod(0o664)
    with api_of(study):
        for name in KEPT[:1] + KEPT[3:5]:
            assert mode(study / name) == 0o600
            said = [line for line in caplog.messages if line.startswith(f"{study / name}: ")]
            assert said == [
                f"{study / name}: others on this computer could read it (mode 0664); now its "
                "owner alone can"
            ]
    caplog.clear()
    with api_of(study):
        assert caplog.messages == []


def test_a_file_that_keeps_its_mode_is_told_of_once_and_nothing_fails(
    tmp_path, caplog, monkeypatch
):
    path = tmp_path / "responses.sqlite"
    path.touch(0o644)
    monkeypatch.setattr("pathlib.Path.chmod", lambda *_: None)  # FAT: no modes, and no error
    keep_private(path)
    monkeypatch.setattr("pathlib.Path.chmod", _forbidden)  # another's file
    keep_private(path)
    assert [line.partition(": ")[2] for line in caplog.messages] == [
        "others on this computer can read it (mode 0644), and that can't be changed from here; "
        "keep the study where only you can read"
    ]
    Storage(f"sqlite:///{path}").close()


def _forbidden(*_):
    raise PermissionError("not yours")


def test_nobody_reads_a_private_file_while_it_is_written_and_a_rewrite_opens_none(tmp_path, umask):
    path = tmp_path / "made" / "ids.csv"
    with replacing(path, private=True) as temporary:
        assert (mode(temporary), mode(path.parent)) == (0o600, 0o700)
        temporary.write_text("x")
    assert mode(path) == 0o600
    with replacing(path) as temporary:
        assert mode(temporary) == 0o600
        assert left_behind(path) == [temporary]
    assert mode(path) == 0o600
    open_to_all = tmp_path / "scenes.json"
    write_text(open_to_all, "x")
    assert mode(open_to_all) == 0o666 & ~current_umask()


def current_umask():
    script = "import os; print(os.umask(0))"
    return int(subprocess.check_output([sys.executable, "-c", script]))


def test_sqlite_keeps_its_locks_when_its_files_are_kept_private(tmp_path):
    path = tmp_path / "responses.sqlite"
    first = Storage(f"sqlite:///{path}")
    with first.engine.execution_options(writes=True).begin():
        Storage(f"sqlite:///{path}").close()
        script = (
            "import sqlite3, sys\n"
            f"c = sqlite3.connect({str(path)!r}, timeout=0, isolation_level=None)\n"
            "c.execute('BEGIN IMMEDIATE')\n"
        )
        other = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=False
        )
    first.close()
    assert "database is locked" in other.stderr


def test_a_lab_name_does_not_take_the_place_of_the_participants_code(tmp_path):
    study = small_study(tmp_path / "s")
    with api_of(study) as api:
        lab = link_key(api.storage.secret, "lab")
        told = api.begin(link={"lab": lab, "participant": "Ada"}).json()
    assert call("data", study, "--identifiers", "-o", tmp_path / "out") == 0
    people = pd.read_csv(tmp_path / "out" / "participants.csv")
    assert people["participant"].tolist() == [told["participant"]]
    assert people["id_participant"].tolist() == ["Ada"]
    assert not any(
        name.startswith(IDENTIFIER_PREFIX) for name in {**TRIAL_COLUMNS, **PARTICIPANT_COLUMNS}
    )


ODD_NAMES = ["participant", "state", "code", "=1+1", "+x", "-x", "@x", "\tx", "\rx", "x" * 5000,
             "a b", "a_b", "a\nb", "nul\0", "\ud800", "id_x", "", "Prénom"]  # fmt: skip


def test_names_from_a_file_are_no_columns_of_ours_and_no_formulas(tmp_path, capsys):
    study = small_study(tmp_path / "s", design=EXP1)
    opening = {
        "format": "pourcast-records", "session": "a1b2c3d4e5", "entry": "jatos", "group": 0,
        "place": 0, "identifiers": {name: f"value {k}" for k, name in enumerate(ODD_NAMES)},
    }  # fmt: skip
    path = tmp_path / "results.txt"
    path.write_text(json.dumps(opening) + "\n")
    assert call("data", study, "--import", path) == 0
    storage = Storage.of_study(study)
    table = participants_table(storage, identifiers=True)
    storage.close()
    assert list(table.columns[: len(PARTICIPANT_COLUMNS)]) == list(PARTICIPANT_COLUMNS)
    own = [str(name) for name in table.columns[len(PARTICIPANT_COLUMNS) :]]
    assert len(set(own)) == len(own) == len(ODD_NAMES)
    given = sorted(opening["identifiers"].items())
    assert [table[name].item() for name in own] == [value for _, value in given]
    for name in own:
        assert name.startswith(IDENTIFIER_PREFIX)
        assert name.isprintable()
        assert len(name) < 70
    assert table["state"].tolist() == ["open"]
    assert call("data", study, "--identifiers", "-o", tmp_path / "out") == 0
    read = pd.read_csv(tmp_path / "out" / "participants.csv")
    assert list(read.columns) == list(table.columns)


def test_the_same_names_get_the_same_columns():
    assert identifier_columns(["a b", "a_b", "a b", "a~b"]) == {
        "a b": "id_a_b", "a_b": "id_a_b~2", "a~b": "id_a_b~3",
    }  # fmt: skip


@pytest.mark.parametrize(
    "begin", ["=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20"]
)
def test_header_cells_are_no_formulas_either(tmp_path, begin):
    write_csv(tmp_path / "t.csv", pd.DataFrame({f"{begin}cmd": [f"{begin}cmd"]}))
    read = pd.read_csv(tmp_path / "t.csv", lineterminator="\n")
    assert f"'{begin}cmd" in read.columns
    assert guarded(pd.DataFrame({"x": [begin]}))["x"].item() == f"'{begin}"


def test_half_characters_and_control_characters_in_remarks_break_no_table(tmp_path, capsys):
    study = small_study(tmp_path / "s")
    with api_of(study) as api:
        told = api.begin().json()
        last = told["steps"][-1]
        assert last["kind"] == "debrief"
        remarks = {"rt": 1.0, "remarks": "half \ud83d, nul \0, fine\nthere"}
        body = json.dumps({"tab": "tab-00000001", "body": remarks})
        said = api.client.put(
            f"/api/session/records/{last['seq']}",
            content=body,
            headers={"Authorization": f"Bearer {told['token']}"},
        )
        assert said.status_code == 200
        token = api.storage.admin_token
        assert api.client.get(f"/admin?token={token}").status_code == 200
        assert api.client.get(f"/admin/participants.csv?token={token}").status_code == 200
    assert call("data", study, "-o", tmp_path / "out") == 0
    people = pd.read_csv(tmp_path / "out" / "participants.csv")
    assert people["remarks"].item() == "half �, nul �, fine\nthere"


SECRETS = {"complete": "C0DE-OF-THE-END", "redirect": "https://p.example/?cc={code}&x=C0DE2"}


def test_a_dataset_for_others_tells_nobody_and_pays_nobody(tmp_path, capsys):
    recruiting = "".join(f'{name} = "{value}"\n' for name, value in SECRETS.items())
    study = small_study(tmp_path / "s", design=f"{EXP1}[recruiting]\n{recruiting}")
    with api_of(study) as api:
        link = {"PROLIFIC_PID": "5f0secret", "STUDY_ID": "st-1", "SESSION_ID": "se-1"}
        told = api.begin(link=link).json()
        for step in told["steps"]:
            api.put(told, step["seq"], answer(step["kind"]))
    assert call("data", study, "--format", "psych-ds", "-o", tmp_path / "out") == 0
    text = "".join(path.read_text() for path in (tmp_path / "out").rglob("*.*"))
    hidden = ("5f0secret", "st-1", "se-1", "fine</b>", told["code"], "C0DE")
    assert {word: word in text for word in hidden} == dict.fromkeys(hidden, False)
    assert told["participant"] in text
    assert "`remarks`" not in (tmp_path / "out" / "README.md").read_text()
    asked = tmp_path / "asked"
    assert (
        call("data", study, "--format", "psych-ds", "-o", asked, "--remarks", "--identifiers") == 0
    )
    text = "".join(path.read_text() for path in asked.rglob("*.*"))
    assert all(word in text for word in hidden[:-1])
    assert "C0DE" not in text
    assert "columns `remarks`, `code`, `id_PROLIFIC_PID`" in (asked / "README.md").read_text()
    assert {oct(mode(path)) for path in (asked / "data").iterdir()} == {"0o600"}
    assert mode(asked) == 0o700


@pytest.mark.parametrize(
    "url",
    [
        "postgresql://me:tops3cret@127.0.0.1:1/db",
        "postgresql://me@127.0.0.1:1/db?password=tops3cret",
        "postgresql://me@127.0.0.1:1/db?sslpassword=tops3cret",
        "postgresql://me:x@127.0.0.1:tops3cret/db",
        "postgresql://me:tops3cret@[::1/db",
        "tops3cret",
        "mysql://me:tops3cret@127.0.0.1:1/db",
    ],
)
def test_a_password_is_never_said(tmp_path, capsys, monkeypatch, url):
    study = small_study(tmp_path / "s")
    for arguments in (["status"], ["data"], ["serve", "--check"]):
        monkeypatch.delenv("POURCAST_DATABASE", raising=False)
        assert call(*arguments, study, "--database", url) in (1, 2)
        direct = capsys.readouterr()
        monkeypatch.setenv("POURCAST_DATABASE", url)
        assert call(*arguments, study) in (1, 2)
        by_variable = capsys.readouterr()
        assert "tops3cret" not in direct.out + direct.err + by_variable.out + by_variable.err
        assert "note:" not in by_variable.err
        if url.startswith("postgresql://me:tops3cret@1"):
            assert "note: others on this computer can read the password" in direct.err


def test_what_the_database_complains_of_quotes_nobody(storage):
    """PostgreSQL quotes the values that it refuses."""
    arrival = Arrival("request-1", "prolific", {"PROLIFIC_PID": "5f0secret"}, "", "code-1")
    where = {"groups": 1, "places": None, "largest_gap": 9.0, "now": 1.0}
    session, _, _ = storage.begin(arrival, lambda *_: (), **where)
    with (
        pytest.raises(StoreError, match=r"(?i)unique") as failure,
        storage._transaction(writes=True) as connection,
    ):
        row = connection.execute(sa.select(SESSIONS)).mappings().one()
        connection.execute(SESSIONS.insert().values(**{**row, "id": row["id"] + 1}))
    hidden = ("5f0secret", "request-1", session.key)
    assert [word for word in hidden if word in str(failure.value)] == []


def test_a_journal_that_two_write_has_one_private_file(tmp_path, umask):
    journals = [Journal.of_study(tmp_path) for _ in range(4)]
    threads = [threading.Thread(target=one.remove, args=(lambda _: False,)) for one in journals]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(mode(path) == 0o600 for path in tmp_path.iterdir())


def test_nothing_that_is_said_while_people_take_part_names_them_or_opens_anything(
    tmp_path, caplog, capsys, monkeypatch
):
    caplog.set_level("DEBUG")
    study = small_study(tmp_path / "s")

    def full(*_):
        raise OSError(28, "No space left on device")

    with api_of(study) as api:
        link = {"PROLIFIC_PID": "5f0secret", "STUDY_ID": "st-1", "SESSION_ID": "se-1"}
        told = api.begin("request-secret", link=link).json()
        monkeypatch.setattr("pourcast.experiment.storage.journal._append", full)
        for body in (answer("consent"), {"rt": "x-secret"}):
            api.put(told, 0, body)
        api.put({"token": "x" * 43}, 0, answer("consent"))
        api.client.get("/admin?token=wrong")
        api.client.get(f"/admin?token={api.storage.admin_token}")
        hidden = (
            "secret", told["token"], told["code"], told["participant"], told["key"],
            api.storage.admin_token, api.storage.secret.hex(),
        )  # fmt: skip
    assert "cannot be written" in caplog.text
    # The client of these tests logs what it asks for; a server doesn't.
    ours = [one.getMessage() for one in caplog.records if not one.name.startswith("http")]
    said = "\n".join(ours) + "".join(capsys.readouterr())
    assert [word for word in hidden if word in said] == []
