"""Choosing parameters by correlation: optima, ties, flat optima, cross-validation."""

import numpy as np
from numpy.typing import NDArray

from pourcast.statistics.jackknife import Estimate

Array = NDArray[np.float64]

_TIE = 1e-9


def profile(scores: Array, levels: NDArray[np.int64]) -> Array:
    """Best score at each level of one parameter, whatever the others are.

    Parameters
    ----------
    scores
        Shape [..., candidate_count]; NaN counts as worst.
    levels
        Level of each candidate, 0, 1, ..., shape [candidate_count].

    Returns
    -------
    ndarray
        Shape [..., level_count].

    Examples
    --------
    >>> profile(np.array([0.2, 0.9, 0.5, 0.4]), np.array([0, 0, 1, 1])).tolist()
    [0.9, 0.5]
    """
    scores = np.where(np.isnan(scores), -np.inf, scores)
    count = int(levels.max()) + 1
    return np.stack([scores[..., levels == level].max(axis=-1) for level in range(count)], axis=-1)


def tied(scores: Array) -> list[int]:
    """Candidates with the best score, to the last digits; none if all are NaN."""
    if np.isnan(scores).all():
        return []
    return np.flatnonzero(scores >= np.nanmax(scores) - _TIE).tolist()


def flat(shortfall: Estimate, level: float) -> NDArray[np.bool_]:
    """Which candidates do as well as the best: the interval of the shortfall isn't all above 0.

    Parameters
    ----------
    shortfall
        Of each candidate, behind the best; nothing is told where its variance is unknown.
    level
        Of the intervals.
    """
    low, _ = shortfall.interval(level)
    as_good: NDArray[np.bool_] = ~(low > 0.0)
    return as_good
