"""What was acknowledged is never lost, doubled, or under another's name, whatever goes wrong."""

import json
import os
import random
import shutil
from collections import Counter
from contextlib import ExitStack, nullcontext

import pytest
from hypothesis import HealthCheck, seed, settings
from hypothesis.stateful import run_state_machine_as_test

from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import fresh_database
from tests.experiment.make import small_study
from tests.experiment.server_process import ServerProcess
from tests.experiment.walk import DESIGN, Walk
from tests.experiment.walk_threads import Meter, Wanderer

SEEDS = range(int(os.environ.get("POURCAST_WALK_SEEDS", "1")))
"""Seeds of the long walks; so many as the environment says."""


@pytest.fixture(scope="session")
def template(tmp_path_factory):
    return small_study(tmp_path_factory.mktemp("walk"), scenes=2, design=DESIGN)


def walk(template, database, *, walks, steps, chosen=None):
    """Walk, so many times so many steps; None for a seed that is the same each time."""
    tally = Counter()
    content = {"template": template, "database": staticmethod(database), "tally": tally}
    machine = type("Walk", (Walk,), content)
    if chosen is not None:
        machine = seed(chosen)(machine)
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=walks, stateful_step_count=steps, derandomize=chosen is None,
            database=None, deadline=None, suppress_health_check=list(HealthCheck),
        ),
    )  # fmt: skip
    print(f"walk: {tally['steps']} steps in {tally['walks']} walks, seed {chosen}")
    assert tally["steps"] >= 0.8 * walks * steps


def test_nothing_acknowledged_is_lost_doubled_or_under_anothers_name(template):
    walk(template, nullcontext, walks=5, steps=45)


@pytest.mark.parametrize("chosen", SEEDS)
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
@pytest.mark.parametrize(
    "walks", [pytest.param(5, marks=pytest.mark.slow), pytest.param(21, marks=pytest.mark.study)]
)
def test_nothing_is_lost_in_walks_of_a_hundred_steps(request, template, kind, chosen, walks):
    def database():
        if kind == "sqlite":
            return nullcontext()
        return fresh_database(request.getfixturevalue("postgresql"))

    walk(template, database, walks=walks, steps=100, chosen=chosen)


@pytest.mark.parametrize(
    "requests",
    [pytest.param(110, marks=pytest.mark.slow), pytest.param(250, marks=pytest.mark.study)],
)
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_nothing_is_lost_when_the_real_server_is_killed_while_several_answer(
    request, tmp_path, template, kind, requests
):
    study = shutil.copytree(template, tmp_path / "study")
    with ExitStack() as resources:
        url = None
        if kind == "postgresql":
            server = request.getfixturevalue("postgresql")
            url = resources.enter_context(fresh_database(server))
        options = [] if url is None else ["--database", url]
        meter, kills, moments = Meter(), 0, random.Random(1)
        with ServerProcess(study, *options) as process:
            lab = {"lab": process.lab.rpartition("=")[2]}
            people = [Wanderer(process.port, lab if k % 2 else None, k, requests, meter)
                      for k in range(8)]  # fmt: skip
            for someone in people:
                someone.start()

            def going_on():
                return any(someone.is_alive() for someone in people)

            while going_on():
                meter.wait_for(meter.count + moments.randint(60, 200), going_on)
                process.kill()
                process.start()
                kills += 1
            assert [someone.error for someone in people] == [None] * len(people)
        print(f"walk: {meter.count} requests of {len(people)} people, {kills} kills, {kind}")
        assert meter.count >= len(people) * requests
        check_visits(study, url, [visit for someone in people for visit in someone.visits])


def check_visits(study, url, visits):
    """The study has what each participant was told, and nothing that nobody sent."""
    storage = Storage.of_study(study, url)
    sessions = {one.key: one for one in storage.sessions()}
    told = {visit.key: visit for visit in visits}
    assert sessions.keys() == {key for key, visit in told.items() if visit.end != "declined"}
    numbers = {one.number: one.key for one in sessions.values()}
    records = {(numbers[one.session], one.seq): one.body for one in storage.records()}
    for key, session in sessions.items():
        assert (session.state, session.code) == (told[key].end, told[key].code)
        assert session.request == told[key].request
        assert [step.for_participant() for step in session.steps] == told[key].steps
    assert records.keys() == {(key, seq) for key in sessions for seq in told[key].told}
    for (key, seq), body in records.items():
        assert told[key].told[seq].items() <= json.loads(body).items()
    aside = Counter((numbers[one.session], one.seq, json.loads(one.body)["rt"])
                    for one in storage.conflicts())  # fmt: skip
    assert aside == Counter(
        (visit.key, seq, body["rt"])
        for visit in visits
        for seq, bodies in visit.aside.items()
        for body in bodies
    )
    assert Journal.of_study(study).missing(storage.journal_lines()) == []
    storage.close()
