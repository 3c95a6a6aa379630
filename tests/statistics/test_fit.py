import numpy as np
import pytest
from scipy import stats

from pourcast.statistics.fit import flat, profile, tied
from pourcast.statistics.halves import random_halves
from pourcast.statistics.jackknife import Estimate
from pourcast.statistics.variance import unpaired_t, window_variance


def test_profile_is_the_best_of_each_level():
    scores = np.array([[0.1, np.nan, 0.3, 0.2], [0.9, 0.1, 0.2, 0.4]])
    found = profile(scores, np.array([0, 0, 1, 1]))
    assert found.tolist() == [[0.1, 0.3], [0.9, 0.4]]


def test_ties_are_found():
    assert tied(np.array([0.3, 0.5, np.nan, 0.5])) == [1, 3]
    assert tied(np.array([np.nan, np.nan])) == []


def test_flat_optimum():
    shortfall = Estimate(
        np.array([0.0, 0.05, 0.01, 0.05]),
        np.array([0.0, 1e-4, 1e-4, np.nan]),
        np.full(4, 30.0),
    )
    assert flat(shortfall, 0.95).tolist() == [True, False, True, True]


def test_halves_are_halves():
    halves = random_halves(9, 200, np.random.default_rng(0))
    assert set(np.unique(halves)) == {0.0, 1.0}
    assert (halves.sum(axis=1) == 4).all()
    assert halves.mean(axis=0) == pytest.approx(np.full(9, 4 / 9), abs=0.12)


def test_variance_over_the_window():
    rng = np.random.default_rng(0)
    judgments = rng.normal(0.5, 0.1, (9, 200))
    found = window_variance(judgments, 0.95)
    assert found.mean == pytest.approx(np.var(judgments, axis=0, ddof=1).mean())
    assert found.low < 0.01 < found.high
    assert np.isnan(window_variance(judgments[:, :3], 0.95).low)
    t, df, p = unpaired_t(found.per_scene, found.per_scene * 2)
    theirs = stats.ttest_ind(found.per_scene, found.per_scene * 2)
    assert (t, df, p) == pytest.approx((theirs.statistic, 398, theirs.pvalue))
