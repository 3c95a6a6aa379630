"""How long one pour, and one prediction, takes on this machine from start to answer."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import pandas as pd

from pourcast.models.registry import make_model
from pourcast.prediction import predict
from pourcast.progress import Report, no_report
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings, Kind
from pourcast.study.selection import drawn_scene
from pourcast.sweep.bench import COUNTS

POURED: dict[str, tuple[Liquid, Kind]] = {
    "water": (WATER, "liquid"),
    "honey": (HONEY_EXP1, "liquid"),
    "marbles": (WATER, "marbles"),
}
PREDICTED = ("water-ife", "truth-water")
"""Presets whose judgment of one scene is timed."""

MEASURED_SECONDS = 25.0
"""Time that all runs of a table take together [s], where no single run is longer than its share."""
MOST_RUNS = 9
_ENOUGH_SECONDS = 2.0
"""No row needs more [s]."""


def latency_table(counts: Sequence[int] = COUNTS, report: Report = no_report) -> pd.DataFrame:
    """Time that one pour takes from start to answer, kernels compiled, on all cores.

    Parameters
    ----------
    counts
        Numbers of particles.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        Indexed by `what` (water, honey and marbles, one pour each; a model's prediction for one
        scene) and `N`; columns: when the pour ended in its own time [s], and how long it took
        [ms]: the median, the least and the greatest of `runs` runs.
    """
    scene = _scene(0)
    cases = [(what, count) for what in POURED for count in counts]
    total = len(cases) + len(PREDICTED)
    share = min(MEASURED_SECONDS / total, _ENOUGH_SECONDS)
    rows = []
    for done, (what, count) in enumerate(cases):
        report(f"{what}, N = {count}", done, total)
        liquid, kind = POURED[what]
        pour = Pour(scene, liquid, count, kind=kind)
        simulate([pour], settings=EngineSettings(max_duration=0.05))  # for the compiler
        ended: list[float] = []
        taken = milliseconds(partial(_pour_once, pour, ended), share)
        rows.append(_row(what, count, ended[0], taken))
    # Each run judges another scene: what is known of one already isn't simulated again.
    scenes = map(_scene, itertools.count(1))
    for done, preset in enumerate(PREDICTED, start=len(cases)):
        report(f"predict, {preset}", done, total)
        ready = iter(list(itertools.islice(scenes, MOST_RUNS + 1)))
        _predict_next(ready, preset)  # for the compiler, and the packing that is kept on disk
        taken = milliseconds(partial(_predict_next, ready, preset), share)
        count = make_model(preset).parameters()["n_particles"]
        rows.append(_row(f"predict, {preset}", count, np.nan, taken))
    return pd.DataFrame(rows).set_index(["what", "N"])


def _pour_once(pour: Pour, ended: list[float]) -> None:
    ended.append(simulate([pour])[0].time)


def milliseconds(run: Callable[[], object], seconds: float) -> list[float]:
    """How long each of several runs takes [ms]: at least one, more while they fit into a time."""
    taken: list[float] = []
    while not taken or (len(taken) < MOST_RUNS and sum(taken) + taken[-1] < 1e3 * seconds):
        start = time.perf_counter()
        run()
        taken.append(1e3 * (time.perf_counter() - start))
    return taken


def _predict_next(scenes: Iterator[Scene], preset: str) -> None:
    predict([next(scenes)], [preset])


def _scene(number: int) -> Scene:
    """One of the family's scenes; every number has one, another for each."""
    found = (drawn_scene(VoronoiFamily(), number, attempt) for attempt in itertools.count())
    return next(scene for scene in found if scene is not None)


def _row(what: str, count: int, ended: float, taken: Sequence[float]) -> dict[str, object]:
    return {
        "what": what,
        "N": count,
        "ends at [s]": ended,
        "median [ms]": float(np.median(taken)),
        "least": min(taken),
        "greatest": max(taken),
        "runs": len(taken),
    }
