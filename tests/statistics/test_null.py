import numpy as np
import pytest
from scipy import stats

from pourcast.statistics.null import against_null, fit_beta, individual_correlations


def test_beta_is_recovered():
    values = np.random.default_rng(0).beta(1.3, 0.8, 200_000)
    assert fit_beta(values) == pytest.approx((1.3, 0.8), rel=0.02)


def test_zeros_and_ones_are_taken():
    a, b = fit_beta(np.array([0.0, 1.0, 0.5, 0.5]))
    assert a == pytest.approx(b)


@pytest.mark.parametrize("values", [[0.5, 0.5], [0.0, 1.0]])
def test_no_beta_distribution(values):
    with pytest.raises(ValueError, match="no beta"):
        fit_beta(np.array(values))


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
