"""Which of two models agrees better with people: paired differences of correlations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from pourcast.statistics.correlation import agreement
from pourcast.statistics.jackknife import Estimate, Over, fisher_z, jackknife

Array = NDArray[np.float64]

_DRAWS = 4096
_POINTS = stats.norm.ppf(qmc.Sobol(2, scramble=True, rng=0).random(_DRAWS)).T[:, :, None]
"""A bivariate normal distribution, shape [2, point_count, 1]."""

_LEAST_LEVEL = 1e-6
"""Of an interval that is hardly more than its middle."""


@dataclass(frozen=True)
class Differences:
    """Differences in r between pairs of models, each of shape [pair_count].

    Parameters
    ----------
    first, second
        Numbers of the models of each pair.
    single
        Fisher's z of each model, shape [model_count].
    paired
        Difference in z of each pair.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    single: Estimate
    paired: Estimate

    @property
    def difference(self) -> Array:
        """Of the first minus the second."""
        r: Array = np.tanh(self.single.value)
        return r[self.first] - r[self.second]

    @property
    def p(self) -> Array:
        """Two-sided, of no difference in z, before any correction; NaN where it can't be told."""
        return self.paired.p

    def interval(self, level: float) -> tuple[Array, Array]:
        """Limits of the difference in r.

        Errors of both z, as they go together, are carried over to it by a normal distribution of
        `_DRAWS` points, the same ones each time.
        """
        return _ends_in_r(self.single[self.first], self.single[self.second], self.paired, level)

    def equivalence(self, level: float) -> Array:
        """The smallest region about 0 within which the difference in r is shown to lie.

        Two one-sided tests (Schuirmann 1987), each at 1 - level: two models whose r may differ by
        as much for all that matters are equivalent. NaN where it can't be told.
        """
        low, high = self.interval(max(2.0 * level - 1.0, _LEAST_LEVEL))
        return np.maximum(-low, high)


def compare_pairs(responses: Array, models: Array, over: Over) -> Differences:
    """Compare all pairs of models on the same people and scenes, in Fisher's z.

    Its errors are normal.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    models
        Judgments, shape [model_count, scene_count].
    over
        What the difference must hold over.
    """
    count = len(models)
    first, second = np.triu_indices(count, 1)

    def measure(means: Array, weights: Array) -> Array:
        z = fisher_z(agreement(means, models, weights).r)
        return np.hstack([z, z[:, first] - z[:, second]])

    found = jackknife(responses, measure, over)
    return Differences(first, second, found[:count], found[count:])


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


def _ends_in_r(
    one: Estimate, other: Estimate, difference: Estimate, level: float
) -> tuple[Array, Array]:
    """Interval of the difference of two correlations, from that of their z."""
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
    low, high = np.quantile(np.tanh(a) - np.tanh(b), (1.0 - tail, tail), axis=0)
    observed = np.tanh(one.value) - np.tanh(other.value)
    known = np.isfinite(difference.variance)
    return (
        np.where(known, np.minimum(low, observed), np.nan),
        np.where(known, np.maximum(high, observed), np.nan),
    )
