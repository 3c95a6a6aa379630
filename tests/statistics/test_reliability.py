import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pourcast.statistics.reliability import (
    ceiling,
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
    half = halves.mean_correlations(np.ones((1, 4000)))[0]
    if people % 2 == 0:
        known_half = 1.0 / (1.0 + noise**2 / (people // 2))
        assert half == pytest.approx(known_half, abs=0.02)
        assert spearman_brown(half) == pytest.approx(known, abs=0.02)


def test_it_is_cronbachs_alpha_but_for_what_people_follow_more_or_less():
    _, responses = noisy_study(5, 40, 400, 1.0, 1.5)
    items = responses.var(axis=1, ddof=1).sum()
    alpha = 40 / 39 * (1 - items / responses.sum(axis=0).var(ddof=1))
    assert reliability(responses) == pytest.approx(alpha, abs=0.002)


def test_half_guessers_lower_a_perfect_models_r_by_their_noise_alone():
    shares, known = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        truth = rng.standard_normal(60)
        follows = np.repeat([1.0, 0.0], 6)[:, None]
        responses = follows * truth + rng.standard_normal((12, 60))
        shares.append(reliability(responses))
        known.append(0.5**2 / (0.5**2 + 1.0 / 12))
    assert np.mean(shares) == pytest.approx(np.mean(known), abs=0.045)


def test_peoples_levels_are_no_noise_where_all_answered_and_are_where_not():
    _, responses = noisy_study(6, 10, 60, 1.0, 1.0)
    moved = responses + np.linspace(-3, 3, 10)[:, None]
    assert reliability(moved) == pytest.approx(reliability(responses))
    missing = np.random.default_rng(0).random(moved.shape) < 0.5
    moved[missing] = responses[missing] = np.nan
    assert reliability(moved) < reliability(responses) - 0.1


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
    halves = split_half(responses, np.random.default_rng(0), 100)
    assert halves.mean_correlations(np.ones((1, 60)))[0] > 0.85
    assert 0.9 < reliability(responses) < 1.0


def test_too_few_participants_for_a_split():
    with pytest.raises(ValueError, match="at least 4 participants, not 3"):
        split_half(np.zeros((3, 5)), np.random.default_rng(0))


def test_mean_correlations_agree_with_plain_ones():
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
    assert np.isnan(explained_share(responses, responses[:1])[0])


def test_less_than_no_signal_is_below_0_and_its_ceiling_is_0():
    rng = np.random.default_rng(1)
    shares = np.array([reliability(rng.standard_normal((5, 12))) for _ in range(40)])
    assert shares.min() < 0.0 < shares.max()
    assert ceiling(shares)[shares < 0.0].max() == 0.0
    assert np.isnan(spearman_brown(np.array([-0.99, -0.2, 0.0]))).all()


def test_one_participant_tells_nothing_of_noise():
    one = np.random.default_rng(0).random((1, 6))
    assert np.isnan(reliability(one))
    assert np.isnan(reliability(one, np.ones((3, 6)))).all()


def test_scenes_without_any_spread_are_no_number_and_warn_of_nothing():
    responses = np.array([[0.1, 0.5, 0.9], [0.2, 0.4, 0.7], [0.0, 0.6, 0.8]])
    counts = np.array([[3, 0, 0], [0, 0, 3], [1, 1, 1]])
    shares = reliability(responses, counts)
    assert np.isnan(shares[:2]).all()
    assert 0.0 < shares[2] < 1.0
