"""What all tests share: fixtures, and how tests share a machine."""

import os

import pytest
from hypothesis import HealthCheck, settings

from pourcast.scenes.scene import Scene
from pourcast.simulation import run
from pourcast.simulation.memory import REMEMBERED
from pourcast.simulation.pour import Pour
from tests.make import ramp_scene

LONG = ("tests/test_docs.py", "tests/networks/test_commands.py", "tests/e2e/test_slurm.py")
"""Files of long tests: begun first, so that no worker is left alone with one at the end."""

# One test a core: threads of linear algebra that wait for one another, spinning, took nine
# tenths of the time of networks' tests. Processes that tests start inherit it.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# How long an example takes, says nothing of the code where many tests share a machine.
settings.register_profile("shared", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: not item.nodeid.startswith(LONG))


@pytest.fixture
def ramp() -> Scene:
    return ramp_scene()


@pytest.fixture(autouse=True)
def _nothing_remembered() -> None:
    """No test finds what another has poured."""
    REMEMBERED.forget_all()


@pytest.fixture
def poured(monkeypatch: pytest.MonkeyPatch) -> list[list[Pour]]:
    """Pours that are run from now on: a list for each call of `simulate`."""
    calls: list[list[Pour]] = []
    simulate = run.simulate

    def watched(pours, **options):
        calls.append(list(pours))
        return simulate(pours, **options)

    monkeypatch.setattr(run, "simulate", watched)
    return calls
