"""How fast this machine simulates, and how long the paper's grid of simulations takes on it."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.engine.batch import available_cores, run_batch
from pourcast.engine.job import Job, Stepping
from pourcast.engine.packing import pack_cylinder, reference_density, spacing_of
from pourcast.engine.polygons import Solids, pack_solids
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene import Scene
from pourcast.simulation.settings import EngineSettings, Kind
from pourcast.study.experiments.base import Experiment
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.selection import filtered_scenes
from pourcast.sweep.estimate import in_words, measure, parts_of
from pourcast.sweep.grid import experiment_grid
from pourcast.sweep.plan import make_plan

COUNTS = (25, 50, 75, 100, 200)
BATCH = 64
DURATION = 4.0
"""Simulated time of a benchmark run [s]: 20,000 steps of the paper."""
PAPER_STEP = 2e-4

_DEPTH = 0.148
_REPEATS = 2


# Speed -------------------------------------------------------------------------------


def obstacle_courses(count: int) -> Solids:
    """Solids of `count` scenes of seven random polygons and a divider."""
    rng = np.random.default_rng(0)

    def polygon() -> NDArray[np.float64]:
        sides = rng.integers(3, 8)
        angles = rng.uniform(0.0, 6.0) + 2 * np.pi * np.arange(sides) / sides
        centre, radius = rng.uniform((0.1, 0.4), (0.9, 1.1)), rng.uniform(0.05, 0.09)
        corners: NDArray[np.float64] = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return centre + corners

    divider = np.array([[0.45, 0.0], [0.55, 0.0], [0.5, 0.2]])
    return pack_solids(
        [[(polygon(), False) for _ in range(7)] + [(divider, True)] for _ in range(count)]
    )


def undamped_jobs(n_particles: int, batch: int = BATCH) -> list[Job]:
    """Jobs of undamped water, one in each obstacle course, that run for `DURATION`."""
    settings = EngineSettings()
    spacing = spacing_of(n_particles, _DEPTH / 2, _DEPTH)
    support = settings.support_in_spacings * spacing
    position = pack_cylinder(n_particles, (0.5, 1.35), _DEPTH / 2, _DEPTH)
    one = Job(
        position=position,
        scene=0,
        width=1.0,
        height=1.5,
        depth=_DEPTH,
        radius=spacing / 2,
        support_radius=support,
        reference_density=reference_density(position, support, _DEPTH),
        sound_speed=settings.sound_speed,
        viscosity_alpha=WATER.viscosity_alpha,
        damping=0.0,
        duration=DURATION,
    )
    return [replace(one, scene=k) for k in range(batch)]


def speed(n_particles: int, kind: Kind, stepping: Stepping, threads: int) -> float:
    """Simulations of `DURATION` per second, contacts included; the better of two runs.

    Parameters
    ----------
    n_particles
        Number of particles.
    kind
        SPH liquid or rigid marbles.
    stepping
        Time step.
    threads
        Worker threads.
    """
    solids, jobs = obstacle_courses(BATCH), undamped_jobs(n_particles)
    # Once for the compiler.
    run_batch([replace(jobs[0], duration=1e-3)], solids, stepping, kind=kind, threads=1)
    seconds = []
    for _ in range(_REPEATS):
        start = time.perf_counter()
        run_batch(jobs, solids, stepping, kind=kind, threads=threads)
        seconds.append(time.perf_counter() - start)
    return BATCH / min(seconds)


def speed_table(counts: Sequence[int] = COUNTS, report: Report = no_report) -> pd.DataFrame:
    """Speed of liquid and marbles by number of particles, on one core and on all.

    Parameters
    ----------
    counts
        Numbers of particles.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        Indexed by `kind` (liquid at the paper's step, liquid at the default step, marbles)
        and `N`; columns: `all cores / one` and simulations of 4 s per second.
    """
    settings, cores = EngineSettings(), available_cores()
    rows = []
    paper = replace(settings, step=PAPER_STEP)
    kinds: dict[str, tuple[Kind, EngineSettings]] = {
        "liquid, 2e-4 s": ("liquid", paper),
        "liquid": ("liquid", settings),
        "marbles": ("marbles", settings),
    }
    cases = [(label, count) for label in kinds for count in counts]
    for done, (label, count) in enumerate(cases):
        report(f"{label}, N = {count}", done, len(cases))
        kind, used = kinds[label]
        spacing = spacing_of(count, _DEPTH / 2, _DEPTH)
        stepping = used.stepping(kind, spacing, WATER.viscosity_alpha)
        one, every = (speed(count, kind, stepping, threads) for threads in (1, cores))
        rows.append(
            {
                "kind": label,
                "N": count,
                "step [ms]": 1e3 * stepping.step,
                "all cores / one": every / one,
                "one core [1/s]": one,
                f"{cores} cores [1/s]": every,
            }
        )
    return pd.DataFrame(rows).set_index(["kind", "N"])


# The paper's grid --------------------------------------------------------------------

PAPER = ("exp1", "exp2")
"""The paper's experiments, whose grids are measured."""


def plan_table(share: float = 0.05, seed: int = 0, report: Report = no_report) -> pd.DataFrame:
    """Time that the paper's grids take on this machine, from running a random share of each part.

    Parameters
    ----------
    share
        Share of each part that is run, 0..1; at least 64 settings in scenes.
    seed
        Source of the scenes and of the choice.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        A row per part: simulations in all and run, and minutes for all of them.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for experiment in map(EXPERIMENTS.get, PAPER):
        grid = experiment_grid(experiment)
        name, plan = grid.name, make_plan(grid, _grid_scenes(experiment, seed))
        parts = parts_of(plan, plan.shards)
        for done, part in enumerate(parts):
            label = f"{name}: {in_words(part.group)}"
            report(label, done, len(parts))
            count = max(BATCH, round(share * part.pairs))
            measure(plan, part, 1, rng, threads=1)  # For the compiler.
            run, seconds, _ = measure(plan, part, count, rng, threads=available_cores())
            minutes = seconds / run * part.simulations / 60
            row = {"part": label, "simulations": part.simulations, "run": run, "minutes": minutes}
            rows.append(row)
    return pd.DataFrame(rows).set_index("part")


def _grid_scenes(experiment: Experiment, seed: int) -> list[Scene]:
    """As many scenes as the experiment has; without its choice among them, which costs the same."""
    count, family = experiment.scene_count, experiment.family
    return filtered_scenes(family, count, seed, rule=experiment.choice.rule).scenes
