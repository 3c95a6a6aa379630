"""What was found: which choices matter, what survives, a point to take, what can't be met at once.

The rule for the recommended point, written down before the search that it was used on:

1. The largest implausibility of all outputs but the variances is at most the cut-off, and choices
   that are held have the value that they are held at.
2. Of such places the one with the smallest miss of the ten correlations is looked for: the root
   mean square of the expected distance from the target over the target's deviation
   (`matching.expected_misses`: a place where emulators are unsure is no good one).
3. Places are rounded to two digits, and judged as they are then. Those whose miss is at most
   `EQUAL` times the smallest are equally good: of these, the one with the smallest miss of the
   three variances, as they can't all be met together with the correlations (`TradeOff`).

An earlier search, of more choices and 12 scenes a point, was judged by other rules, the last of
which counted correlations and variances alike; the point that it gave failed on fresh scenes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray
from SALib.analyze import sobol as sobol_indices
from SALib.sample import sobol as sobol_sample

from benchmarks.calibration import space
from benchmarks.calibration.check import done_before
from benchmarks.calibration.emulator import FOLDS, SURE
from benchmarks.calibration.matching import (
    CUTOFF,
    Statistic,
    expected_misses,
    region,
)
from benchmarks.calibration.measure import Measured
from benchmarks.calibration.targets import RIVALS, TRUTHS, VARIANCES, Kind, Target
from benchmarks.calibration.waves import Left, Request, Wave, statistic_of
from pourcast.errors import InputError
from pourcast.files import write_text
from pourcast.pictures.style import BLUE, GREY, ORANGE, PAGE, RC, RED, new_figure, save_figure
from pourcast.study.experiments.exp1 import PUBLISHED

Array = NDArray[np.float64]

EQUAL = 1.1
"""Misses that differ by less than this factor are equal."""

BASE_SAMPLE = 512
"""Of Sobol's indices: (choices + 2) times as many places are emulated."""

SHOWN = 7
"""Choices in the picture of what survives: those that matter most."""

CANDIDATES = 1500
"""Places among which one is recommended."""

DRAWS = 400
"""From emulators, for the band of the trade-off's front."""

TAKEN = Path(__file__).with_name("recommended.toml")
"""The point that the product takes."""

CANDIDATE_LEVELS = 3
"""How far the level of misses is lowered for them; see `matching.region`."""


@dataclass(frozen=True)
class Sensitivity:
    """Total-effect indices (Homma and Saltelli 1996), shape [output_count, choice_count].

    NaN for an output that its emulator doesn't foretell: its lengths are noise.
    """

    outputs: tuple[str, ...]
    total: Array

    @property
    def largest(self) -> Array:
        """Of each choice, over the outputs that are foretold; 0 if none is."""
        return np.nan_to_num(self.total).max(axis=0)

    @property
    def order(self) -> NDArray[np.int64]:
        """Choices, the most influential of any output first."""
        return np.argsort(-self.largest, kind="stable")


def sensitivity(wave: Wave, seed: int) -> Sensitivity:
    """Total-effect indices of each choice on each emulator's mean over the whole space.

    Parameters
    ----------
    wave
        The last one.
    seed
        Of the sample.
    """
    names = [choice.name for choice in space.CHOICES]
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    places = sobol_sample.sample(problem, BASE_SAMPLE, calc_second_order=False, seed=seed)
    rows, outputs = [], []
    for emulator, target in zip(wave.emulators, wave.targets, strict=True):
        if target.kind == "bound" and target.name != "truth-water / water-ife":
            continue
        outputs.append(label(target))
        if not emulator.foretells:
            rows.append(np.full(len(names), np.nan))
            continue
        found = sobol_indices.analyze(
            problem, emulator.mean(places), calc_second_order=False, num_resamples=2, seed=seed
        )
        rows.append(np.clip(found["ST"], 0.0, None))
    return Sensitivity(tuple(outputs), np.array(rows))


def label(target: Target) -> str:
    """An output in words."""
    if target.kind in ("correlation", "bound"):
        return f"r({target.name.replace(' / ', ', ')})"
    return f"{target.kind}, {target.name}"


@dataclass(frozen=True)
class Recommended:
    """A point to take, and what emulators say of it."""

    point: dict[str, space.Value]
    means: Array
    """Of each output, on its emulator's scale."""
    deviations: Array
    misses: Array


def recommend(wave: Wave, held: space.Point | None = None) -> Recommended:
    """The point that the rule above gives; see the module.

    Parameters
    ----------
    wave
        The last one.
    held
        Choices that are to have a value.
    """
    points = [_rounded(place) for place in _candidates(wave, held or {})]
    places = np.array([space.place_of(point) for point in points])
    misses = expected_misses(places, wave.emulators, wave.targets)
    miss = _miss(misses, wave.targets, "correlation")
    miss = np.where(_largest(wave)(places) > CUTOFF, np.inf, miss)
    if np.isinf(miss).all():
        raise InputError("rounded, no place is left that no output rules out")
    left = np.flatnonzero(miss <= EQUAL * miss.min())
    best = int(left[np.argmin(_miss(misses, wave.targets, "variance")[left])])
    predicted = [emulator.predict(places[best : best + 1]) for emulator in wave.emulators]
    means, variances = (np.array([pair[k][0] for pair in predicted]) for k in (0, 1))
    return Recommended(points[best], means, np.sqrt(variances), misses[:, best])


def _miss(misses: Array, wanted: Sequence[Target], kind: Kind) -> Array:
    """Root mean square of the misses of one kind of output, at each place."""
    rows = [row for row, target in zip(misses, wanted, strict=True) if target.kind == kind]
    miss: Array = np.sqrt(np.square(rows).mean(axis=0))
    return miss


def _largest(wave: Wave) -> Statistic:
    """The largest implausibility of all that may not rule the recommended place out."""
    return statistic_of(wave.emulators, wave.targets, 1, variances=False)


def _candidates(wave: Wave, held: space.Point) -> Array:
    """Places among which one is recommended: not ruled out, and of the smallest misses."""
    pairs = zip(wave.emulators, wave.targets, strict=True)
    correlations = [pair for pair in pairs if pair[1].kind == "correlation"]
    emulators, wanted = zip(*correlations, strict=True)
    largest = _largest(wave)

    def miss(anywhere: Array) -> Array:
        places = space.holding(anywhere, held)
        misses = _miss(expected_misses(places, emulators, wanted), wanted, "correlation")
        return misses + 100.0 * (largest(places) > CUTOFF)

    dimensions = len(space.CHOICES)
    best = region(miss, dimensions, wave.number, cutoff=0.0, most_levels=CANDIDATE_LEVELS)
    return space.holding(best.places[:CANDIDATES], held)


def _rounded(place: Array) -> dict[str, space.Value]:
    exact = space.point_at(place)
    return {choice.name: choice.rounded(exact[choice.name]) for choice in space.CHOICES}


@dataclass(frozen=True)
class TradeOff:
    """What correlations cost in variance: emulated at many places, the best of each."""

    ratio: Array
    """Geometric mean of the three variances over the paper's."""
    gap: Array
    """Root mean square distance of the ten correlations from the paper's."""
    front: NDArray[np.int64]
    """Places that no other beats in both, from small variance to large."""
    low: Array
    high: Array
    """Gap at each place of the front as emulators are unsure of it: 10 % and 90 % of draws, each
    output drawn by itself."""


def trade_off(wave: Wave, seed: int) -> TradeOff:
    """Variance against correlations, over what survives and over the whole space.

    Parameters
    ----------
    wave
        The last one.
    seed
        Of the places beside those that survive.
    """
    anywhere = np.random.default_rng(seed).random((4000, len(space.CHOICES)))
    places = np.concatenate([wave.whole.places, wave.correlated.places, anywhere])
    pairs = list(zip(wave.emulators, wave.targets, strict=True))
    correlations = [pair for pair in pairs if pair[1].kind == "correlation"]
    ratios = [e.mean(places) - target.low for e, target in pairs if target.kind == "variance"]
    gaps = [np.tanh(e.mean(places)) - np.tanh(target.low) for e, target in correlations]
    ratio = np.exp(np.mean(ratios, axis=0))
    gap = np.sqrt(np.mean(np.square(gaps), axis=0))
    order = np.argsort(ratio)
    lowest = np.minimum.accumulate(gap[order])
    front = order[np.flatnonzero(np.diff(lowest, prepend=np.inf) < 0.0)]
    rng = np.random.default_rng(seed)
    drawn = []
    for emulator, target in correlations:
        mean, variance = emulator.predict(places[front])
        z = mean + np.sqrt(variance) * rng.normal(size=(DRAWS, len(front)))
        drawn.append(np.tanh(z) - np.tanh(target.low))
    low, high = np.quantile(np.sqrt(np.mean(np.square(drawn), axis=0)), [0.1, 0.9], axis=0)
    return TradeOff(ratio, gap, front, low, high)


def write_report(left: Sequence[Left], last: Wave, request: Request, store: Path) -> str:
    """Write the report, its figures, and the recommended point; returns the report.

    Parameters
    ----------
    left, last
        What `run_waves` gives.
    request
        What was asked.
    store
        Folder of the results.
    """
    matters, best = sensitivity(last, request.seed), recommend(last, request.held)
    curve = trade_off(last, request.seed)
    taken = done_before(space.read_point(TAKEN), store / "check")
    write_text(store / "recommended.toml", space.point_text(best.point))
    with mpl.rc_context(RC):
        save_figure(_sensitivity_figure(matters), store / "sensitivity", simulated=False)
        save_figure(_region_figure(last, matters, best), store / "region", simulated=False)
        save_figure(_trade_off_figure(curve, last, taken), store / "trade-off", simulated=False)
    parts = [
        "# Calibration by history matching",
        f"{len(left)} waves, {request.points} points in the first and {request.later_points} in "
        f"each later one, {request.scenes} scenes at each point, seed {request.seed}.",
        "## Waves",
        _waves_table(left),
        "## Emulators",
        _emulator_table(last),
        "## Which choices matter",
        "![Total effects](sensitivity.png)",
        "Of outputs that no emulator foretells nothing is shown.",
        _effects_table(matters),
        "## What survives",
        "![What survives](region.png)",
        _survivors_table(last, best),
        "## Recommended",
        f"```toml\n{space.point_text(best.point)}```",
        _predicted_table(last, best),
        "## What can't be met at once",
        "![Variance against correlations](trade-off.png)",
        "The front is a minimum over thousands of emulated means: with its outputs foretold it is "
        "better than any point is. Outputs that are not foretold stand in it with their mean over "
        "all points, which is worse than a good point's.",
        _trade_off_table(curve),
    ]
    text = "\n\n".join(parts) + "\n"
    write_text(store / "report.md", text)
    return text


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(heads)} |", "|" + " --- |" * len(heads)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def _waves_table(waves: Sequence[Left]) -> str:
    rows = [
        [
            str(number),
            f"{wave.points} ({wave.failed} failed)",
            _volume(*wave.whole),
            _volume(*wave.correlated),
        ]
        for number, wave in enumerate(waves, start=1)
    ]
    heads = ["wave", "points", "volume that nothing rules out", "but for the variances"]
    return _table(heads, rows)


def _volume(volume: float, cutoff: float) -> str:
    return f"none; {volume:.1g} below {cutoff:.1f}" if cutoff > CUTOFF else f"{volume:.2g}"


def _emulator_table(wave: Wave) -> str:
    rows = [
        [
            label(target),
            f"{emulator.signal:.2f}",
            f"{emulator.explained:.2f} +- {emulator.error:.2f}",
            "yes" if emulator.foretells else "no: its mean is taken",
            f"{emulator.misfit:.2f}",
        ]
        for emulator, target in zip(wave.emulators, wave.targets, strict=True)
    ]
    heads = ["output", "signal", "explained when left out", "foretold", "RMS of residuals"]
    note = (
        f"Each point is left out once, with a {FOLDS}th of them, and emulators are fitted anew "
        "without these. Signal: share of the variance among points that is more than sampling "
        "noise. Explained: share of the signal that is foretold, below 0 where the mean of the "
        f"others foretells better; an output counts as foretold from {SURE:g} standard errors on. "
        "The standardised residuals' root mean square is 1 if emulators are as sure as they say."
    )
    return f"{note}\n\n{_table(heads, rows)}"


def _effects_table(matters: Sensitivity) -> str:
    names = [choice.name for choice in space.CHOICES]
    rows = [
        [
            names[k],
            f"{matters.largest[k]:.2f}",
            matters.outputs[np.nan_to_num(matters.total[:, k]).argmax()],
        ]
        for k in matters.order
    ]
    return _table(["choice", "largest total effect", "on"], rows)


def _survivors_table(wave: Wave, best: Recommended) -> str:
    product = space.product_point()
    rows = []
    for k, choice in enumerate(space.CHOICES):
        cells = [choice.name]
        for places in (wave.whole.places, wave.correlated.places):
            cells.append(_range_of(choice, places[:, k]))
        cells += [_short(best.point[choice.name]), _short(product[choice.name]), choice.why]
        rows.append(cells)
    heads = ["choice", "survives (middle 80 %)", "but for the variances", "recommended", "product",
             "why this range"]  # fmt: skip
    return _table(heads, rows)


def _range_of(choice: space.Choice, places: Array) -> str:
    low, high = (choice.value(float(u)) for u in np.quantile(places, [0.1, 0.9]))
    return f"{_short(low)} to {_short(high)}"


def _short(value: space.Value) -> str:
    return value if isinstance(value, str) else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _predicted_table(wave: Wave, best: Recommended) -> str:
    rows = []
    for k, target in enumerate(wave.targets):
        low, middle, high = best.means[k] + best.deviations[k] * np.array([-1.0, 0.0, 1.0])
        cells = [label(target), _wanted(target)]
        cells += [f"{_plain(target, middle)}", f"{_plain(target, low)} to {_plain(target, high)}"]
        rows.append([*cells, f"{best.misses[k]:.1f}"])
    heads = ["output", "wanted", "emulated", "+- one deviation", "miss [deviations]"]
    return _table(heads, rows)


def _wanted(target: Target) -> str:
    if target.low == target.high:
        return _plain(target, target.low)
    return f"{_plain(target, target.low)} to {_plain(target, target.high)}"


def _plain(target: Target, value: float) -> str:
    if target.kind in ("correlation", "bound"):
        return f"{np.tanh(value):.2f}"
    return f"{np.exp(value):.4f}" if target.kind == "variance" else f"{value:.2f}"


def _trade_off_table(curve: TradeOff) -> str:
    picks = np.unique(np.linspace(0, len(curve.front) - 1, 8).round().astype(int))
    rows = [
        [
            f"{curve.ratio[curve.front[k]]:.2f}",
            f"{curve.gap[curve.front[k]]:.3f}",
            f"{curve.low[k]:.3f} to {curve.high[k]:.3f}",
        ]
        for k in picks
    ]
    heads = ["variance over the paper's", "RMS gap of the ten correlations", "80 % of draws"]
    return _table(heads, rows)


def _sensitivity_figure(matters: Sensitivity) -> Figure:
    names = [space.CHOICES[k].name for k in matters.order]
    figure = new_figure(PAGE, 0.9 + 0.24 * len(names))
    axes = figure.subplots()
    image = axes.imshow(
        matters.total[:, matters.order].T, cmap="Blues", vmin=0.0, vmax=0.8, aspect="auto"
    )
    axes.set_xticks(range(len(matters.outputs)), matters.outputs, rotation=60, ha="right")
    axes.set_yticks(range(len(names)), names)
    for column, row in np.ndindex(matters.total.shape):
        value = matters.total[column, matters.order[row]]
        if value >= 0.05:
            shade = "white" if value > 0.5 else "black"
            axes.text(
                column, row, f"{value:.2f}"[1:], ha="center", va="center", size=6, color=shade
            )
    unknown = np.flatnonzero(np.isnan(matters.total).any(axis=1))
    for column in unknown:
        axes.axvspan(column - 0.5, column + 0.5, fc="white", ec=GREY, hatch="///", lw=0)
    if len(unknown):
        axes.set_title("hatched: not foretold out of fold, no effects known", size=7, color=GREY)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    figure.colorbar(image, ax=axes, label="total effect", shrink=0.6)
    return figure


def _region_figure(wave: Wave, matters: Sensitivity, best: Recommended) -> Figure:
    shown = np.sort(matters.order[:SHOWN])
    figure = new_figure(PAGE, PAGE)
    grid = figure.subplots(len(shown), len(shown), squeeze=False)
    place, product = space.place_of(best.point), space.place_of({})
    kept, all_but = wave.whole.places, wave.correlated.places
    for (row, column), axes in np.ndenumerate(grid):
        one, other = shown[column], shown[row]
        choice = space.CHOICES[one]
        if row == column:
            for places, colour in ((all_but, BLUE), (kept, ORANGE)):
                axes.hist(
                    places[:, one],
                    20,
                    range=(0.0, 1.0),
                    density=True,
                    histtype="step",
                    color=colour,
                )
            axes.axvline(place[one], color=RED, lw=1.0)
        else:
            # Below: nothing rules it out; above: but for the variances.
            places, cmap = (kept, "Oranges") if row > column else (all_but, "Blues")
            unit = [[0.0, 1.0], [0.0, 1.0]]
            axes.hist2d(places[:, one], places[:, other], 16, range=unit, cmap=cmap)
            axes.plot(product[one], product[other], "+", color=GREY, ms=5)
            axes.plot(place[one], place[other], "x", color=RED, ms=5)
            axes.set_ylim(0.0, 1.0)
        axes.set_xlim(0.0, 1.0)
        axes.set_yticks([])
        axes.set_xticks([])
        if row == len(shown) - 1:
            ends = [_short(choice.value(u)) for u in (0.0, 1.0)]
            axes.set_xticks([0.0, 1.0], ends, size=6)
            axes.set_xlabel(choice.name.replace(".", "\n"), size=6)
        if column == 0:
            axes.set_ylabel(space.CHOICES[other].name.replace(".", "\n"), size=6)
    return figure


def _trade_off_figure(curve: TradeOff, wave: Wave, taken: Sequence[Measured]) -> Figure:
    figure = new_figure(PAGE, 3.2)
    axes = figure.subplots()
    axes.scatter(curve.ratio, curve.gap, s=2, color=GREY, alpha=0.2, lw=0, label="emulated")
    good = [one for one in wave.measured if not one.failure]
    ratio, gap = np.array([gaps_of(one) for one in good]).T
    axes.scatter(
        ratio, gap, s=8, color=BLUE,
        label=f"measured on {good[0].scenes} scenes\n(their sampling alone: {_noise(good):.2f})",
    )  # fmt: skip
    front = curve.ratio[curve.front]
    axes.plot(front, curve.gap[curve.front], color=RED, label="best of the emulated")
    axes.fill_between(
        front, curve.low, curve.high, color=RED, alpha=0.2, lw=0,
        label="as emulators are unsure\n(80 % of draws)",
    )  # fmt: skip
    if taken:
        axes.plot(
            *gaps_of_all(taken), "*", color="black", ms=9,
            label=f"taken, measured on\n{len(taken)} x {taken[0].scenes} scenes",
        )  # fmt: skip
    axes.axvspan(0.5, 2.0, color=ORANGE, alpha=0.15, lw=0, label="within a factor of two")
    axes.set(
        xscale="log",
        xlabel="variance over the window of zeta, over the paper's (geometric mean of the three)",
        ylabel="RMS gap of ten correlations", ylim=(0.0, None),
    )  # fmt: skip
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _noise(measured: Sequence[Measured]) -> float:
    """RMS of what sampling alone adds to the ten correlations of a point."""
    shares = []
    for truth in TRUTHS:
        for rival in RIVALS:
            slopes = [1.0 - one.correlation(rival, truth) ** 2 for one in measured]
            shares.append(np.nanmean(np.square(slopes)) / (measured[0].scenes - 3))
    return float(np.sqrt(np.mean(shares)))


def gaps_of_all(sets: Sequence[Measured]) -> tuple[float, float]:
    """The same of several sets of a point together: correlations and variances are averaged."""
    variances = [
        np.mean([one.scene_variances(ife).mean() for one in sets]) / paper
        for ife, paper in VARIANCES.items()
    ]
    gaps = [
        np.mean([one.correlation(rival, truth) for one in sets])
        - PUBLISHED.with_truth[truth][rival]
        for truth in TRUTHS
        for rival in RIVALS
    ]
    ratio = float(np.exp(np.mean(np.log(variances))))
    return ratio, float(np.sqrt(np.mean(np.square(gaps))))


def gaps_of(one: Measured) -> tuple[float, float]:
    """A measured point's ratio of variances and RMS gap; see `TradeOff`."""
    variances = [one.scene_variances(ife).mean() / paper for ife, paper in VARIANCES.items()]
    gaps = [
        one.correlation(rival, truth) - r
        for truth, column in PUBLISHED.with_truth.items()
        for rival, r in column.items()
        if rival in one.judgments
    ]
    ratio = float(np.exp(np.mean(np.log(np.array(variances) + 1e-6))))
    return ratio, float(np.sqrt(np.nanmean(np.square(gaps))))
