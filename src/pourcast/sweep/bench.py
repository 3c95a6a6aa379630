"""How many simulations this machine runs in a second, and how long the paper's grid takes on it."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.cores import available_cores
from pourcast.engine.batch import run_batch
from pourcast.engine.job import Job, Stepping
from pourcast.engine.packing import pack_cylinder, reference_density, spacing_of
from pourcast.engine.polygons import Solids, pack_solids
from pourcast.engine.simd import LANES
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

COUNTS = (25, 50, 100, 200)
BATCH = 64
DURATION = 4.0
"""Simulated time in whose simulations speed is told [s]: 20,000 steps of the paper."""
PAPER_STEP = 2e-4

MEASURED_SECONDS = 20.0
"""Time that all runs of a table take together [s]; compilation comes on top."""
RUNS = 5
_ENOUGH_SECONDS = 1.0
"""No row needs more [s]."""

_DEPTH = 0.148
_MID_POUR = 1.0
"""Time at which a pour is typical of the whole [s]: some of it in flight, some on obstacles."""


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


def mid_pour_jobs(n_particles: int, kind: Kind) -> list[Job]:
    """Jobs that fill a block, each in the middle of its pour."""
    settings = EngineSettings()
    spacing = spacing_of(n_particles, _DEPTH / 2, _DEPTH)
    stepping = settings.stepping(kind, spacing, WATER.viscosity_alpha)
    jobs = [replace(job, duration=_MID_POUR) for job in undamped_jobs(n_particles, LANES)]
    ends = run_batch(jobs, obstacle_courses(LANES), stepping, kind=kind)
    return [
        replace(job, position=end.position, velocity=end.velocity)
        for job, end in zip(jobs, ends, strict=True)
    ]


def speeds(
    jobs: Sequence[Job], kind: Kind, stepping: Stepping, threads: int, seconds: float
) -> NDArray[np.float64]:
    """Simulations of `DURATION` per second, contacts included, in several short runs.

    Parameters
    ----------
    jobs
        A block of simulations in the middle of their pours; each thread has one such.
    kind
        SPH liquid or rigid marbles.
    stepping
        Time step.
    threads
        Worker threads.
    seconds
        Time that the runs may take together [s]. A first one, of one frame, and a second, as long
        as that lets it be, say how long each may be: a frame costs less than its run. None is
        shorter than a frame, nor longer than `DURATION`.

    Returns
    -------
    array
        Shape [RUNS].
    """
    solids, filled = obstacle_courses(LANES), [*jobs] * threads

    def simulated_per_second(frames: int) -> float:
        run = [replace(job, duration=frames * stepping.frame) for job in filled]
        start = time.perf_counter()
        ends = run_batch(run, solids, stepping, kind=kind, threads=threads)
        # What has come to rest ends before the others.
        return sum(end.time for end in ends) / (time.perf_counter() - start)

    frames, share = 1, seconds / (RUNS + 2)
    for _ in range(2):
        fitting = simulated_per_second(frames) * share / (len(filled) * stepping.frame)
        frames = int(np.clip(fitting, 1, DURATION / stepping.frame))
    return np.array([simulated_per_second(frames) for _ in range(RUNS)]) / DURATION


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
        Indexed by `kind` (liquid at the paper's step, liquid at the default step, marbles),
        `N` and `cores`; columns: step [ms], speed-up over one core, and simulations of 4 s
        per second: the median, the least and the greatest of `RUNS` runs.
    """
    settings = EngineSettings()
    kinds: dict[str, tuple[Kind, EngineSettings]] = {
        "liquid, 2e-4 s": ("liquid", replace(settings, step=PAPER_STEP)),
        "liquid": ("liquid", settings),
        "marbles": ("marbles", settings),
    }
    numbers_of_threads = list(dict.fromkeys((1, available_cores())))
    cases = [(label, count) for label in kinds for count in counts]
    seconds = min(MEASURED_SECONDS / (len(cases) * len(numbers_of_threads)), _ENOUGH_SECONDS)
    jobs: dict[tuple[Kind, int], list[Job]] = {}
    rows = []
    for done, (label, count) in enumerate(cases):
        report(f"{label}, N = {count}", done, len(cases))
        kind, used = kinds[label]
        if (kind, count) not in jobs:
            jobs[kind, count] = mid_pour_jobs(count, kind)
        spacing = spacing_of(count, _DEPTH / 2, _DEPTH)
        stepping = used.stepping(kind, spacing, WATER.viscosity_alpha)
        one_core = np.nan
        for threads in numbers_of_threads:
            found = speeds(jobs[kind, count], kind, stepping, threads, seconds)
            if threads == 1:
                one_core = float(np.median(found))
            rows.append(
                {
                    "kind": label,
                    "N": count,
                    "cores": threads,
                    "step [ms]": 1e3 * stepping.step,
                    "speed-up": float(np.median(found)) / one_core,
                    "median [1/s]": float(np.median(found)),
                    "least": float(found.min()),
                    "greatest": float(found.max()),
                }
            )
    return pd.DataFrame(rows).set_index(["kind", "N", "cores"])


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
