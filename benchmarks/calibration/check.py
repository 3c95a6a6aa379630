"""A point on fresh scenes, beside the paper."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.calibration import chaos
from benchmarks.calibration.measure import (
    DONE,
    Errand,
    Measured,
    is_current,
    measure_all,
    read_json,
)
from benchmarks.calibration.space import Point, point_text
from benchmarks.calibration.targets import RIVALS, TRUTHS, VARIANCES, people_bounds
from benchmarks.calibration.waves import scene_seed
from pourcast.progress import Report, no_report
from pourcast.study.experiments.exp1 import PUBLISHED


@dataclass(frozen=True)
class Checked:
    """A point on one fresh set of scenes.

    Parameters
    ----------
    measured
        What it gave.
    changes
        Model that pours -> mean |dJ| of one pour whose start is moved; see `chaos`.
    """

    measured: Measured
    changes: dict[str, float]


def measure_checks(
    points: Mapping[str, Point], scenes: int, seeds: int, seed: int, folder: Path,
    workers: int, report: Report = no_report,
) -> dict[str, list[Checked]]:  # fmt: skip
    """Measure points on fresh sets of scenes, which no wave has seen.

    Parameters
    ----------
    points
        Name -> point.
    scenes, seeds
        Scenes in a set, and number of sets.
    seed
        Source of their seeds.
    folder
        Where results are kept.
    workers, report
        See `measure_all`.
    """
    errands = [
        Errand(dict(point), scenes, scene_seed(seed, 0, k), folder / _name(point, scenes, seed, k))
        for point in points.values()
        for k in range(1, seeds + 1)
    ]
    found = zip(errands, measure_all(errands, workers, report), strict=True)
    checked = iter(
        Checked(one, {} if one.failure else chaos.mean_changes(one.point, errand.folder))
        for errand, one in found
    )
    return {name: [next(checked) for _ in range(seeds)] for name in points}


def done_before(point: Point, folder: Path) -> list[Measured]:
    """What a point gave on all fresh sets that a folder of checks has; stale ones don't count."""
    given = f"{_digest(point)}-*/*/{DONE}"
    contents = [read_json(path) for path in sorted(folder.glob(given))]
    found = [Measured(**one["measured"]) for one in contents if is_current(one["key"], point)]
    return [one for one in found if not one.failure]


def _digest(point: Point) -> str:
    return hashlib.sha256(point_text(point).encode()).hexdigest()[:12]


def _name(point: Point, scenes: int, seed: int, number: int) -> str:
    return f"{_digest(point)}-{scenes}-seed-{seed}/{number}"


def check_table(found: Mapping[str, Sequence[Checked]]) -> str:
    """Tables in Markdown: ten correlations and three variances, a column for each set of scenes."""
    parts = []
    for name, sets in found.items():
        failed = [one.measured.failure for one in sets if one.measured.failure]
        parts.append(f"**{name}**: {failed[0]}" if failed else _table(name, sets))
    return "\n\n".join(parts)


def _table(name: str, checked: Sequence[Checked]) -> str:
    sets = [one.measured for one in checked]
    seeds = [f"set {k}" for k in range(1, len(sets) + 1)]
    lines = [
        f"**{name}**, {sets[0].scenes} scenes in each set",
        "",
        f"| | paper | {' | '.join(seeds)} | mean | gap |",
        "|" + " --- |" * (len(sets) + 4),
    ]
    gaps = []
    for truth in TRUTHS:
        for rival in RIVALS:
            paper = PUBLISHED.with_truth[truth][rival]
            r = np.array([one.correlation(rival, truth) for one in sets])
            gaps.append(r - paper)
            lines.append(_row(f"r({rival}, {truth})", f"{paper:.2f}", r, 2, r.mean() - paper))
    for ife, paper in VARIANCES.items():
        v = np.array([one.scene_variances(ife).mean() for one in sets])
        lines.append(_row(f"variance, {ife}", f"{paper:.3f}", v, 4, v.mean() / paper, "x"))
    for ife in VARIANCES:
        medians = [float(np.median(one.scene_variances(ife))) for one in sets]
        lines.append(_row(f"its median, {ife}", "", np.array(medians), 4))
        lines.append(
            _row(f"share that flips, {ife}", "", np.array([s.flips(ife) for s in sets]), 2)
        )
    low, high = people_bounds("water-ife", "truth-water")
    r = np.array([one.correlation("water-ife", "truth-water") for one in sets])
    lines.append(_row("r(water-ife, truth-water)", f"{low:.2f} to {high:.2f}", r, 2))
    r = np.array([one.correlation("truth-water", "truth-honey") for one in sets])
    lines.append(_row("r(truth-water, truth-honey)", "", r, 2))
    for truth in TRUTHS:
        stays = np.array([one.stranded[truth] for one in sets])
        lines.append(_row(f"stranded, {truth}", "", stays, 2))
    for model in checked[0].changes:
        changes = np.array([one.changes[model] for one in checked])
        lines.append(_row(f"mean change, start moved by 0.1 mm, {model}", "", changes, 3))
    lines.append(_row("obstacles", "", np.array([one.obstacles for one in sets]), 1))
    lines.append(_row("kept of those drawn", "", np.array([s.kept / s.drawn for s in sets]), 2))
    table = np.array(gaps)
    worst = " | ".join(f"{value:.2f}" for value in np.abs(table).max(axis=0))
    rms = " | ".join(f"{value:.2f}" for value in np.sqrt((table**2).mean(axis=0)))
    mean = table.mean(axis=1)
    lines.append(f"| largest gap of the ten | .10 | {worst} | {np.abs(mean).max():.2f} | |")
    lines.append(f"| their RMS gap | | {rms} | {np.sqrt((mean**2).mean()):.2f} | |")
    return "\n".join(lines)


def _row(
    what: str, paper: str, values: np.ndarray, digits: int, gap: float | None = None, unit: str = ""
) -> str:
    cells = " | ".join(f"{value:.{digits}f}" for value in (*values, values.mean()))
    last = "" if gap is None else f"{gap:.1f} {unit}" if unit else f"{gap:+.2f}"
    return f"| {what} | {paper} | {cells} | {last} |"
