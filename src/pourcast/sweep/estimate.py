"""How long a plan takes on this machine, from running a little of it."""

import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pourcast.cores import available_cores
from pourcast.engine.block import lanes_worth
from pourcast.engine.simd import LANES
from pourcast.progress import Report, no_report
from pourcast.sweep.plan import Plan, Shard, Span, trajectory_bytes
from pourcast.sweep.settings import PourSetting
from pourcast.sweep.shard import compute, task_of
from pourcast.sweep.store import Store
from pourcast.sweep.survey import survey

Group = tuple[str, int, str]

CALIBRATION_SECONDS = 10.0
"""How long a calibration goes on [s]."""

_SAMPLE_SECONDS = 1.0
_LARGEST_SAMPLE = 64

_SHARD_BYTES, _ROW_BYTES = 6_500, 2
"""Size of a shard's file, and of a row in it: `paper-exp1` on 40 scenes."""

_TRAJECTORY_RATIO = 0.7
"""Compressed size of trajectories over their size in memory: `quick` on 12 scenes."""


@dataclass(frozen=True)
class Part:
    """Simulations of a plan that are alike: same kind, number of particles and liquid.

    Parameters
    ----------
    group
        What they are.
    spans
        Where they are in the plan.
    seconds
        Rough work [s of one core].
    simulations
        Their number.
    """

    group: Group
    spans: tuple[Span, ...]
    seconds: float
    simulations: int

    @property
    def pairs(self) -> int:
        """Number of pairs of a setting and a scene."""
        return sum(span.stop - span.start for span in self.spans)


def parts_of(plan: Plan, shards: Sequence[Shard]) -> list[Part]:
    """Work of some shards of a plan, by group."""
    spans: dict[Group, list[Span]] = defaultdict(list)
    for shard in shards:
        for span in shard.spans:
            spans[plan.settings[span.setting].group].append(span)
    return [Part(group, tuple(members), *plan.work_in(members)) for group, members in spans.items()]


def measure(
    plan: Plan, part: Part, count: int, rng: np.random.Generator, threads: int
) -> tuple[int, float, float]:
    """Run some of a part, chosen at random.

    Parameters
    ----------
    plan, part
        What to run.
    count
        How many settings in scenes.
    rng
        Source of the choice.
    threads
        Threads to run them on.

    Returns
    -------
    simulations, seconds, expected
        How many were run, the time that they took, and the work that the plan takes them for
        [s of one core].
    """
    sizes = np.array([span.stop - span.start for span in part.spans])
    ends = np.cumsum(sizes)
    picks = np.sort(rng.choice(int(ends[-1]), min(count, int(ends[-1])), replace=False))
    which = np.searchsorted(ends, picks, side="right")
    spans = []
    for pick, member in zip(picks, which, strict=True):
        scene = part.spans[member].start + int(pick - (ends[member] - sizes[member]))
        spans.append(Span(part.spans[member].setting, scene, scene + 1))
    expected, simulations = plan.work_in(spans)
    task = task_of(plan, Shard("", 0, tuple(spans), expected, simulations), Path())
    start = time.perf_counter()
    compute(task, threads=threads)
    return simulations, time.perf_counter() - start, expected


def estimate(
    plan: Plan,
    shards: Sequence[Shard],
    workers: int,
    *,
    budget: float = CALIBRATION_SECONDS,
    report: Report = no_report,
) -> pd.DataFrame:
    """Time that some shards take on this machine, from a short calibration.

    The largest part of each kind is sampled first, then the other parts while there is
    time; what wasn't sampled is taken to be off by the same factor as its kind.

    Parameters
    ----------
    plan, shards
        What is to be done.
    workers
        How many work at a time, one core each.
    budget
        Time for the calibration [s], roughly.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        A row per part: simulations in all and run for the estimate, and minutes.
    """
    parts = parts_of(plan, shards)
    rng = np.random.default_rng(0)
    factors: dict[Group, float] = {}
    run: dict[Group, int] = {}
    spent = 0.0
    for done, part in enumerate(_by_kind_and_size(parts)):
        if spent > budget:
            break
        report(f"trying {in_words(part.group)}", done, len(parts))
        measure(plan, part, 1, rng, threads=1)  # For the compiler.
        run[part.group], seconds, expected = measure(plan, part, _sample_size(part), rng, threads=1)
        factors[part.group] = seconds / expected
        spent += seconds
    rows = [
        {
            "part": in_words(part.group),
            "simulations": part.simulations,
            "run": run.get(part.group, 0),
            "minutes": part.seconds * _factor(part.group, factors) / workers / 60,
        }
        for part in parts
    ]
    columns = ["part", "simulations", "run", "minutes"]
    return pd.DataFrame(rows, columns=columns).set_index("part")


@dataclass(frozen=True)
class Estimate:
    """What is left of a plan, and what it takes.

    Parameters
    ----------
    shards, simulations
        To be done.
    workers
        How many work at a time.
    parts
        From `estimate`.
    bytes
        Disk space, roughly.
    """

    shards: int
    simulations: int
    workers: int
    parts: pd.DataFrame
    bytes: int

    @property
    def minutes(self) -> float:
        """Time in all."""
        return float(self.parts["minutes"].sum())


def estimate_rest(
    plan: Plan, store: Store, workers: int | None = None, *, report: Report = no_report
) -> Estimate:
    """What is left of a plan, and how long it takes; writes nothing.

    Parameters
    ----------
    plan
        What is wanted.
    store
        What is done.
    workers
        How many work at a time; as many as this machine has cores by default.
    report
        Told of the progress.
    """
    left, count = survey(plan, store).left, workers or available_cores()
    parts = estimate(plan, left, count, report=report)
    simulations = sum(shard.simulations for shard in left)
    return Estimate(len(left), simulations, count, parts, disk_bytes(plan, left))


def _by_kind_and_size(parts: Sequence[Part]) -> list[Part]:
    """The largest part of each kind, the largest kind first, then the others by size."""
    by_size = sorted(parts, key=lambda part: -part.seconds)
    first = list({_kind(part.group): part for part in reversed(by_size)}.values())[::-1]
    return first + [part for part in by_size if part not in first]


def _kind(group: Group) -> tuple[str, str]:
    return group[0], group[2]


def _factor(group: Group, factors: dict[Group, float]) -> float:
    """Measured over expected time: of a group, of its kind, or of all."""
    if group in factors:
        return factors[group]
    kin = [factor for other, factor in factors.items() if _kind(other) == _kind(group)]
    known = kin or list(factors.values())
    return float(np.mean(known)) if known else 1.0


def _sample_size(part: Part) -> int:
    """Settings in scenes to try: a full set of the engine's lanes, or two where it has none."""
    least = LANES if lanes_worth(part.group[1]) <= LANES else 2
    return int(np.clip(_SAMPLE_SECONDS * part.pairs / part.seconds, least, _LARGEST_SAMPLE))


def in_words(group: Group) -> str:
    """A group for people."""
    kind, n_particles, what = group
    if kind == "model":
        return what
    name = "marbles" if kind == "marbles" else what.replace("alpha", "alpha =")
    return f"{name}, N = {n_particles}"


def disk_bytes(plan: Plan, shards: Sequence[Shard]) -> int:
    """Disk space that shards need [bytes], roughly."""
    size = sum(_SHARD_BYTES + _ROW_BYTES * shard.simulations for shard in shards)
    if not plan.trajectories:
        return size
    paths = 0.0
    for span in (span for shard in shards for span in shard.spans):
        setting = plan.settings[span.setting]
        if isinstance(setting, PourSetting):
            paths += (span.stop - span.start) * trajectory_bytes(setting)
    return size + round(_TRAJECTORY_RATIO * paths)
