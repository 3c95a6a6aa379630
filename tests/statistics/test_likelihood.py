"""The density of single answers, in NumPy: the oracle of the one in JAX."""

import numpy as np
import pytest
from scipy import integrate
from scipy.special import expit, gammaln, log_expit
from scipy.stats import beta

from pourcast.statistics.ordered_beta import (
    LAPSE_ENDS,
    Answering,
    log_density,
    log_gamma,
    predictor,
)

TRUE = {"intercept": 0.1, "slope": 0.6, "spread_intercept": 0.3, "spread_slope": 0.15,
        "spread_scene": 0.4, "precision": 8.0, "lapse": 0.04, "cut_low": -4.0, "cut_high": 4.0}  # fmt: skip


def draw(rng, people, judgments, true=TRUE):
    """Answers of the response model itself."""
    x, shape = predictor(judgments), (people, len(judgments))
    u, v = rng.standard_normal((2, people, 1))
    w = rng.standard_normal(len(judgments))
    eta = (
        true["intercept"]
        + true["spread_intercept"] * u
        + true["spread_scene"] * w
        + (true["slope"] + true["spread_slope"] * v) * x
    )
    mean = expit(eta)
    answers = rng.beta(mean * true["precision"], (1 - mean) * true["precision"])
    place = rng.random(shape)
    answers = np.where(place < 1 - expit(eta - true["cut_low"]), 0.0, answers)
    answers = np.where(place > 1 - expit(eta - true["cut_high"]), 1.0, answers)
    lapsed = rng.random(shape)
    lapsed = np.where(lapsed < 0.005, 0.0, np.where(lapsed > 0.995, 1.0, lapsed))
    return np.where(rng.random(shape) < true["lapse"], lapsed, answers)


def ordered_beta_log_density(
    answers: np.ndarray,
    eta: np.ndarray,
    precision: np.ndarray | float,
    cuts: tuple[float, float],
    lapse: float,
) -> np.ndarray:
    """Logarithm of the density of answers, or of their probability if they are 0 or 1.

    Parameters
    ----------
    answers
        In 0..1.
    eta
        Linear predictor, of the same shape.
    precision
        Of the beta density.
    cuts
        c1 and c2.
    lapse
        Share of lapses.
    """
    low, high = cuts
    mean = expit(eta)
    inner = np.clip(answers, 1e-6, 1.0 - 1e-6)
    between = (
        np.log(np.maximum(expit(eta - low) - expit(eta - high), 1e-300))
        + beta.logpdf(inner, mean * precision, (1.0 - mean) * precision)
    )  # fmt: skip
    ends = np.where(answers <= 0.0, log_expit(low - eta), log_expit(eta - high))
    at_end = (answers <= 0.0) | (answers >= 1.0)
    with np.errstate(divide="ignore"):
        attentive = np.log1p(-lapse) + np.where(at_end, ends, between)
        lapsed = np.log(lapse) + np.where(at_end, np.log(LAPSE_ENDS / 2.0), np.log1p(-LAPSE_ENDS))
    return np.logaddexp(attentive, lapsed)


@pytest.mark.parametrize("eta", [-2.0, 0.0, 1.5])
@pytest.mark.parametrize("lapse", [0.0, 0.1])
def test_the_density_is_one_in_all(eta, lapse):
    def density(answer):
        found = ordered_beta_log_density(
            np.array([answer]), np.array([eta]), 6.0, (-3.0, 2.5), lapse
        )
        return float(np.exp(found[0]))

    inside, _ = integrate.quad(density, 1e-9, 1 - 1e-9, points=[0.01, 0.5, 0.99], limit=200)
    assert inside + density(0.0) + density(1.0) == pytest.approx(1.0, abs=1e-4)


def test_the_density_is_that_of_the_draws():
    # With one participant's eta known, shares of answers are integrals of the density.
    rng = np.random.default_rng(0)
    true = TRUE | {
        "spread_intercept": 0.0,
        "spread_slope": 0.0,
        "spread_scene": 0.0,
        "cut_low": -1.0,
        "cut_high": 2.0,
    }
    answers = draw(rng, 200_000, np.array([0.7]), true)[:, 0]
    eta = 0.1 + 0.6 * predictor(np.array([0.7]))

    def density(answer):
        cuts = (true["cut_low"], true["cut_high"])
        found = ordered_beta_log_density(
            np.array([answer]), eta, true["precision"], cuts, true["lapse"]
        )
        return float(np.exp(found[0]))

    for low, high in ((0.2, 0.4), (0.6, 0.8)):
        share = np.mean((answers > low) & (answers < high))
        assert share == pytest.approx(integrate.quad(density, low, high)[0], abs=0.005)
    assert np.mean(answers == 0) == pytest.approx(density(0.0), abs=0.005)
    assert np.mean(answers == 1) == pytest.approx(density(1.0), abs=0.005)


def test_the_density_by_jax_is_that_of_numpy():
    rng = np.random.default_rng(0)
    answers, eta = np.append(rng.random(50), [0.0, 1.0]), rng.normal(0, 1.5, 52)
    ours = ordered_beta_log_density(answers, eta, 7.0, (-3.0, 2.0), 0.05)
    theirs = log_density(answers, eta, Answering(7.0, 0.05, -3.0, 2.0))
    assert np.asarray(theirs) == pytest.approx(ours, rel=1e-4, abs=1e-4)


def test_the_logarithm_of_gamma_is_scipy_s():
    x = np.geomspace(1e-4, 300.0, 200)
    assert np.asarray(log_gamma(x)) == pytest.approx(gammaln(x), rel=2e-5, abs=2e-5)
