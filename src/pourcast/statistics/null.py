"""Single participants against chance: responses drawn from a beta distribution."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp

from pourcast.statistics.correlation import pearson

Array = NDArray[np.float64]

NULL_DRAWS = 10_000


@dataclass(frozen=True)
class AgainstNull:
    """Participants' correlations with the truth, beside those of chance.

    Parameters
    ----------
    observed
        Each participant's r, shape [participant_count]; NaN where the answers are constant.
    null
        Correlations of simulated chance participants, shape [draw_count].
    beta
        The two shape parameters of the fitted distribution.
    ks_statistic, ks_p
        Two-sample Kolmogorov-Smirnov test of the one against the other.
    """

    observed: Array
    null: Array
    beta: tuple[float, float]
    ks_statistic: float
    ks_p: float

    @property
    def p(self) -> Array:
        """For each participant the share of chance participants who do as well, at least."""
        ranks = np.searchsorted(np.sort(self.null), self.observed, side="left")
        share = (len(self.null) - ranks + 1.0) / (len(self.null) + 1.0)
        return np.where(np.isfinite(self.observed), share, np.nan)


def fit_beta(values: Array) -> tuple[float, float]:
    """Shape parameters of a beta distribution with the mean and the variance of the values.

    By moments: the likelihood can't take the answers 0 and 1, which sliders give.

    Raises
    ------
    ValueError
        If the values have no spread, or more than any beta distribution.

    Examples
    --------
    >>> [round(shape, 6) for shape in fit_beta(np.array([0.25, 0.75]))]
    [1.5, 1.5]
    """
    mean, variance = float(np.nanmean(values)), float(np.nanvar(values))
    if not 0.0 < variance < mean * (1.0 - mean):
        raise ValueError("no beta distribution has this mean and variance")
    total = mean * (1.0 - mean) / variance - 1.0
    return mean * total, (1.0 - mean) * total


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
    shapes = fit_beta(responses)
    null = individual_correlations(rng.beta(*shapes, size=(draws, len(truth))), truth)
    observed = individual_correlations(responses, truth)
    test = ks_2samp(observed[np.isfinite(observed)], null)
    return AgainstNull(observed, null, shapes, float(test.statistic), float(test.pvalue))
