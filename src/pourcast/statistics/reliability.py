"""How reliable people's mean judgments are, and how much a model could explain at best."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.statistics.bootstrap import random_halves
from pourcast.statistics.correlation import agreement, mean_judgments

Array = NDArray[np.float64]

SPLITS = 1000
"""Random halvings of the participants."""

FEWEST_PARTICIPANTS = 4
"""With fewer, a half is a single person."""

_BLOCK = 200
_NO_SPREAD = 1e-12
"""Variance of means below which a resample of scenes holds one scene again and again."""


def spearman_brown(r: Array) -> Array:
    """Reliability of twice as many participants (Spearman 1910, Brown 1910).

    Examples
    --------
    >>> float(spearman_brown(np.array(0.5)).round(3))
    0.667
    """
    doubled: Array = 2.0 * r / np.where(r > -1.0, 1.0 + r, np.nan)
    return doubled


@dataclass(frozen=True)
class Halves:
    """Mean judgments of both halves, shape [split_count, scene_count]; NaN without answers."""

    first: Array
    second: Array

    def correlations(self) -> Array:
        """Correlation of the halves in each split, shape [split_count]."""
        once = np.ones((1, self.first.shape[1]))
        r: Array = _rowwise(self.first, self.second, once)[0]
        return r

    def mean_correlations(self, scene_counts: Array) -> Array:
        """Mean over the splits, in each resample of scenes, shape [resample_count].

        Parameters
        ----------
        scene_counts
            How often each scene is drawn, shape [resample_count, scene_count].
        """
        blocks = np.array_split(scene_counts, max(1, len(scene_counts) // _BLOCK))
        blocks_r = [_rowwise(self.first, self.second, block).mean(axis=1) for block in blocks]
        return np.concatenate(blocks_r)


def _rowwise(x: Array, y: Array, weights: Array) -> Array:
    """Correlations of rows of x with the same rows of y, shape [weight_count, row_count]."""
    both = np.isfinite(x) & np.isfinite(y)
    centre = np.nanmean(x), np.nanmean(y)
    x, y = np.where(both, x - centre[0], 0.0), np.where(both, y - centre[1], 0.0)
    total = weights @ both.T
    mean_x, mean_y = weights @ x.T / total, weights @ y.T / total
    covariance = weights @ (x * y).T / total - mean_x * mean_y
    variances = (weights @ (x * x).T / total - mean_x**2) * (
        weights @ (y * y).T / total - mean_y**2
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        r: Array = np.where(variances > 0, covariance / np.sqrt(variances), np.nan)
    return r


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


def reliability(responses: Array, scene_counts: Array | None = None) -> Array:
    """Share of the variance of mean judgments that is not noise, in each resample of scenes.

    One minus the mean squared standard error over the variance of the means: what
    split halves with Spearman-Brown tend to, without splitting (Cronbach's alpha is the
    same for complete data once each participant's level is taken out).

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer. Scenes with
        fewer than two answers don't count.
    scene_counts
        How often each scene is drawn, shape [resample_count, scene_count]; once, by default.

    Returns
    -------
    ndarray
        Shape [resample_count], or a single number; NaN if noise explains all of it, or
        fewer than two scenes count.
    """
    counts = np.ones((1, responses.shape[1])) if scene_counts is None else scene_counts
    answers = np.isfinite(responses).sum(axis=0)
    means = mean_judgments(responses)
    squares = np.where(np.isfinite(responses), (responses - means) ** 2, 0.0).sum(axis=0)
    usable = answers >= 2
    if usable.sum() < 2:
        return np.full(len(counts), np.nan) if scene_counts is not None else np.array(np.nan)
    error = np.where(usable, squares / np.maximum(1, (answers - 1) * answers), 0.0)
    weights = counts * usable
    total = weights.sum(axis=1)
    y = np.where(usable, means - np.mean(means[usable]), 0.0)
    # What divides by no spread is no number, and left out below.
    with np.errstate(divide="ignore", invalid="ignore"):
        # n - 1, as in an unbiased variance of the scenes that were drawn.
        spread = (weights @ (y * y) - (weights @ y) ** 2 / total) / (total - 1.0)
        share = 1.0 - (weights @ error) / total / np.where(spread > _NO_SPREAD, spread, 0.0)
    known = np.where(share > 0.0, share, np.nan)
    return known if scene_counts is not None else known[0]


def explained_share(responses: Array, models: Array, scene_counts: Array | None = None) -> Array:
    """Share of the explainable variance that each model explains: r squared over reliability.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count].
    models
        Shape [model_count, scene_count].
    scene_counts
        As for `reliability`.

    Returns
    -------
    ndarray
        Shape [resample_count, model_count], or [model_count]; may exceed 1 by chance.
    """
    means = mean_judgments(responses)
    if scene_counts is None:
        share: Array = agreement(means, models).r ** 2 / reliability(responses)
        return share
    weights = scene_counts * np.isfinite(means)
    r = agreement(np.broadcast_to(means, weights.shape), models, weights).r
    within: Array = r**2 / reliability(responses, scene_counts)[:, None]
    return within
