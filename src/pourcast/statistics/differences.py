"""Which of two models agrees better with people: paired differences of correlations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.statistics.correlation import agreement
from pourcast.statistics.jackknife import Estimate, Over, fisher_z, jackknife

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Differences:
    """Differences in r between pairs of models, each of shape [pair_count].

    Parameters
    ----------
    first, second
        Numbers of the models of each pair.
    difference
        r of the first minus that of the second.
    low, high
        Its interval.
    p
        Two-sided, of no difference, before any correction; NaN where it can't be told.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    difference: Array
    low: Array
    high: Array
    p: Array


def compare_pairs(responses: Array, models: Array, over: Over, level: float) -> Differences:
    """Compare all pairs of models on the same people and scenes.

    The test is of the difference in Fisher's z, whose errors are normal. The interval is of the
    difference in r, from those of both and how their errors go together (Zou 2007, Psychological
    Methods 12): symmetric only where r is small.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    models
        Judgments, shape [model_count, scene_count].
    over
        What the difference must hold over.
    level
        Of the intervals.
    """
    count = len(models)
    first, second = np.triu_indices(count, 1)

    def measure(means: Array, weights: Array) -> Array:
        z = fisher_z(agreement(means, models, weights).r)
        return np.hstack([z, z[:, first] - z[:, second]])

    found = jackknife(responses, measure, over)
    single, paired = found[:count], found[count:]
    r, (low, high) = np.tanh(single.value), (np.tanh(end) for end in single.interval(level))
    together = _correlation(single[first], single[second], paired)
    difference = r[first] - r[second]
    below, above = (
        # Models that say the same differ by nothing, for sure.
        np.where(
            paired.variance == 0.0,
            0.0,
            _reach(r[one] - low[one], high[other] - r[other], together),
        )
        for one, other in ((first, second), (second, first))
    )
    return Differences(first, second, difference, difference - below, difference + above, paired.p)


def _correlation(one: Estimate, other: Estimate, difference: Estimate) -> Array:
    """Of the errors of two estimates, from their variances and that of the difference."""
    with np.errstate(divide="ignore", invalid="ignore"):
        together = one.variance + other.variance - difference.variance
        correlation = together / (2.0 * np.sqrt(one.variance * other.variance))
    # Without any error, all goes together.
    correlation = np.where((one.variance == 0.0) | (other.variance == 0.0), 1.0, correlation)
    clipped: Array = np.clip(correlation, -1.0, 1.0)
    return clipped


def _reach(one: Array, other: Array, correlation: Array) -> Array:
    square = one**2 + other**2 - 2.0 * correlation * one * other
    reach: Array = np.sqrt(np.maximum(square, 0.0))
    return reach
