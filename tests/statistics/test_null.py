import numpy as np
import pytest
from scipy import stats

from pourcast.statistics.null import (
    against_null,
    fit_beta,
    individual_correlations,
    mean_z,
)


def test_beta_is_recovered():
    values = np.random.default_rng(0).beta(1.3, 0.8, 200_000)
    assert fit_beta(values) == pytest.approx((1.3, 0.8), rel=0.02)


def test_zeros_and_ones_are_taken():
    a, b = fit_beta(np.array([0.0, 1.0, 0.5, 0.5]))
    assert a == pytest.approx(b)


def test_answers_that_are_all_0_or_1_have_a_limit_of_beta_and_equal_ones_none():
    assert fit_beta(np.array([0.0, 1.0, 1.0])) == (0.0, 0.0)
    with pytest.raises(ValueError, match="all answers are the same"):
        fit_beta(np.array([0.5, 0.5]))
    rng = np.random.default_rng(0)
    truth = rng.random(30)
    yes_or_no = (truth + 0.3 * rng.standard_normal((12, 30)) > 0.5).astype(float)
    found = against_null(yes_or_no, truth, rng, 2000)
    assert set(np.unique(np.round(found.null, 9))).isdisjoint({np.inf})
    assert (found.p < 0.05).mean() > 0.8
    assert found.permutation_p < 0.01


def test_chance_answers_the_scenes_that_a_participant_answered():
    rng = np.random.default_rng(3)
    truth, responses = rng.random(40), rng.random((3, 40))
    responses[1, 8:] = np.nan
    responses[2, 1:] = np.nan
    found = against_null(responses, truth, rng, 4000)
    spread = np.nanstd(found.null[:, :2], axis=0)
    assert spread == pytest.approx([1 / np.sqrt(39), 1 / np.sqrt(7)], rel=0.1)
    assert np.isnan(found.null[:, 2]).all()
    assert np.isnan(found.p[2])


def test_permuting_scenes_as_a_loop_says():
    rng = np.random.default_rng(4)
    truth, responses = rng.random(9), rng.random((4, 9))
    responses[2, :3] = np.nan
    found = mean_z(responses, np.stack([truth, truth[::-1]]))
    for number, one in enumerate((truth, truth[::-1])):
        r = [np.corrcoef(row[np.isfinite(row)], one[np.isfinite(row)])[0, 1] for row in responses]
        assert found[number] == pytest.approx(np.arctanh(r).mean())


def test_what_all_share_is_no_sign_of_the_truth():
    # 60 people who all judge by one heuristic: the paper's test rejects, permuting scenes doesn't.
    rejected, permuted = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        truth, heuristic = rng.random((2, 20))
        people = np.clip(heuristic + 0.15 * rng.standard_normal((60, 20)), 0, 1)
        found = against_null(people, truth, rng, 500)
        rejected.append(found.ks_p < 0.05)
        permuted.append(found.permutation_p < 0.05)
    assert np.mean(rejected) > 0.5
    assert np.mean(permuted) < 0.2


def test_correlations_of_single_participants_as_scipy_says():
    rng = np.random.default_rng(1)
    truth, responses = rng.random(20), rng.random((4, 20))
    responses[1, :5] = np.nan
    responses[3] = 0.4
    found = individual_correlations(responses, truth)
    assert found[0] == pytest.approx(stats.pearsonr(responses[0], truth).statistic)
    assert found[1] == pytest.approx(stats.pearsonr(responses[1, 5:], truth[5:]).statistic)
    assert np.isnan(found[3])


def test_guessers_are_not_told_from_chance_and_seers_are():
    rng = np.random.default_rng(2)
    truth = rng.random(60)
    guessers = rng.beta(1.5, 1.5, (40, 60))
    found = against_null(guessers, truth, rng)
    assert found.ks_p > 0.01
    assert (found.p < 0.05).mean() < 0.2
    seers = np.clip(truth + 0.2 * rng.standard_normal((40, 60)), 0, 1)
    found = against_null(seers, truth, rng)
    assert found.ks_p < 1e-10
    assert (found.p < 0.001).all()
