import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pourcast.statistics.bootstrap import draw_counts
from pourcast.statistics.reliability import (
    explained_share,
    reliability,
    spearman_brown,
    split_half,
)


def noisy_study(seed, people, scenes, signal, noise):
    """Answers whose means have the reliability signal^2 / (signal^2 + noise^2 / people)."""
    rng = np.random.default_rng(seed)
    truth = signal * rng.standard_normal(scenes)
    return truth, truth + noise * rng.standard_normal((people, scenes))


@pytest.mark.parametrize(("people", "noise"), [(10, 1.0), (20, 2.0), (7, 0.5)])
def test_known_reliability_is_found(people, noise):
    _, responses = noisy_study(1, people, 4000, 1.0, noise)
    known = 1.0 / (1.0 + noise**2 / people)
    assert reliability(responses) == pytest.approx(known, abs=0.02)
    halves = split_half(responses, np.random.default_rng(0), 50)
    if people % 2 == 0:
        known_half = 1.0 / (1.0 + noise**2 / (people // 2))
        assert halves.correlations().mean() == pytest.approx(known_half, abs=0.02)
        assert spearman_brown(halves.correlations().mean()) == pytest.approx(known, abs=0.02)


def test_intervals_over_scenes_cover_the_reliability():
    covered, known = 0, 1.0 / (1.0 + 1.5**2 / 12)
    for seed in range(100):
        _, responses = noisy_study(seed, 12, 100, 1.0, 1.5)
        counts = draw_counts(100, 500, np.random.default_rng(seed))
        low, high = np.percentile(reliability(responses, counts), [2.5, 97.5])
        covered += low <= known <= high
    assert covered >= 87  # 95 expected; 87 is 3.7 standard errors below, and bootstraps are narrow


@settings(max_examples=30, deadline=None)
@given(st.integers(4, 9), st.integers(0, 1000))
def test_every_split_has_two_halves(people, seed):
    rng = np.random.default_rng(seed)
    responses = rng.random((people, 5))
    halves = split_half(responses, rng, 20)
    first = people // 2
    together = (halves.first * first + halves.second * (people - first)) / people
    assert together == pytest.approx(np.broadcast_to(responses.mean(axis=0), (20, 5)))


def test_missing_answers_are_left_out():
    _, responses = noisy_study(2, 12, 60, 1.0, 0.5)
    responses[3, 7] = responses[5, :10] = np.nan
    found = split_half(responses, np.random.default_rng(0), 100).correlations()
    assert np.isfinite(found).all()
    assert found.mean() > 0.85
    assert 0.9 < reliability(responses) < 1.0


def test_too_few_participants_for_a_split():
    with pytest.raises(ValueError, match="at least 4 participants, not 3"):
        split_half(np.zeros((3, 5)), np.random.default_rng(0))


def test_resampled_mean_correlations_agree_with_plain_ones():
    _, responses = noisy_study(3, 10, 40, 1.0, 1.0)
    halves = split_half(responses, np.random.default_rng(0), 30)
    once = halves.mean_correlations(np.ones((1, 40)))
    loop = [np.corrcoef(a, b)[0, 1] for a, b in zip(halves.first, halves.second, strict=True)]
    assert once[0] == pytest.approx(np.mean(loop))


def test_a_perfect_model_explains_what_there_is_to_explain():
    truth, responses = noisy_study(4, 15, 3000, 1.0, 2.0)
    worse = truth + 1.0 * np.random.default_rng(9).standard_normal(3000)
    share = explained_share(responses, np.stack([truth, worse]))
    assert share == pytest.approx([1.0, 0.5], abs=0.05)


def test_pure_noise_has_no_reliability():
    responses = np.random.default_rng(0).random((5, 6))
    responses -= responses.mean(axis=0)
    assert np.isnan(reliability(responses))


def test_one_participant_tells_nothing_of_noise():
    one = np.random.default_rng(0).random((1, 6))
    assert np.isnan(reliability(one))
    assert np.isnan(reliability(one, np.ones((3, 6)))).all()


def test_resamples_without_any_spread_are_no_number_and_warn_of_nothing():
    responses = np.array([[0.1, 0.5, 0.9], [0.2, 0.4, 0.7], [0.0, 0.6, 0.8]])
    counts = np.array([[3, 0, 0], [0, 0, 3], [1, 1, 1]])
    shares = reliability(responses, counts)
    assert np.isnan(shares[:2]).all()
    assert 0.0 < shares[2] < 1.0
