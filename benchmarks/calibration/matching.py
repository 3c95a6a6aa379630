"""History matching: what is implausible is ruled out, and the next points are drawn in the rest.

Vernon, Goldstein and Bower (2010); Andrianakis et al. (2015). An output's implausibility is

    I = |emulator's mean - target| / sqrt(emulator's variance + target's variance)

where a target's variance is that of the sampling of the paper's scenes and of the model's
discrepancy (`targets`). A place is ruled out if its third largest I is above `CUTOFF` in the first
wave, its second largest later: emulators of few points may be wrong in one output or two.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from benchmarks.calibration.emulator import Emulator
from benchmarks.calibration.targets import Target

Array = NDArray[np.float64]
Statistic = Callable[[Array], Array]
"""Places, shape [place_count, choice_count], to one number each: ruled out above `CUTOFF`."""

PROMISING_LEVELS = 1
"""Two levels: the least implausible 2 % of the space (`LEVEL_SHARE` squared)."""

CUTOFF = 3.0
"""Three standard deviations (Pukelsheim 1994): 95 % of any unimodal distribution lie within."""

SAMPLE = 2**13
"""Places of a Sobol sequence that a region is looked for among."""

LEVEL_SHARE = 0.15
"""Of the places, kept from one level of `region` to the next."""

MOST_LEVELS = 8
STEPS = 12
"""Of the random walk between levels."""


@dataclass(frozen=True)
class Region:
    """What is not ruled out.

    Parameters
    ----------
    places
        A sample of it, shape [place_count, choice_count].
    volume
        Its share of the space.
    cutoff
        What its statistic stays below: `CUTOFF`, or more if nothing is below that.
    """

    places: Array
    volume: float
    cutoff: float

    @property
    def empty(self) -> bool:
        """Whether everything is ruled out; then the places are the least implausible."""
        return self.cutoff > CUTOFF


def distance(mean: Array, target: Target) -> Array:
    """How far means are from a target; 0 within its interval."""
    beyond: Array = np.maximum(np.maximum(target.low - mean, mean - target.high), 0.0)
    return beyond


def implausibilities(
    places: Array, emulators: Sequence[Emulator], targets: Sequence[Target]
) -> Array:
    """Implausibility of each output, shape [output_count, place_count]."""
    rows = []
    for emulator, target in zip(emulators, targets, strict=True):
        mean, variance = emulator.predict(places)
        rows.append(distance(mean, target) / np.sqrt(variance + target.variance))
    return np.array(rows)


def kth_largest(values: Array, k: int) -> Array:
    """The k-th largest of each column, or the smallest if there are fewer."""
    k = min(k, len(values))
    largest: Array = np.partition(values, len(values) - k, axis=0)[len(values) - k]
    return largest


def expected_misses(
    places: Array, emulators: Sequence[Emulator], targets: Sequence[Target]
) -> Array:
    """Root of the expected squared distance over the target's deviation, [output, place].

    Unlike the implausibility it is large where the emulator is unsure: what recommends a place.
    """
    rows = []
    for emulator, target in zip(emulators, targets, strict=True):
        mean, variance = emulator.predict(places)
        squared = distance(mean, target) ** 2 + variance * (1.0 if target.exact else 0.25)
        rows.append(np.sqrt(squared / target.variance))
    return np.array(rows)


def first_design(count: int, dimensions: int, seed: int) -> Array:
    """Space-filling design: an optimised Latin hypercube, shape [count, dimensions]."""
    sampler = qmc.LatinHypercube(dimensions, optimization="random-cd", rng=seed)
    return sampler.random(count)


def region(
    statistic: Statistic,
    dimensions: int,
    seed: int,
    sample: int = SAMPLE,
    *,
    cutoff: float = CUTOFF,
    most_levels: int = MOST_LEVELS,
) -> Region:
    """Sample what a statistic does not rule out, however small it is.

    By subset simulation (Au and Beck 2001): of a Sobol sequence the least implausible places are
    kept, moved at random within their level until they fill it, and the level is lowered, until it
    is the cut-off; or as often as `MOST_LEVELS` says.

    Parameters
    ----------
    statistic
        What is compared with `CUTOFF`.
    dimensions
        Of the unit cube.
    seed
        Of all randomness.
    sample
        Number of places, a power of two.
    cutoff
        What the statistic should stay below.
    most_levels
        How often the level is lowered at most, each time to `LEVEL_SHARE` of what was left.
    """
    rng = np.random.default_rng(seed)
    sobol = qmc.Sobol(dimensions, rng=rng)
    places, volume = sobol.random_base2(int(np.log2(sample))), 1.0
    values = statistic(places)
    for _ in range(most_levels):
        level = max(float(np.quantile(values, LEVEL_SHARE)), cutoff)
        chosen = values <= level
        volume *= float(chosen.mean())
        if level == cutoff:
            return Region(places[chosen], volume, cutoff)
        places, values = _spread(places[chosen], values[chosen], level, statistic, rng, sample)
    level = float(np.quantile(values, LEVEL_SHARE))
    chosen = values <= level
    return Region(places[chosen], volume * LEVEL_SHARE, level)


def _spread(
    places: Array, values: Array, level: float, statistic: Statistic,
    rng: np.random.Generator, count: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Fill a level anew from places in it: random steps along differences of pairs of them."""
    picks = rng.integers(0, len(places), count // 8)
    places, values = places[picks], values[picks]
    gathered = [(places, values)]
    dimensions = places.shape[1]
    for step in range(STEPS):
        first, second = (rng.permutation(len(places)) for _ in range(2))
        # The step of differential evolution Monte Carlo (ter Braak 2006), on some of the axes.
        factor = 1.0 if step % 4 == 3 else 2.38 / np.sqrt(2 * dimensions) * rng.random()
        moved_axes = rng.random(places.shape) < rng.uniform(0.2, 1.0)
        jump = factor * (places[first] - places[second]) + rng.normal(0.0, 0.01, places.shape)
        tried = _reflected(places + moved_axes * jump)
        found = statistic(tried)
        accepted = found <= level
        places = np.where(accepted[:, None], tried, places)
        values = np.where(accepted, found, values)
        if step >= STEPS - 8:
            gathered.append((places, values))
    return (
        np.concatenate([some for some, _ in gathered[1:]]),
        np.concatenate([some for _, some in gathered[1:]]),
    )


def _reflected(places: Array) -> Array:
    """Back into the unit cube, mirrored at its walls."""
    folded: Array = 1.0 - np.abs(1.0 - np.mod(places, 2.0))
    return folded


def spread_out(places: Array, count: int, seed: int) -> Array:
    """Some of the places, each far from those chosen before: they fill their region.

    Chosen among four times as many drawn at random, lest all lie at the region's rim.

    Parameters
    ----------
    places
        Shape [place_count, dimensions].
    count
        How many are chosen.
    seed
        Of the first.
    """
    rng = np.random.default_rng(seed)
    places = places[rng.permutation(len(places))[: 4 * count]]
    spread = np.maximum(places.std(axis=0), 1e-9)
    scaled = places / spread
    chosen = [0]
    gap = np.linalg.norm(scaled - scaled[chosen[0]], axis=1)
    while len(chosen) < min(count, len(places)):
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, np.linalg.norm(scaled - scaled[chosen[-1]], axis=1))
    return places[chosen]
