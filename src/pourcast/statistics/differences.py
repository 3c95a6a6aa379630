"""Which of two models agrees better with people: paired differences of r, or of RMSE."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from pourcast.statistics.correlation import agreement
from pourcast.statistics.jackknife import SCALES, Estimate, Over, Scale, jackknife

Array = NDArray[np.float64]

PairMeasure = Literal["r", "rmse"]
"""By which one of two models may be nearer to people."""

NEARER: Mapping[PairMeasure, int] = {"r": 1, "rmse": -1}
"""Sign of a difference where the first model is nearer to people."""

_DRAWS = 4096
_POINTS = stats.norm.ppf(qmc.Sobol(2, scramble=True, rng=0).random(_DRAWS)).T[:, :, None]
"""A bivariate normal distribution, shape [2, point_count, 1]."""

_LEAST_LEVEL = 1e-6
"""Of an interval that is hardly more than its middle."""


@dataclass(frozen=True)
class Differences:
    """Differences between pairs of models in a measure, each of shape [pair_count].

    Parameters
    ----------
    first, second
        Numbers of the models of each pair.
    single
        Each model's measure on its scale (of r, Fisher's z), shape [model_count].
    paired
        Difference of each pair on that scale.
    scale
        The scale.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    single: Estimate
    paired: Estimate
    scale: Scale = SCALES["r"]

    @property
    def difference(self) -> Array:
        """Of the first minus the second."""
        values: Array = self.scale.back(self.single.value)
        return values[self.first] - values[self.second]

    @property
    def p(self) -> Array:
        """Two-sided, of no difference, before any correction; NaN where it can't be told."""
        return self.paired.p

    def interval(self, level: float) -> tuple[Array, Array]:
        """Limits of the difference.

        Errors of both on the scale, as they go together, are carried over to it by a normal
        distribution of `_DRAWS` points, the same ones each time.
        """
        one, other = self.single[self.first], self.single[self.second]
        return _ends(one, other, self.paired, self.scale, level)

    def equivalence(self, level: float) -> Array:
        """The smallest region about 0 within which the difference is shown to lie.

        Two one-sided tests (Schuirmann 1987), each at 1 - level: two models that may differ by
        as much for all that matters are equivalent. NaN where it can't be told.
        """
        low, high = self.interval(max(2.0 * level - 1.0, _LEAST_LEVEL))
        return np.maximum(-low, high)


def compare_pairs(
    responses: Array, models: Array, over: Over, by: PairMeasure = "r"
) -> Differences:
    """Compare all pairs of models on the same people and scenes.

    On the measure's scale, where errors are normal: Fisher's z of r, the logarithm of RMSE.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    models
        Judgments, shape [model_count, scene_count].
    over
        What the difference must hold over.
    by
        What is compared.
    """
    count, scale = len(models), SCALES[by]
    first, second = np.triu_indices(count, 1)

    def measure(means: Array, weights: Array) -> Array:
        each = scale.there(getattr(agreement(means, models, weights), by))
        return np.hstack([each, each[:, first] - each[:, second]])

    found = jackknife(responses, measure, over)
    return Differences(first, second, found[:count], found[count:], scale)


def holm(p: Array) -> Array:
    """P values corrected for their number (Holm 1979); NaN stays, and doesn't count.

    Examples
    --------
    >>> holm(np.array([0.01, np.nan, 0.04, 0.03])).tolist()
    [0.03, nan, 0.06, 0.06]
    """
    order = np.argsort(p)[: int(np.isfinite(p).sum())]
    corrected = np.full(len(p), np.nan)
    steps = p[order] * np.arange(len(order), 0, -1)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected


def _ends(
    one: Estimate, other: Estimate, difference: Estimate, scale: Scale, level: float
) -> tuple[Array, Array]:
    """Interval of the difference of two measures, from that on their scale."""
    # The first error, and what the second has besides: so the difference keeps its variance.
    covariance = 0.5 * (one.variance + other.variance - difference.variance)
    error = np.sqrt(one.variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(one.variance > 0.0, covariance / one.variance, 0.0)
    rest = np.sqrt(np.maximum(other.variance - slope**2 * one.variance, 0.0))
    tail = 0.5 + level / 2.0
    points = _POINTS * (stats.t.ppf(tail, difference.df) / stats.norm.ppf(tail))
    a = one.value + error * points[0]
    b = other.value + slope * error * points[0] + rest * points[1]
    low, high = np.quantile(scale.back(a) - scale.back(b), (1.0 - tail, tail), axis=0)
    observed = scale.back(one.value) - scale.back(other.value)
    known = np.isfinite(difference.variance)
    return (
        np.where(known, np.minimum(low, observed), np.nan),
        np.where(known, np.maximum(high, observed), np.nan),
    )
