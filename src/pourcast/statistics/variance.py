"""How much a model's deterministic judgments vary over the window of dampings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pourcast.statistics.bootstrap import RESAMPLES, draw_counts, interval

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WindowVariance:
    """Variance over a window of dampings.

    Parameters
    ----------
    per_scene
        Shape [scene_count].
    mean, low, high
        Mean over the scenes, and its bootstrap interval, scenes resampled.
    """

    per_scene: Array
    mean: float
    low: float
    high: float


def window_variance(
    judgments: Array, rng: np.random.Generator, level: float, resamples: int = RESAMPLES
) -> WindowVariance:
    """Variance of judgments over a window, mean over scenes.

    Parameters
    ----------
    judgments
        Deterministic judgments, shape [damping_count, scene_count].
    rng
        Source of randomness.
    level
        Of the interval.
    resamples
        Of the scenes.
    """
    per_scene: Array = judgments.var(axis=0, ddof=1)
    counts = draw_counts(len(per_scene), resamples, rng)
    low, high = interval(counts @ per_scene / len(per_scene), level)
    return WindowVariance(per_scene, float(per_scene.mean()), float(low), float(high))


def unpaired_t(first: Array, second: Array) -> tuple[float, float, float]:
    """Student's unpaired t-test of two conditions: t, degrees of freedom, two-sided p."""
    test = stats.ttest_ind(first, second)
    return float(test.statistic), float(test.df), float(test.pvalue)
