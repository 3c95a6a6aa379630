"""Waves: where to measure, measured, emulated, and where to measure next.

A store's folder holds all of it, and whatever is there is not done again:

    STORE/request.json              what was asked: choices, points, scenes, seed
    STORE/wave-1.json               the places of a wave's points, in the unit cube
    STORE/wave-1/001/               a point; see `measure`
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration import space
from benchmarks.calibration.emulator import LEAST_POINTS, Emulator, fit
from benchmarks.calibration.matching import (
    PROMISING_LEVELS,
    Region,
    Statistic,
    first_design,
    implausibilities,
    kth_largest,
    region,
    spread_out,
)
from benchmarks.calibration.measure import (
    SECOND_ZETA,
    Errand,
    Measured,
    log_variance,
    measure_all,
    output,
    read_json,
)
from benchmarks.calibration.targets import VARIANCES, Target, targets
from pourcast.errors import InputError
from pourcast.files import write_text
from pourcast.progress import Report, no_report

Array = NDArray[np.float64]


MUCH = 0.1
"""Share of the space."""


@dataclass(frozen=True)
class Request:
    """What is asked of a calibration.

    Parameters
    ----------
    waves, points, later_points, scenes
        How many waves, points in the first and in each later one, scenes at each point.
    seed
        Source of all randomness.
    workers
        Points that are measured at a time; results don't depend on it.
    held
        Choices that later waves are drawn at a value of. Waves that the store has are not drawn
        again: hold from any wave on.
    """

    waves: int = 3
    points: int = 60
    later_points: int = 60
    scenes: int = 30
    seed: int = 1
    workers: int = 1
    held: space.Point = field(default_factory=dict)


@dataclass(frozen=True)
class Wave:
    """What was known after a wave.

    Parameters
    ----------
    number
        From 1.
    places, measured
        All points so far, those that failed too.
    targets, emulators
        Of each output that has an emulator.
    whole
        Not ruled out by any output.
    correlated
        Not ruled out by any but the variances.
    """

    number: int
    places: Array
    measured: Sequence[Measured]
    targets: Sequence[Target]
    emulators: Sequence[Emulator]
    whole: Region
    correlated: Region


@dataclass(frozen=True)
class Left:
    """What a wave left: its file, so that nobody need learn it again.

    Parameters
    ----------
    points, failed
        Of this wave.
    whole, correlated
        Volume and cut-off of the regions of `Wave`.
    """

    points: int
    failed: int
    whole: tuple[float, float]
    correlated: tuple[float, float]


def scene_seed(seed: int, wave: int, number: int) -> int:
    """Seed of the scenes of a point; wave 0 is that of checks."""
    return int(np.random.SeedSequence([seed, wave, number]).generate_state(1)[0])


def run_waves(request: Request, store: Path, report: Report = no_report) -> tuple[list[Left], Wave]:
    """Do all waves; what the store has already is not done again.

    Parameters
    ----------
    request
        What is asked.
    store
        Folder of the results.
    report
        Told of the progress.

    Returns
    -------
    left, last
        What each wave left, and all that is known after the last.

    Raises
    ------
    InputError
        If the store is of another request, or of another state of the engine.
    """
    _same_request(request, store)
    places = np.empty((0, len(space.CHOICES)))
    measured: list[Measured] = []
    left: list[Left] = []
    last: Wave | None = None
    for number in range(1, request.waves + 1):
        path, summary = store / f"wave-{number}.json", store / f"wave-{number}-left.json"
        if not path.exists():
            if last is None and number > 1:
                last = _learn(number - 1, places, measured, request.seed)
            write_text(path, json.dumps(_design(request, number, last).tolist()) + "\n")
        new = _read_places(path)
        found = _measure_wave(request, number, new, store, report)
        places, measured, last = np.concatenate([places, new]), [*measured, *found], None
        if not summary.exists() or number == request.waves:
            last = _learn(number, places, measured, request.seed)
            write_text(summary, json.dumps(vars(_left(last, found))) + "\n")
        left.append(_read_left(summary))
    assert last is not None
    return left, last


def _read_places(path: Path) -> Array:
    try:
        places = np.array(json.loads(path.read_text(encoding="utf-8")), dtype=float)
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: expected places, lists of numbers ({error})") from None
    if places.ndim != 2 or places.shape[1] != len(space.CHOICES):
        raise InputError(f"{path}: expected places of {len(space.CHOICES)} numbers each")
    return places


def _read_left(path: Path) -> Left:
    try:
        return Left(**read_json(path))
    except TypeError:
        names = ", ".join(one.name for one in fields(Left))
        raise InputError(f"{path}: expected {names}") from None


def _measure_wave(
    request: Request, number: int, places: Array, store: Path, report: Report
) -> list[Measured]:
    errands = [
        Errand(
            space.point_at(place),
            request.scenes,
            scene_seed(request.seed, number, k),
            store / f"wave-{number}" / f"{k:03d}",
            SECOND_ZETA,
        )
        for k, place in enumerate(places, start=1)
    ]
    return measure_all(errands, request.workers, _named(report, number))


def _left(wave: Wave, new: Sequence[Measured]) -> Left:
    failed = sum(bool(one.failure) for one in new)
    whole, correlated = ((r.volume, r.cutoff) for r in (wave.whole, wave.correlated))
    return Left(len(new), failed, whole, correlated)


def _named(report: Report, number: int) -> Report:
    return lambda what, done, total: report(f"wave {number}: {what}", done, total)


def _same_request(request: Request, store: Path) -> None:
    path = store / "request.json"
    asked = {
        "choices": [f"{c.name} {c.low} {c.high} {c.scale}" for c in space.CHOICES],
        "points": request.points,
        "later points": request.later_points,
        "scenes": request.scenes,
        "seed": request.seed,
    }
    if not path.exists():
        write_text(path, json.dumps(asked, indent=2) + "\n")
        return
    there = read_json(path)
    different = [name for name in asked if there.get(name) != asked[name]]
    if different:
        raise InputError(f"{path}: other {', '.join(different)}: take another --store")


def _design(request: Request, number: int, last: Wave | None) -> Array:
    """Places of a wave: half where nothing rules out, half where nothing but a variance does.

    If more than `MUCH` of the space is left, emulators are too unsure to rule out much: then the
    points are drawn where the largest implausibility is least.
    """
    if last is None:
        return first_design(request.points, len(space.CHOICES), request.seed)
    seed = request.seed + number
    half = request.later_points // 2
    chosen = []
    for left, variances, count in (
        (last.whole, True, half),
        (last.correlated, False, request.later_points - half),
    ):
        places = left.places
        if left.volume > MUCH or request.held:
            places = _promising(last, request.held, seed, variances=variances)
        chosen.append(spread_out(places, count, seed))
    return np.concatenate(chosen)


def _promising(last: Wave, held: space.Point, seed: int, *, variances: bool) -> Array:
    """Places where the largest implausibility is least, of those that have what is held."""
    largest = statistic_of(last.emulators, last.targets, 1, variances=variances)

    def statistic(places: Array) -> Array:
        return largest(space.holding(places, held))

    dimensions = len(space.CHOICES)
    least = region(statistic, dimensions, seed, cutoff=0.0, most_levels=PROMISING_LEVELS)
    return space.holding(least.places, held)


def pooled_sampling(measured: Sequence[Measured]) -> dict[str, float]:
    """Sampling variance of each logarithm of a variance, for one scene: median over points."""
    return {
        ife: float(np.median([log_variance(one.scene_variances(ife))[1] for one in measured]))
        for ife in VARIANCES
    }


def statistic_of(
    emulators: Sequence[Emulator], wanted: Sequence[Target], rank: int, *, variances: bool = True
) -> Statistic:
    """What decides whether a place is ruled out.

    An output that isn't foretold tells no places apart, and rules none out.

    Parameters
    ----------
    emulators, wanted
        Of each output.
    rank
        Which implausibility decides: 1 the largest, 2 the second largest.
    variances
        Whether the variances count.
    """
    pairs = [
        (emulator, target)
        for emulator, target in zip(emulators, wanted, strict=True)
        if emulator.foretells and (variances or target.kind != "variance")
    ]

    def statistic(places: Array) -> Array:
        if not pairs:
            return np.zeros(len(places))
        chosen, kept = zip(*pairs, strict=True)
        return kth_largest(implausibilities(places, chosen, kept), rank)

    return statistic


def emulate(
    places: Array, measured: Sequence[Measured], seed: int
) -> tuple[list[Target], list[Emulator]]:
    """Targets and their emulators, from points that were measured.

    A bound that no point comes beyond rules nothing out, and gets none.

    Parameters
    ----------
    places
        In the unit cube, shape [point_count, choice_count].
    measured
        What they gave; those that failed are left out.
    seed
        Of the fits.
    """
    good = [k for k, one in enumerate(measured) if not one.failure]
    if len(good) < LEAST_POINTS:
        why = next((one.failure for one in measured if one.failure), "too few were asked for")
        raise InputError(
            f"{len(measured) - len(good)} of {len(measured)} points failed: emulators need "
            f"{LEAST_POINTS}; one says: {why}"
        )
    pooled = pooled_sampling([measured[k] for k in good])
    kept, emulators = [], []
    for target in targets(pooled):
        outputs = [output(measured[k], target, pooled.get(target.name, np.nan)) for k in good]
        values, noise = np.array(outputs).T
        beyond = (values < target.low) | (values > target.high)
        if target.exact or beyond.mean() > _RARELY:
            kept.append(target)
            try:
                emulators.append(fit(places[good], values, noise, seed))
            except InputError as error:
                raise InputError(f"{target.kind}, {target.name}: {error}") from None
    return kept, emulators


_RARELY = 0.1
"""A bound that fewer points than this are beyond is met but for noise."""


def _learn(number: int, places: Array, measured: list[Measured], seed: int) -> Wave:
    wanted, emulators = emulate(places, measured, seed)
    rank = 3 if number == 1 else 2
    regions = [
        region(statistic_of(emulators, wanted, rank, variances=v), places.shape[1], seed + number)
        for v in (True, False)
    ]
    return Wave(number, places, measured, wanted, emulators, *regions)
