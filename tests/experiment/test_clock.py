"""A machine's clock that jumps by days drops nobody, brings nobody back, and refuses nobody."""

import time

import pytest

from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.server.clock import RunningClock, even_clock
from pourcast.experiment.storage.sessions import Refusal
from pourcast.experiment.storage.storage import study_storage
from tests.experiment.conftest import api_of
from tests.experiment.make import EXP1, answer, small_study
from tests.experiment.server_process import Asker, ServerProcess
from tests.experiment.test_storage import begin

DAYS = 5 * 86400.0


class Machine:
    """A machine with a clock that somebody sets, and the time that really goes by."""

    def __init__(self):
        self.wall, self.even = 1_700_000_000.0, 50.0

    def pass_by(self, seconds):
        self.wall += seconds
        self.even += seconds

    def start(self):
        return RunningClock(lambda: self.wall, lambda: self.even)


def serving(machine, study):
    return api_of(study, clock=machine.start())


def states(api):
    return [one.state for one in api.storage.sessions()]


def test_a_running_clock_goes_on_evenly():
    machine = Machine()
    clock = machine.start()
    assert clock() == 1_700_000_000.0
    machine.wall += DAYS
    machine.even += 2.5
    assert clock() == 1_700_000_002.5
    machine.wall -= 3 * DAYS
    assert clock() == 1_700_000_002.5


def test_the_clock_of_a_server_says_the_time():
    assert abs(RunningClock()() - time.time()) < 5.0
    first, second = even_clock(), even_clock()
    assert second >= first


@pytest.mark.parametrize("jump", [DAYS, -DAYS])
def test_a_jump_of_the_clock_drops_nobody_while_it_runs(tmp_path, jump):
    machine, study = Machine(), small_study(tmp_path, design=f"places = 1\n{EXP1}")
    with serving(machine, study) as api:
        told = api.begin().json()
        api.put(told, 0, answer("consent"))
        machine.wall += jump
        machine.pass_by(10.0)
        # The place is theirs, whoever comes.
        assert api.begin("request-2").json()["refused"] == "full"
        assert states(api) == ["open"]
        assert api.post(told, "resume", tab="tab-00000002").json()["done"] == [0]
        assert api.put(told, 1, answer("check")).json()["saved"] == "new"
        # And stamps are of one clock.
        assert [r.received - 1_700_000_000.0 for r in api.storage.records()] == [0.0, 10.0]


@pytest.mark.parametrize("jump", [DAYS, -DAYS])
def test_a_jump_of_the_clock_keeps_nobodys_place_for_ever(tmp_path, jump):
    machine, study = Machine(), small_study(tmp_path, design=f"places = 1\n{EXP1}")
    with serving(machine, study) as api:
        api.begin()
        machine.wall += jump
        machine.pass_by(7199.0)
        assert api.begin("request-2").status_code == 403
        machine.pass_by(2.0)
        assert api.begin("request-2").status_code == 201
        assert states(api) == ["dropped", "open"]


@pytest.mark.parametrize("jump", [DAYS, -DAYS])
def test_a_jump_of_the_clock_while_no_server_runs_drops_nobody_either(tmp_path, jump):
    machine, study = Machine(), small_study(tmp_path, design=f"places = 1\n{EXP1}")
    with serving(machine, study) as api:
        told = api.begin().json()
    machine.wall += jump
    machine.pass_by(60.0)
    with serving(machine, study) as api:
        machine.pass_by(7000.0)
        assert api.begin("request-2").json()["refused"] == "full"
        assert api.post(told, "resume", tab="tab-00000001").status_code == 200
        machine.pass_by(7201.0)
        # The clock before may have been ahead: the place is free all the same.
        assert api.begin("request-2").status_code == 201
        assert api.post(told, "resume", tab="tab-00000001").json()["refused"] == "late"


def test_who_answered_within_the_gap_is_never_refused(tmp_path):
    machine, study = Machine(), small_study(tmp_path, design=f"places = 1\n{EXP1}")
    with serving(machine, study) as api:
        told = api.begin().json()
        for seq, step in enumerate(told["steps"]):
            machine.pass_by(7199.0)
            machine.wall += DAYS if seq % 2 else -DAYS
            assert api.begin(f"request-{seq + 2}").status_code in (403, 429)
            assert api.put(told, seq, answer(step["kind"])).json()["saved"] == "new"
        assert api.post(told, "finish", state="complete").json()["missing"] == []


def test_status_tells_who_seems_to_be_away_and_changes_nothing(tmp_path):
    machine, study = Machine(), small_study(tmp_path)
    with serving(machine, study) as api:
        told = api.begin().json()
        with study_storage(study, None) as storage:
            # In a process of its own, whose clock is days ahead.
            seen = study_overview(study, storage, machine.wall + DAYS)
            assert list(seen.states.columns) == ["dropped"]
            assert list(study_overview(study, storage, machine.wall).states.columns) == ["open"]
        assert states(api) == ["open"]
        assert api.post(told, "resume", tab="tab-00000001").status_code == 200


def test_a_drop_out_who_comes_back_takes_nobodys_place(storage):
    """In both databases: there is room as long as the group is not full."""
    first, token, _ = begin(storage, "r1", now=0.0, places=2, gap=100.0)
    begin(storage, "r2", now=200.0, places=2, gap=100.0)
    assert [(one.place, one.state) for one in storage.sessions()] == [(0, "dropped"), (0, "open")]
    rules = {"places": 2, "largest_gap": 1000.0, "now": 210.0}
    assert storage.resume(token, "tab-1", **rules).state == "open"
    assert storage.sessions()[0].tab == "tab-1"
    # Two have a place now, and the group takes no third.
    with pytest.raises(Refusal, match="full"):
        begin(storage, "r3", now=220.0, places=2, gap=1000.0)
    storage.end(2, "complete")
    storage.drop_stale(100.0, 1000.0)
    begin(storage, "r4", now=1000.0, places=2, gap=100.0)
    with pytest.raises(Refusal, match="late"):
        storage.resume(token, None, **rules)
    assert storage.session_of(token).state == "dropped"
    assert not storage.reopen(first.number, 2, 1000.0)
    assert storage.reopen(first.number, None, 1000.0)
    assert storage.resume("nonsense", None, **rules) is None


JUMPING = """
import sys, time
from pathlib import Path
really, jump = time.time, Path(sys.argv.pop(1))
time.time = lambda: really() + float(jump.read_text())
from pourcast.cli import main
main()
"""
"""The server on a machine whose clock is set by a file."""


@pytest.mark.slow
def test_a_real_server_whose_clock_jumps_by_days(tmp_path):
    design = f"places = 1\nlargest_gap = 5.0\n{EXP1}"
    study, jump = small_study(tmp_path, design=design), tmp_path / "jump"
    told = None

    def set_clock(days):
        # As a whole: the server reads it all the time.
        (tmp_path / "next").write_text(str(days * 86400))
        (tmp_path / "next").replace(jump)

    set_clock(0)
    with ServerProcess(study, run=("-c", JUMPING, str(jump))) as server:
        for days in (5, -5, 400):
            set_clock(days)
            page = Asker(server)
            told = told or page.begin("request-1")
            refused = {"request": "request-2", "tab": "tab-00000002", "link": {"lab": page.key}}
            assert page.ask("POST", "/api/sessions", refused)[1]["refused"] == "full"
            assert page.resume(told)[0] == 200
            server.kill()
            server.start()
        assert page.resume(told)[0] == 200
        time.sleep(5.5)
        assert page.ask("POST", "/api/sessions", refused)[0] == 201
        assert page.resume(told)[1]["refused"] == "late"
