"""Sensitivity to priors: of a mean whose posterior is known, and of what data say nothing of."""

import numpy as np
import pytest
from scipy.stats import norm

from pourcast.statistics.nuts import Sampler
from pourcast.statistics.prior_sensitivity import (
    SENSITIVE,
    STRONG_PRIOR,
    log_likelihood,
    log_prior,
    prior_sensitivity,
    sensitivity,
)
from pourcast.statistics.quadrature import DRAWN, density, eta_of, over_draws, places_of
from pourcast.statistics.response_model import PARAMETERS, Answers, priors, response_model
from tests.statistics.test_response_model import study


def of_a_mean(count, observed):
    """Sensitivities of the mean of normal data of SD 1, prior standard normal, by its posterior."""
    sd = 1.0 / np.sqrt(1.0 + count)
    draws = count * observed * sd**2 + sd * np.random.default_rng(0).standard_normal(4000)
    likelihood = norm.logpdf(observed, draws, 1.0 / np.sqrt(count))
    return sensitivity(draws, norm.logpdf(draws)), sensitivity(draws, likelihood)


def test_much_data_make_a_posterior_insensitive_to_its_prior():
    prior, data = of_a_mean(500, 0.3)
    assert prior < 0.2 * SENSITIVE
    assert data > SENSITIVE


def test_few_data_leave_a_posterior_to_its_prior():
    prior, data = of_a_mean(0.02, 0.0)
    assert prior > SENSITIVE
    assert data < SENSITIVE


def test_data_against_the_prior_make_a_posterior_sensitive_to_both():
    assert min(of_a_mean(2, 5.0)) > 3.0 * SENSITIVE
    assert of_a_mean(2, 5.0)[0] > 2.0 * of_a_mean(2, 0.3)[0]


def test_sensitivity_is_how_far_the_distribution_moves():
    # Raised to 2, a standard normal prior is one of variance 1/2: a mean of count data moves to
    # count / (count + 2) of theirs; each power's shift is as large in standard deviations.
    shifts, found = [], []
    for observed in (1.0, 2.0, 4.0):
        prior, _ = of_a_mean(20, observed)
        shifts.append(observed)
        found.append(prior)
    assert found[2] / found[1] == pytest.approx(2.0, rel=0.15)
    assert found[1] / found[0] == pytest.approx(2.0, rel=0.3)


def test_the_prior_is_that_of_the_population_alone():
    draws = {name: np.array([0.3, 0.6]) for name in priors()}
    found = log_prior(draws)
    by_hand = (
        norm.logpdf(0.3) + norm.logpdf(0.3, 0.5, 0.5) + norm.logpdf(0.3, -4.0, 1.5)
        + sum(np.log(2.0) + norm.logpdf(0.3, 0.0, sd) for sd in (0.5, 0.3, 1.0))
        + sum(norm.logpdf(np.log(0.3), 2.0, sd) - np.log(0.3) for sd in (1.0, 0.5))
        + np.log(15.0) + 14.0 * np.log(0.7)
    )  # fmt: skip
    assert found[0] == pytest.approx(by_hand, abs=1e-4)


@pytest.fixture(scope="module")
def flat():
    """Of a model that judges all scenes alike: data say nothing of slopes."""
    answers, _ = study(1, 10, 20)
    data = Answers.of(answers, np.full(20, 0.5))
    return data, Sampler(response_model).posterior(*data)


@pytest.mark.slow
def test_what_data_say_nothing_of_is_the_prior_s(flat):
    data, posterior = flat
    table = prior_sensitivity(posterior, data).set_axis(PARAMETERS)
    assert table.loc["slope", "diagnosis"] == STRONG_PRIOR, table
    spread = table.loc["spread_slope"]
    assert spread["prior_sensitivity"] > 2.0 * max(SENSITIVE, spread["likelihood_sensitivity"])
    assert table.loc["precision", "likelihood_sensitivity"] > 3.0 * SENSITIVE
    assert table.loc["intercept", "diagnosis"] == ""


@pytest.mark.slow
def test_effects_make_less_noise_in_the_likelihood(flat):
    data, posterior = flat
    draws = {name: posterior.flat(name) for name in DRAWN}
    whole = np.asarray(
        over_draws(lambda draw, data: density(draw, data, eta_of(draw, data)).sum(), draws, data)
    )
    found = log_likelihood(draws, data, places_of(posterior, data))
    assert found.std() < 0.7 * whole.std()
    # Its mean is the same: effects are replaced by their means in the posterior.
    assert found.mean() == pytest.approx(
        whole.mean(), abs=5.0 * (found - whole).std() / np.sqrt(500.0)
    )
    # No parameter: what is told of noise is below the threshold.
    noise = np.random.default_rng(0).standard_normal((20, len(found)))
    assert max(sensitivity(one, found) for one in noise) < SENSITIVE
