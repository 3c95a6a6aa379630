"""The likelihood of single answers: known answers, and intervals that hold what they promise."""

import numpy as np
import pytest

from pourcast.statistics.bayes import PARAMETERS, ResponseModel, Sampling, compare_models
from tests.statistics.test_likelihood import TRUE, draw, ordered_beta_log_density


def test_the_density_is_that_of_numpy():
    from pourcast.statistics.bayes import _log_density

    rng = np.random.default_rng(0)
    answers, eta = np.append(rng.random(50), [0.0, 1.0]), rng.normal(0, 1.5, 52)
    ours = ordered_beta_log_density(answers, eta, 7.0, (-3.0, 2.0), 0.05)
    theirs = _log_density(answers, eta, 7.0, -3.0, 2.0, 0.05)
    assert np.asarray(theirs) == pytest.approx(ours, rel=1e-4, abs=1e-4)


def test_parameters_are_recovered():
    fitter, inside = ResponseModel(Sampling(warmup=250, draws=250, chains=2)), 0
    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        judgments = rng.random(40)
        answers = draw(rng, 16, judgments)
        answers[3, 5] = answers[7, 9] = np.nan
        posterior = fitter.fit(answers, judgments).posterior
        means = {name: float(posterior[name].mean()) for name in PARAMETERS}
        assert means["slope"] == pytest.approx(TRUE["slope"], abs=0.15)
        assert means["precision"] == pytest.approx(TRUE["precision"], rel=0.25)
        for name in PARAMETERS:
            low, high = np.quantile(posterior[name], [0.025, 0.975])
            inside += low <= TRUE[name] <= high
    assert inside >= 20  # of 24, 22.8 expected; fewer than 20 in 1 of 170 such tests


def test_the_true_model_wins():
    rng = np.random.default_rng(1)
    judgments = rng.random(40)
    answers = draw(rng, 16, judgments)
    models = {"other": rng.random(40), "true": judgments}
    found = compare_models(answers, models, Sampling(warmup=250, draws=250, chains=2))
    assert found.loo["model"].tolist() == ["true", "other"]
    assert found.loo["elpd_diff"].iloc[1] > 4 * found.loo["dse"].iloc[1]
    true = found.parameters[found.parameters["model"] == "true"]
    assert (true["r_hat"] < 1.15).all()
    assert true["parameter"].tolist() == list(PARAMETERS)
    narrow = compare_models(answers, models, Sampling(warmup=250, draws=250, chains=2), level=0.5)
    widths, narrower = (
        (table["high"] - table["low"]).to_numpy() for table in (found.parameters, narrow.parameters)
    )
    assert (narrower < 0.6 * widths).all()


@pytest.mark.slow
def test_intervals_are_calibrated():
    # 80 % intervals of the population's parameters over 120 data sets. The true values are
    # fixed, not drawn from the prior, so coverage is near 80 %, not just that.
    fitter = ResponseModel(Sampling(warmup=250, draws=250, chains=1))
    studies, held = 120, dict.fromkeys(PARAMETERS, 0)
    for seed in range(studies):
        rng = np.random.default_rng(seed)
        judgments = rng.random(20)
        fitted = fitter.fit(draw(rng, 10, judgments), judgments, seed=seed)
        for name in PARAMETERS:
            low, high = np.quantile(fitted.posterior[name], [0.1, 0.9])
            held[name] += low <= TRUE[name] <= high
    shares = {name: count / studies for name, count in held.items()}
    print(shares)
    for name in ("intercept", "slope", "precision"):
        assert 0.7 <= shares[name] <= 0.9, shares  # 0.8 +- 2.7 standard errors
    assert all(share >= 0.65 for share in shares.values()), shares
