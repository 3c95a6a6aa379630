"""What tests of sweeps are made of: a small study, a small grid, an executor of two lines."""

from pathlib import Path

from pourcast.scenes.scene_file import write_scenes
from pourcast.sweep.grid import Grid, parse_grid
from pourcast.sweep.plan import Plan, make_plan
from pourcast.sweep.run import run_sweep
from pourcast.sweep.shard import run_shard
from pourcast.sweep.store import Store
from tests.make import random_scenes

SMALL = """
shard_seconds = 0.02

[[models]]
model = "ife"
liquids = ["water", "honey"]
parameters.n_particles = [15, 20]
parameters.damping_zeta = { from = 4, to = 8, step = 2 }
parameters.zeta_sigma = [0, 1]

[[models]]
model = "marble"
parameters = { n_particles = 15, damping_zeta = 3, zeta_sigma = 1 }

[[models]]
model = "simple"
seeds = [0, 1]
parameters.g = { from = 0, to = 1, count = 3 }

[[models]]
model = "position-uncertainty"
liquids = ["honey"]
parameters = { n_particles = 15, n_draws = 3, damping_zeta = 6 }
"""


def small_grid(text: str = SMALL, name: str = "small") -> Grid:
    return parse_grid(text, name, f"{name}.toml")


def small_plan(count: int = 5, text: str = SMALL) -> Plan:
    return make_plan(small_grid(text), random_scenes(count, seed=31))


def small_study(folder: Path, count: int = 5) -> Path:
    study = folder / "study"
    scenes = random_scenes(count, seed=31)
    write_scenes(study / "scenes.json", scenes)
    return study


class Inline:
    """Does shards here and now; remembers which."""

    workers = 1

    def __init__(self) -> None:
        self.did: list[str] = []

    def run(self, tasks, heartbeat):
        for task in tasks:
            self.did.append(task.shard.id)
            yield run_shard(task, lambda done: heartbeat(done, 0.0))

    def close(self) -> None:
        pass


def swept(plan: Plan, folder: Path, executor=None, **options):
    """Sweep a plan into a store; result and the executor."""
    executor = executor or Inline()
    return run_sweep(plan, Store(folder), lambda: executor, **options), executor
