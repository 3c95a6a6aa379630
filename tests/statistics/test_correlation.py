import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from pourcast.statistics.correlation import agreement, mean_judgments, pearson

unit = st.floats(0, 1, allow_subnormal=False)


@settings(max_examples=50, deadline=None)
@given(arrays(float, 12, elements=unit), arrays(float, (3, 12), elements=unit))
def test_as_scipy_says(people, models):
    found = agreement(people, models)
    for k, model in enumerate(models):
        assert found.rmse[k] == pytest.approx(np.sqrt(np.mean((people - model) ** 2)), abs=1e-7)
        assert found.bias[k] == pytest.approx(np.mean(people - model), abs=1e-12)
        if min(people.std(), model.std()) > 1e-3:
            line = stats.linregress(model, people)
            assert found.r[k] == pytest.approx(line.rvalue, abs=1e-7)
            assert found.slope[k] == pytest.approx(line.slope, rel=1e-6, abs=1e-7)


@settings(max_examples=30, deadline=None)
@given(arrays(int, 8, elements=st.integers(0, 3)), st.integers(0, 1000))
def test_a_weight_is_a_repetition(counts, seed):
    rng = np.random.default_rng(seed)
    people, models = rng.random(8), rng.random((2, 8))
    if (counts > 0).sum() < 3:
        return
    weighted = agreement(people[None], models, counts[None].astype(float))
    repeated = agreement(np.repeat(people, counts), np.repeat(models, counts, axis=1))
    for measure in ("r", "rmse", "bias", "slope"):
        assert getattr(weighted, measure)[0] == pytest.approx(getattr(repeated, measure), abs=1e-9)


def test_without_spread_there_is_no_correlation():
    found = agreement(np.array([0.1, 0.5, 0.9]), np.array([[0.3, 0.3, 0.3], [0.1, 0.5, 0.9]]))
    assert np.isnan(found.r[0])
    assert np.isnan(found.slope[0])
    assert found.r[1] == pytest.approx(1.0)
    assert found.rmse[1] == pytest.approx(0.0, abs=1e-7)


def test_a_scene_that_nobody_answered_counts_for_nothing():
    responses = np.array([[0.2, np.nan, 0.6, 0.5], [0.4, np.nan, np.nan, 0.7]])
    means = mean_judgments(responses)
    assert means[[0, 2, 3]] == pytest.approx([0.3, 0.6, 0.6])
    assert np.isnan(means[1])
    models = np.array([[0.1, 0.9, 0.7, 0.2]])
    there = [0, 2, 3]
    assert pearson(means, models) == pytest.approx(pearson(means[there], models[:, there]))
