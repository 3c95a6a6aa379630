"""How reliable people's mean judgments are, and how much a model could explain at best."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.statistics.correlation import agreement, mean_judgments
from pourcast.statistics.halves import random_halves
from pourcast.statistics.jackknife import r_interval

Array = NDArray[np.float64]

SPLITS = 1000
"""Random halvings of the participants."""

FEWEST_PARTICIPANTS = 4
"""With fewer, a half is a single person."""

_BLOCK = 200
_NO_SPREAD = 1e-12
"""Variance of means below which they don't differ."""


def spearman_brown(r: Array) -> Array:
    """Reliability of twice as many participants (Spearman 1910, Brown 1910).

    NaN where halves don't agree at all (r of 0 or less): there is nothing to extrapolate.

    Examples
    --------
    >>> float(spearman_brown(np.array(0.5)).round(3))
    0.667
    """
    doubled: Array = 2.0 * r / (1.0 + np.where(r > 0.0, r, np.nan))
    return doubled


def ceiling(reliability: Array) -> Array:
    """The r that a perfect model can expect: the root of the reliability, 0 without any signal."""
    expected: Array = np.sqrt(np.clip(reliability, 0.0, 1.0))
    return expected


@dataclass(frozen=True)
class Halves:
    """Mean judgments of both halves, shape [split_count, scene_count]; NaN without answers."""

    first: Array
    second: Array

    def mean_correlations(self, scene_counts: Array) -> Array:
        """Mean over the splits in which the halves have a correlation, shape [case_count].

        Parameters
        ----------
        scene_counts
            How often each scene counts, shape [case_count, scene_count].
        """
        blocks = np.array_split(scene_counts, max(1, len(scene_counts) // _BLOCK))
        means = []
        for block in blocks:
            r = _rowwise(self.first, self.second, block)
            known = np.isfinite(r)
            with np.errstate(invalid="ignore"):
                means.append(np.where(known, r, 0.0).sum(axis=1) / known.sum(axis=1))
        return np.concatenate(means)


def _rowwise(x: Array, y: Array, weights: Array) -> Array:
    """Correlations of rows of x with the same rows of y, shape [weight_count, row_count]."""
    both = np.isfinite(x) & np.isfinite(y)
    if not both.any():
        return np.full((len(weights), len(x)), np.nan)
    x, y = (np.where(both, each - each[both].mean(), 0.0) for each in (x, y))
    with np.errstate(divide="ignore", invalid="ignore"):
        total = weights @ both.T
        mean_x, mean_y = weights @ x.T / total, weights @ y.T / total
        covariance = weights @ (x * y).T / total - mean_x * mean_y
        spread_x = weights @ (x * x).T / total - mean_x**2
        spread_y = weights @ (y * y).T / total - mean_y**2
        known = (spread_x > _NO_SPREAD) & (spread_y > _NO_SPREAD)
        r = np.where(known, covariance / np.sqrt(spread_x * spread_y), np.nan)
    clipped: Array = np.clip(r, -1.0, 1.0)
    return clipped


def split_half(responses: Array, rng: np.random.Generator, splits: int = SPLITS) -> Halves:
    """Halve the participants at random, many times.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    rng
        Source of randomness.
    splits
        How many times.

    Raises
    ------
    ValueError
        If there are fewer than 4 participants.
    """
    people = len(responses)
    if people < FEWEST_PARTICIPANTS:
        raise ValueError(f"a split needs at least {FEWEST_PARTICIPANTS} participants, not {people}")
    first = random_halves(people, splits, rng)
    return Halves(_half_means(responses, first), _half_means(responses, 1.0 - first))


def _half_means(responses: Array, chosen: Array) -> Array:
    answered = np.isfinite(responses)
    with np.errstate(divide="ignore", invalid="ignore"):
        means: Array = chosen @ np.where(answered, responses, 0.0) / (chosen @ answered)
    return means


def reliability(responses: Array, weights: Array | None = None) -> Array:
    """Share of the variance of mean judgments that is not noise.

    Noise is what these participants' means would change by if others had answered: the variance
    over scenes that each participant adds to the means. What can't lower a correlation adds none:
    a participant's constant level, where all answer all scenes, and how strongly a participant
    follows what all have in common (what each adds is regressed on the means, which costs a
    degree of freedom). Without the latter it would be Cronbach's alpha.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer. Scenes with
        fewer than two answers don't count.
    weights
        How often each scene counts, shape [case_count, scene_count]; once, by default.

    Returns
    -------
    ndarray
        Shape [case_count], or a single number; below 0 if there is more noise than is usual
        without any signal, NaN if fewer than three scenes count or the means don't differ.
    """
    there = np.isfinite(responses)
    answers = there.sum(axis=0)
    usable = answers >= 2
    means = np.where(usable, mean_judgments(responses), 0.0)
    counts = usable * (np.ones((1, len(usable))) if weights is None else weights)
    root = np.sqrt(np.maximum(1, answers * (answers - 1)))
    added = np.where(there & usable, (np.where(there, responses, 0.0) - means) / root, 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        total = counts.sum(axis=1)
        spread = _covariances(means[None], means, counts)[:, 0]
        along = _covariances(added, means, counts) ** 2 / spread[:, None]
        noise = (_covariances(added, None, counts) - along).sum(axis=1)
        noise *= (total - 1.0) / (total - 2.0)
        known = (spread > _NO_SPREAD) & (total > 2.0)
        share: Array = np.where(known, 1.0 - noise / spread, np.nan)
    return share[0] if weights is None else share


def _covariances(rows: Array, other: Array | None, counts: Array) -> Array:
    """Unbiased covariance of each row with another, or itself, over the scenes that count.

    Shape [case_count, row_count].
    """
    total = counts.sum(axis=1, keepdims=True)
    x = rows - rows.mean(axis=1, keepdims=True)
    y = x if other is None else other[None] - other.mean()
    products = counts @ (x * y).T - (counts @ x.T) * (counts @ y.T) / total
    covariances: Array = products / (total - 1.0)
    return covariances


def explained_share(responses: Array, models: Array) -> Array:
    """Share of the explainable variance that each model explains: r squared over reliability.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count].
    models
        Shape [model_count, scene_count].

    Returns
    -------
    ndarray
        Shape [model_count]. May exceed 1 by chance, as both its parts are estimates; NaN where
        nothing can be explained (a reliability of 0 or less).
    """
    r = agreement(mean_judgments(responses), models).r
    return _over_reliability(r**2, responses)


def explained_interval(responses: Array, models: Array, level: float) -> tuple[Array, Array]:
    """Interval of `explained_share` over scenes: that of r, squared, over the reliability."""
    low, high = r_interval(responses, models, "scenes", level)
    least = np.where((low < 0.0) & (high > 0.0), 0.0, np.minimum(low**2, high**2))
    most = np.maximum(low**2, high**2)
    return _over_reliability(least, responses), _over_reliability(most, responses)


def _over_reliability(squares: Array, responses: Array) -> Array:
    share = reliability(responses)
    over: Array = squares / np.where(share > 0.0, share, np.nan)
    return over
