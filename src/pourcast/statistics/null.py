"""Single participants against chance: responses drawn from a beta distribution, scenes permuted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp

from pourcast.statistics.correlation import mean_judgments, pearson
from pourcast.statistics.jackknife import fisher_z

Array = NDArray[np.float64]

NULL_DRAWS = 10_000

_NO_TOTAL = 1e-9
"""Sum of the shapes of a beta distribution below which it gives 0 and 1 alone."""
_ROUNDING = 1e-12
_NEARLY_1 = 0.999
"""With a handful of scenes a correlation can be 1 by chance: its z must not drown all others."""


@dataclass(frozen=True)
class AgainstNull:
    """Participants' correlations with the truth, beside those of chance.

    Parameters
    ----------
    observed
        Each participant's r, shape [participant_count]; NaN where the answers are constant.
    null
        Correlations of simulated chance participants who answer the scenes that each participant
        answered, shape [draw_count, participant_count].
    beta
        The two shape parameters of the fitted distribution; 0 if all answers are 0 or 1.
    ks_statistic, ks_p
        Two-sample Kolmogorov-Smirnov test of the one against the other, as in the paper. Its p
        takes participants as independent, which those who saw the same scenes are not: where all
        share a heuristic that has nothing to do with the truth, it rejects too often.
    permutation_p
        One-sided p of the mean of participants' correlations (Fisher's z), all scenes' truths
        permuted: of people *and* scenes, whatever participants share.
    """

    observed: Array
    null: Array
    beta: tuple[float, float]
    ks_statistic: float
    ks_p: float
    permutation_p: float

    @property
    def p(self) -> Array:
        """For each participant the share of chance participants who do as well, at least."""
        as_well = (self.null >= self.observed).sum(axis=0)
        share = (as_well + 1.0) / (np.isfinite(self.null).sum(axis=0) + 1.0)
        return np.where(np.isfinite(self.observed), share, np.nan)


def fit_beta(values: Array) -> tuple[float, float]:
    """Shape parameters of a beta distribution with the mean and the variance of the values.

    By moments: the likelihood can't take the answers 0 and 1, which sliders give. If all are 0 or
    1, both shapes are 0: the distribution's limit, which gives nothing else either.

    Raises
    ------
    ValueError
        If the values have no spread.

    Examples
    --------
    >>> [round(shape, 6) for shape in fit_beta(np.array([0.25, 0.75]))]
    [1.5, 1.5]
    """
    mean, variance = float(np.nanmean(values)), float(np.nanvar(values))
    if not variance > 0.0:
        raise ValueError("all answers are the same")
    total = max(0.0, mean * (1.0 - mean) / variance - 1.0)
    total = 0.0 if total < _NO_TOTAL else total
    return mean * total, (1.0 - mean) * total


def _chance_answers(
    shapes: tuple[float, float], mean: float, size: tuple[int, int], rng: np.random.Generator
) -> Array:
    if shapes == (0.0, 0.0):
        return (rng.random(size) < mean).astype(float)
    return rng.beta(*shapes, size=size)


def individual_correlations(responses: Array, truth: Array) -> Array:
    """Each participant's correlation with one set of judgments, over the scenes answered.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count].
    truth
        Shape [scene_count].
    """
    return pearson(responses, truth[None])[:, 0]


def against_null(
    responses: Array, truth: Array, rng: np.random.Generator, draws: int = NULL_DRAWS
) -> AgainstNull:
    """Compare participants with chance (Bates et al., Results, "individual participants").

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count].
    truth
        Ground truth, shape [scene_count].
    rng
        Source of randomness.
    draws
        Simulated chance participants.
    """
    shapes, there = fit_beta(responses), np.isfinite(responses)
    answers = _chance_answers(shapes, float(np.nanmean(responses)), (draws, len(truth)), rng)
    null = _correlations_of_each(there, answers, truth)
    observed = individual_correlations(responses, truth)
    known, pooled = observed[np.isfinite(observed)], null[:, np.isfinite(observed)].ravel()
    pooled = pooled[np.isfinite(pooled)]
    statistic = p = np.nan
    if len(known) and len(pooled):
        test = ks_2samp(known, pooled)
        statistic, p = float(test.statistic), float(test.pvalue)
    permuted = _permutation_p(responses, truth, rng, draws)
    return AgainstNull(observed, null, shapes, statistic, p, permuted)


def _correlations_of_each(there: NDArray[np.bool_], answers: Array, truth: Array) -> Array:
    """Correlations of drawn answers with the truth, over the scenes that each person answered.

    Shape [draw_count, participant_count]; those who answered the same scenes share them.
    """
    masks, which = np.unique(there, axis=0, return_inverse=True)
    each = [
        pearson(answers[:, mask], truth[None, mask])[:, 0]
        if mask.sum() >= 2
        else np.full(len(answers), np.nan)
        for mask in masks
    ]
    return np.stack(each, axis=1)[:, which.ravel()]


def _permutation_p(responses: Array, truth: Array, rng: np.random.Generator, draws: int) -> float:
    """Share of permutations of the scenes' truths that agree with people as well, at least."""
    orders = np.argsort(rng.random((draws, len(truth))), axis=1)
    observed = mean_z(responses, truth[None])[0]
    permuted = mean_z(responses, truth[orders])
    if not np.isfinite(observed):
        return float("nan")
    as_well = (permuted >= observed - _ROUNDING).sum()
    return float((as_well + 1.0) / (np.isfinite(permuted).sum() + 1.0))


def mean_z(responses: Array, truths: Array) -> Array:
    """Mean over participants of their correlation's Fisher z, with each of some truths.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count].
    truths
        Shape [truth_count, scene_count].

    Returns
    -------
    ndarray
        Shape [truth_count]; NaN if no participant has a correlation.
    """
    there = np.isfinite(responses)
    counts = there.sum(axis=1)
    centred = np.where(there, responses - _row_means(responses)[:, None], 0.0)
    spread = (centred**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sums, squares = truths @ there.T, truths**2 @ there.T
        other = np.maximum(squares - sums**2 / counts, 0.0)
        known = (spread > _ROUNDING) & (other > _ROUNDING)
        r = np.where(known, truths @ centred.T / np.sqrt(spread * other), np.nan)
        z = fisher_z(np.clip(r, -_NEARLY_1, _NEARLY_1))
        mean: Array = np.where(known, z, 0.0).sum(axis=1) / known.sum(axis=1)
    return mean


def _row_means(responses: Array) -> Array:
    return mean_judgments(responses.T)
