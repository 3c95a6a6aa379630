"""What a design could have told apart: recovery of parameters and of models, and power.

Studies are simulated with `observer.Population` and analysed as real ones are.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from pourcast.progress import Progress, no_progress
from pourcast.statistics.correlation import pearson
from pourcast.statistics.differences import compare_pairs
from pourcast.statistics.jackknife import LEVEL, Over
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


@dataclass(frozen=True)
class Power:
    """Chance that a study tells two models apart, the right way round.

    Parameters
    ----------
    power
        Share of simulated studies that did.
    low, high
        Its interval (Wilson).
    wrong
        Share that told them apart the wrong way round.
    """

    power: float
    low: float
    high: float
    wrong: float


def power_of(
    true: Array,
    rival: Array,
    *,
    observers: int,
    scenes: int,
    studies: int,
    population: Population,
    rng: np.random.Generator,
    over: Over = "both",
    level: float = LEVEL,
) -> Power:
    """How often a study finds that the true model agrees better with people than a rival.

    Parameters
    ----------
    true, rival
        Judgments of the model in the observers' heads and of the rival, shape [scene_count].
    observers, scenes
        Size of the study. Its scenes are drawn from those given, without replacement if
        there are enough.
    studies
        How many are simulated.
    population
        How the observers answer.
    rng
        Source of randomness.
    over
        What the difference in r must hold over.
    level
        Of the test, and of the power's own interval.
    """
    both = np.stack([true, rival])
    available = both.shape[1]
    right = wrong = 0
    for _ in range(studies):
        shown = rng.choice(available, scenes, replace=scenes > available)
        styles = population.draw(observers, rng)
        responses = population.respond(true[shown], styles, rng)
        pair = compare_pairs(responses, both[:, shown], over, level)
        told = bool(pair.p[0] < 1.0 - level)
        right += told and pair.difference[0] > 0.0
        wrong += told and pair.difference[0] < 0.0
    limits = binomtest(right, studies).proportion_ci(level, method="wilson")
    return Power(right / studies, float(limits.low), float(limits.high), wrong / studies)
