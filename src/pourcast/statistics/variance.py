"""How much a model's deterministic judgments vary over the window of dampings."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pourcast.statistics.jackknife import FEWEST

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WindowVariance:
    """Variance over a window of dampings.

    Parameters
    ----------
    per_scene
        Shape [scene_count].
    mean, low, high
        Mean over the scenes, and its interval over scenes (Student's t); NaN with fewer than five.
    """

    per_scene: Array
    mean: float
    low: float
    high: float


def window_variance(judgments: Array, level: float) -> WindowVariance:
    """Variance of judgments over a window, mean over scenes.

    Parameters
    ----------
    judgments
        Deterministic judgments, shape [damping_count, scene_count].
    level
        Of the interval.
    """
    per_scene: Array = judgments.var(axis=0, ddof=1)
    mean, low, high = float(per_scene.mean()), np.nan, np.nan
    if len(per_scene) >= FEWEST:
        low, high = stats.t.interval(level, len(per_scene) - 1, mean, stats.sem(per_scene))
    return WindowVariance(per_scene, mean, float(low), float(high))


def unpaired_t(first: Array, second: Array) -> tuple[float, float, float]:
    """Student's unpaired t-test of two conditions: t, degrees of freedom, two-sided p."""
    test = stats.ttest_ind(first, second)
    return float(test.statistic), float(test.df), float(test.pvalue)
