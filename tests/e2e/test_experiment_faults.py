"""What goes wrong in the world: no judgment is lost, and none is there twice.

A real server in a process of its own, participants in a real browser and over HTTP.
Needs Chromium; run with `pytest -m slow`.
"""

import contextlib
import json
import os
import random
import shutil
import subprocess
import threading
import time

import pytest

from pourcast import cli
from pourcast.experiment.data.tables import trials_table
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_lines import FORMAT
from pourcast.experiment.storage.storage import Storage
from tests.e2e.participant import Participant
from tests.experiment.make import EXP1, EXP2, small_study
from tests.experiment.server_process import CuttingProxy, ServerProcess, Sturdy

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("chromium") is None, reason="there is no Chromium"),
]

ONE_BLOCK = EXP1 + "blocks = 1\n"


def check(study, people=(), browsers=()):
    """All that was answered is in database and journal, once, as it was answered, in order."""
    storage = Storage.of_study(study)
    records = [record for record in storage.records() if record.kind == "judgment"]
    sessions = {one.participant: one for one in storage.sessions()}
    for person in people:
        assert person.error is None, person.error
        number = sessions[person.participant].number
        found = {r.seq: json.loads(r.body)["response"] for r in records if r.session == number}
        assert found == person.answers
        assert sessions[person.participant].state == "complete"
    rest = [one for name, one in sessions.items() if name not in {p.participant for p in people}]
    assert len(rest) == len(browsers)
    for session, someone in zip(rest, browsers, strict=True):
        found = [json.loads(r.body)["response"] for r in records if r.session == session.number]
        assert found == pytest.approx(someone.answers, abs=0.004)
        assert session.state == "complete"
        assert storage.saved_steps(session.number) == list(range(len(session.steps)))
    assert storage.conflicts() == []
    # The journal's lines of records, and those that open sessions.
    written = sorted(
        (line["session"], line.get("seq", -1))
        for line in Journal.of_study(study).lines()
        if "seq" in line or line.get("format") == FORMAT
    )
    keys = {one.number: one.key for one in sessions.values()}
    kept = [(keys[r.session], r.seq) for r in storage.records()]
    kept += [(key, -1) for key in keys.values()]
    assert written == sorted(kept)
    table = trials_table(storage)
    assert not table.duplicated(["participant", "phase", "trial"]).any()
    storage.close()
    return len(table)


def test_a_server_that_is_killed_ten_times_loses_nothing(tmp_path, browser):
    study = small_study(tmp_path, scenes=40, design=ONE_BLOCK)
    rng = random.Random(1)
    over = threading.Event()
    kills = []
    with ServerProcess(study) as server:

        def murder():
            while len(kills) < 10 and not over.is_set():
                time.sleep(rng.uniform(0.3, 1.5))
                server.kill()
                kills.append(time.monotonic())
                server.start()

        people = [Sturdy(server.port, server.lab, k, pause=0.6) for k in range(8)]
        someone = Participant(browser, server.lab)
        someone.begin()
        for person in people:
            person.start()
        murderer = threading.Thread(target=murder)
        murderer.start()
        someone.go_on()
        for person in people:
            person.join(120)
        over.set()
        murderer.join()
        someone.check(allow=["Failed to load resource", "ERR_"])
        someone.close()
    assert len(kills) == 10
    assert check(study, people, [someone]) == 9 * 41


def test_a_minute_without_a_network_in_the_middle_of_a_block(tmp_path, browser):
    study = small_study(tmp_path, scenes=30, design=ONE_BLOCK)
    with ServerProcess(study) as server:
        someone = Participant(browser, server.lab)
        someone.begin()
        someone.go_on(stop_at=6)
        someone.page.wait_for_timeout(1000)  # the block's pictures are there
        someone.context.set_offline(True)
        gone = time.monotonic()
        someone.go_on(stop_at=26)
        saved = len(
            [line for line in Journal.of_study(study).lines() if line.get("kind") == "judgment"]
        )
        assert saved <= 7
        someone.page.wait_for_timeout(max(0.0, 60_000 - 1000 * (time.monotonic() - gone)))
        someone.context.set_offline(False)
        someone.go_on()
        someone.check(allow=["Failed to load resource", "ERR_"])
        someone.close()
    assert check(study, browsers=[someone]) == 31


def test_who_is_offline_to_the_end_gets_a_code_and_a_file_that_completes_the_study(
    tmp_path, browser
):
    study = small_study(tmp_path, scenes=6, design=ONE_BLOCK)
    with ServerProcess(study) as server:
        someone = Participant(browser, server.lab, accept_downloads=True)
        someone.begin()
        someone.go_on(stop_at=3)
        someone.page.wait_for_timeout(500)
        someone.context.set_offline(True)
        someone.go_on()
        assert someone.page.get_attribute("#page", "data-state") == "offline"
        code = someone.page.inner_text(".code")
        with someone.page.expect_download() as download:
            someone.page.get_by_role("link", name="Download my answers").click()
        path = tmp_path / "answers.jsonl"
        download.value.save_as(path)
        someone.close()
    arguments = ["experiment", "data", str(study), "--import", str(path)]
    assert cli.run(arguments) == 0
    storage = Storage.of_study(study)
    assert storage.sessions()[0].code == code
    storage.close()
    assert check(study, browsers=[someone]) == 7


def test_every_post_twice_and_some_cut_half_way(tmp_path, browser):
    study = small_study(tmp_path, "exp2", scenes=12, design=EXP2)
    with ServerProcess(study) as server:
        # The issue asks for one in a hundred; so few trials need more.
        proxy = CuttingProxy(server.port, 0.1)
        lab = server.lab.replace(str(server.port), str(proxy.port))
        people = [Sturdy(proxy.port, lab, k) for k in range(6)]
        for person in people:
            person.start()
        someone = Participant(browser, lab)

        def twice(route):
            with contextlib.suppress(Exception):  # cut: the second one is as good
                route.fetch()
            route.continue_()

        someone.page.route("**/api/session/records/*", twice)
        someone.begin()
        someone.go_on()
        for person in people:
            person.join(120)
        someone.close()
        assert min(proxy.cuts.values()) >= 5
        proxy.close()
    assert check(study, people, [someone]) == 7 * 25


def test_a_clock_that_is_set_back_in_the_middle(tmp_path, browser):
    study = small_study(tmp_path, scenes=6, design=ONE_BLOCK)
    with ServerProcess(study) as server:
        someone = Participant(browser, server.lab)
        someone.begin()
        someone.go_on(stop_at=3)
        someone.page.evaluate(
            "() => { const real = Date.now; Date.now = () => real() - 86400000; }"
        )
        someone.go_on()
        someone.check()
        someone.close()
    assert check(study, browsers=[someone]) == 7
    storage = Storage.of_study(study)
    assert (trials_table(storage)["rt"] > 0).all()
    storage.close()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="mounting needs root")
def test_a_disk_that_is_full_loses_nothing_when_there_is_room_again(tmp_path, browser):
    disk = tmp_path / "disk"
    disk.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "none", disk], check=False)
    if done.returncode:
        pytest.skip("nothing can be mounted here")
    try:
        study = small_study(disk / "s", scenes=24, design=ONE_BLOCK)
        with ServerProcess(study) as server:
            people = [Sturdy(server.port, server.lab, k, pause=0.2) for k in range(4)]
            someone = Participant(browser, server.lab)
            someone.begin()
            for person in people:
                person.start()
            someone.go_on(stop_at=4)
            filler = disk / "filler"
            with pytest.raises(OSError, match="No space left"), filler.open("wb") as stream:
                while True:
                    stream.write(bytes(4096))
                    stream.flush()
            someone.go_on(stop_at=16)
            time.sleep(3.0)
            full = len(list(Journal.of_study(study).lines()))
            time.sleep(2.0)
            assert len(list(Journal.of_study(study).lines())) == full, "the disk was not full"
            filler.unlink()
            someone.go_on()
            for person in people:
                person.join(120)
            someone.check(allow=["503", "Failed to load resource"])
            someone.close()
        assert check(study, people, [someone]) == 5 * 25
    finally:
        subprocess.run(["umount", disk], check=True)


@pytest.mark.parametrize(("kind", "design", "count"), [("exp1", EXP1, 120), ("exp2", EXP2, 60)])
def test_an_experiment_of_the_papers_size_from_consent_to_the_end(
    tmp_path, browser, kind, design, count
):
    study = small_study(tmp_path, kind, scenes=count, design=design)
    with ServerProcess(study) as server:
        someone = Participant(browser, server.lab)
        someone.begin()
        seen = someone.go_on()
        someone.check()
        someone.close()
    block = ["trial"] * 40
    pause = ["Time for a break"]
    practice = ["trial", "film", "The practice is over"]
    assert seen == [*practice, *block, *pause, *block, *pause, *block, "debrief"]
    assert check(study, browsers=[someone]) == 121
