"""Who declined leaves nothing behind in the study folder, whatever ends the server meanwhile."""

import random
import subprocess
import sys
import threading
import uuid
from contextlib import closing

import pytest

from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.data.tables import participants_table
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import api_of
from tests.experiment.make import small_study
from tests.experiment.server_process import ServerProcess, Sturdy


def files_with(folder, names):
    """Plain bytes of all files, the write-ahead log's too: what has one of the names?"""
    return sorted(
        f"{path.relative_to(folder)}: {name}"
        for path in folder.rglob("*")
        if path.is_file() and "stimuli" not in path.parts
        for name in names
        if name.encode() in path.read_bytes() or name in path.name
    )


class Decliner(Sturdy):
    """People who come, one after another, read the first page, and decline; each is sure of it."""

    def __init__(self, port, number, count):
        super().__init__(port, "=", number)
        self.count = count
        self.names = []

    def take_part(self):
        for _ in range(self.count):
            begin = {
                "request": f"request-{uuid.uuid4().hex}",
                "tab": f"tab-{uuid.uuid4().hex}",
                "link": {"PROLIFIC_PID": uuid.uuid4().hex[:24], "STUDY_ID": "s", "SESSION_ID": "s"},
            }
            told = self.ask("POST", "/api/sessions", begin)
            self.names += [
                begin["request"], begin["tab"], begin["link"]["PROLIFIC_PID"],
                told["participant"], told["key"], told["token"],
            ]  # fmt: skip
            end = {"state": "declined", "tab": begin["tab"]}
            self.ask("POST", "/api/session/finish", end, told["token"])


def decline_and_kill(study, seed, people, each, kills):
    moments = random.Random(seed)
    with ServerProcess(study) as server:
        # Others stay, so that the files are not simply empty.
        stays = Sturdy(server.port, server.lab, 0)
        stays.take_part()
        decliners = [Decliner(server.port, number, each) for number in range(1, people + 1)]
        for one in decliners:
            one.start()
        enough = threading.Event()
        for _ in range(kills):
            enough.wait(0.02 + 0.4 * moments.random())
            server.kill()
            server.start()
        for one in decliners:
            one.join(120)
            assert not one.is_alive()
            if one.error:
                raise one.error
        names = [name for one in decliners for name in one.names]
        assert len(names) == 6 * people * each
        while_served = files_with(study, names)
        server.kill()
        killed = files_with(study, names)
    with closing(Storage.of_study(study)) as storage:
        assert [one.participant for one in storage.sessions()] == [stays.participant]
        assert len(storage.records()) == 14
    return while_served, killed


def test_declined_people_leave_nothing_behind_after_kills(tmp_path):
    study = small_study(tmp_path / "s")
    assert decline_and_kill(study, 1, people=3, each=4, kills=1) == ([], [])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_declined_people_leave_nothing_behind_after_many_kills(tmp_path, seed):
    study = small_study(tmp_path / "s")
    assert decline_and_kill(study, 10 + seed, people=6, each=25, kills=10) == ([], [])


KILLED_AT = """
import asyncio, os, signal, sys
from pathlib import Path
from pourcast.experiment.design.links import visitor
from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.data.tables import participants_table
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage

study, owner, stage, when, pid = sys.argv[1:]
storage = Storage.of_study(Path(study))
experiment = LiveExperiment(Path(study), storage)
who = visitor({"PROLIFIC_PID": pid, "STUDY_ID": "s", "SESSION_ID": "s"}, storage.secret)

def kill(*_, **__):
    os.kill(os.getpid(), signal.SIGKILL)

async def decline():
    session, token = await experiment.begin(who, "request-to-decline", "tab-to-decline", "")
    print(session.key, token, flush=True)
    cls = {"Storage": Storage, "Journal": Journal, "Path": Path}[owner]
    original = getattr(cls, stage)
    def after(*arguments, **options):
        original(*arguments, **options)
        kill()
    setattr(cls, stage, kill if when == "before" else after)
    await experiment.finish(token, "declined", "tab-to-decline")

asyncio.run(decline())
"""

MOMENTS = [
    ("Path", "replace", "before"), ("Storage", "delete", "after"),
    *(pytest.param(*moment, marks=pytest.mark.slow) for moment in (
        ("Storage", "finish", "after"), ("Journal", "remove", "before"), ("Path", "replace", "after"),
        ("Storage", "delete", "before"), ("Storage", "forget_log", "after"),
    )),
]  # fmt: skip


@pytest.mark.parametrize(("owner", "stage", "when"), MOMENTS)
def test_the_next_start_does_what_a_kill_left_undone(tmp_path, owner, stage, when):
    study = small_study(tmp_path / "s", scenes=2)
    with api_of(study) as api:
        api.run(api.begin().json())
    pid = uuid.uuid4().hex[:24]
    command = [sys.executable, "-c", KILLED_AT, str(study), owner, stage, when, pid]
    result = subprocess.run(command, check=False, capture_output=True, text=True)
    assert result.returncode == -9, result.stderr
    names = [pid, "request-to-decline", "tab-to-decline", *result.stdout.split()]
    storage = Storage.of_study(study)
    with closing(LiveExperiment(study, storage)):
        assert files_with(study, names) == []
        assert len(storage.sessions()) == 1


def test_a_reader_who_held_the_log_up_does_so_for_a_moment_only(tmp_path):
    study = small_study(tmp_path / "s", scenes=2)
    pid = uuid.uuid4().hex[:24]
    with api_of(study) as api:
        told = api.begin(
            link={"PROLIFIC_PID": pid, "STUDY_ID": "s", "SESSION_ID": "s"}, tab="tab-to-decline"
        ).json()
        names = [pid, told["key"], "tab-to-decline"]
        with api.storage.engine.connect() as reader:
            reader.exec_driver_sql("SELECT count(*) FROM sessions").fetchall()
            said = api.post(told, "finish", state="declined", tab="tab-to-decline")
            assert said.status_code == 200
            assert files_with(study, names) != []
        until = threading.Event()
        for _ in range(100):
            if files_with(study, names) == []:
                break
            until.wait(0.1)
        assert files_with(study, names) == []


def test_who_declined_is_in_no_table_before_the_server_starts_again(tmp_path):
    study = small_study(tmp_path)
    with api_of(study) as api:
        link = {"PROLIFIC_PID": "person-5f0a", "STUDY_ID": "s", "SESSION_ID": "s"}
        told = api.begin("request-2", link=link).json()
        api.run(api.begin().json())
    with closing(Storage.of_study(study)) as storage:
        storage.finish(told["token"], "declined", "tab-00000001")  # and the server is killed
        assert len(participants_table(storage, identifiers=True)) == 1
        seen = study_overview(study, storage, 1_700_000_000.0)
        assert list(seen.states.columns) == ["complete"]
