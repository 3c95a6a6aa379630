"""Which parameters a design could tell apart: planted in simulated observers, and recovered."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pourcast.progress import Progress, no_progress
from pourcast.statistics.correlation import pearson
from pourcast.statistics.observer import Population, spread_over_grid

Array = NDArray[np.float64]
Counts = NDArray[np.int64]


def simulated_means(
    judgments: Array, observers: int, population: Population, rng: np.random.Generator
) -> Array:
    """Mean answers of one simulated study, shape [scene_count].

    Parameters
    ----------
    judgments
        What is in the heads, shape [scene_count] or [observers, scene_count].
    observers
        How many observers.
    population
        How they answer.
    rng
        Source of randomness.
    """
    styles = population.draw(observers, rng)
    means: Array = population.respond(judgments, styles, rng).mean(axis=0)
    return means


def recover_parameters(
    candidates: Array,
    planted: Sequence[int],
    *,
    observers: int,
    studies: int,
    population: Population,
    rng: np.random.Generator,
    spread: float = 0.0,
    progress: Progress = no_progress,
) -> Counts:
    """Plant each of some candidates and see which one fits best, many times.

    Parameters
    ----------
    candidates
        Judgments along one parameter, in its order, shape [candidate_count, scene_count].
    planted
        Which are planted.
    observers, studies
        Observers in a study, and studies for each planted one.
    population
        How the observers answer.
    rng
        Source of randomness.
    spread
        Observers' own parameters differ by this many grid steps (standard deviation).
    progress
        Called with (done, in all).

    Returns
    -------
    ndarray
        Number of the candidate that was recovered, shape [planted_count, studies].
    """
    recovered = np.empty((len(planted), studies), dtype=np.int64)
    progress(0, len(planted))
    for row, candidate in enumerate(planted):
        means = np.empty((studies, candidates.shape[1]))
        for study in range(studies):
            own = spread_over_grid(candidate, spread, len(candidates), observers, rng)
            means[study] = simulated_means(candidates[own], observers, population, rng)
        scores = pearson(means, candidates)
        recovered[row] = np.where(np.isnan(scores), -np.inf, scores).argmax(axis=1)
        progress(row + 1, len(planted))
    return recovered


def confusion(recovered: Counts, count: int) -> Counts:
    """How often each candidate was recovered, shape [planted_count, count]."""
    return np.stack([np.bincount(row, minlength=count) for row in recovered])
