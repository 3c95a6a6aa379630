"""Bootstrap resamples of participants, of scenes, or of both crossed.

All resamples are drawn at once, as counts: a resample of people's means is then one
matrix product, and a paired difference between two models needs nothing but the
difference of two columns (Efron & Tibshirani 1993, chapters 8 and 16).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Resampled = Literal["participants", "scenes", "both"]
"""What is drawn again: the participants (the paper's intervals match this), the scenes, or
both, crossed."""

RESAMPLES = 10_000
"""The paper's number."""

LEVEL = 0.95
"""Of intervals, unless it is said; whatever makes one is told the level."""


@dataclass(frozen=True)
class Resamples:
    """People's mean judgments in each resample.

    Parameters
    ----------
    means
        Shape [resample_count, scene_count].
    weights
        How often each scene counts in each resample, of the same shape.
    """

    means: Array
    weights: Array


def draw_counts(count: int, resamples: int, rng: np.random.Generator) -> Array:
    """How often each of `count` things is drawn, shape [resamples, count]."""
    return rng.multinomial(count, np.full(count, 1.0 / count), size=resamples).astype(float)


def random_halves(count: int, halvings: int, rng: np.random.Generator) -> Array:
    """Half of `count` things, chosen at random many times: 1 if chosen, shape [halvings, count].

    Of an odd number, the chosen half is the smaller.
    """
    ranks = rng.random((halvings, count)).argsort(axis=1).argsort(axis=1)
    chosen: Array = (ranks < count // 2).astype(float)
    return chosen


def resample(
    responses: Array,
    resampled: Resampled,
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
) -> Resamples:
    """Draw participants, scenes or both again, with replacement.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    resampled
        What is drawn again.
    rng
        Source of randomness.
    resamples
        How many times.

    Returns
    -------
    Resamples
        A scene that nobody of a resample answered counts for nothing in it.
    """
    answered = np.isfinite(responses)
    people, scenes = responses.shape
    once = np.ones((1, people))
    counts = once if resampled == "scenes" else draw_counts(people, resamples, rng)
    answers = counts @ answered
    with np.errstate(divide="ignore", invalid="ignore"):
        means = counts @ np.where(answered, responses, 0.0) / answers
    weights = (answers > 0).astype(float)
    if resampled != "participants":
        weights = weights * draw_counts(scenes, resamples, rng)
        means = np.broadcast_to(means, weights.shape)
    return Resamples(means, weights)


def interval(values: Array, level: float) -> tuple[Array, Array]:
    """Percentile interval over the first axis; NaN if a resample gave none."""
    low, high = np.percentile(values, tails(level), axis=0)
    return low, high


def tails(level: float) -> tuple[float, float]:
    """Percentiles that an interval of a level lies between.

    Examples
    --------
    >>> tails(0.5)
    (25.0, 75.0)
    """
    tail = 50.0 * (1.0 - level)
    return tail, 100.0 - tail


def two_sided_p(differences: Array) -> Array:
    """Achieved significance level of differences from 0, over the first axis.

    Twice the smaller share of resamples on one side of 0, ties shared; one is added to
    both counts, so that no finite number of resamples gives 0 (Davison & Hinkley 1997).
    """
    count = len(differences)
    above = (differences > 0).sum(axis=0) + 0.5 * (differences == 0).sum(axis=0)
    smaller = np.minimum(above, count - above)
    p: Array = np.minimum(1.0, 2.0 * (smaller + 1.0) / (count + 1.0))
    return p
