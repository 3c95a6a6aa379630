"""The response model's posterior: known parameters, and intervals that hold what they promise."""

import numpy as np
import pytest

from pourcast.statistics.nuts import Sampler
from pourcast.statistics.response_model import PARAMETERS, Answers, response_model
from pourcast.statistics.sampling import Sampling
from tests.statistics.test_likelihood import TRUE, draw


def study(seed, people=16, scenes=40, true=TRUE):
    rng = np.random.default_rng(seed)
    judgments = rng.random(scenes)
    return draw(rng, people, judgments, true), judgments


@pytest.mark.slow
def test_parameters_are_recovered_by_chains_that_agree():
    answers, judgments = study(1)
    answers[3, 5] = answers[7, 9] = np.nan
    posterior = Sampler(response_model).posterior(*Answers.of(answers, judgments))
    table = posterior.summary(PARAMETERS, 0.99).set_index("parameter")
    for name in PARAMETERS:
        assert table.loc[name, "low"] <= TRUE[name] <= table.loc[name, "high"], name
    assert (table["r_hat"] <= 1.01).all()
    assert (table[["ess_bulk", "ess_tail"]] >= 400).all(axis=None)
    assert posterior.divergences == 0
    narrow = posterior.summary(PARAMETERS, 0.5).set_index("parameter")
    widths = [one["high"] - one["low"] for one in (narrow, table)]
    assert (widths[0] < 0.6 * widths[1]).all()


def test_draws_come_from_the_seed_alone(monkeypatch):
    sampler = Sampler(response_model, Sampling(warmup=50, draws=20, chains=2))
    data = [Answers.of(*study(seed, 5, 6)) for seed in (1, 2)]
    both = list(sampler.posteriors(data, seed=3))
    monkeypatch.setattr("pourcast.statistics.nuts.available_cores", lambda: 1)
    alone = sampler.posterior(*data[1], seed=3)
    assert (alone.draws["slope"] == both[1].draws["slope"]).all()
    assert (alone.draws["slope"][0] != alone.draws["slope"][1]).all()
    assert (sampler.posterior(*data[1], seed=4).draws["slope"] != alone.draws["slope"]).any()


@pytest.mark.parametrize("people", [1, 3])
@pytest.mark.slow
def test_chains_agree_where_effects_are_small_or_large_or_hardly_known(people):
    # A centred chain gets stuck where effects are small, a non-centred one where they are large.
    for spread, flat in ((0.0, False), (1.5, False), (0.4, True)):
        true = TRUE | {"spread_scene": spread}
        answers, judgments = study(2, 10 * people, 30, true)
        judgments = np.full(30, 0.5) if flat else judgments
        posterior = Sampler(response_model).posterior(*Answers.of(answers, judgments))
        table = posterior.summary(PARAMETERS, 0.95)
        assert table["r_hat"].max() <= 1.01, (spread, flat)
        assert posterior.divergences <= 2, (spread, flat)


@pytest.mark.study
def test_intervals_are_calibrated():
    # 80 % intervals of the population's parameters over 120 data sets. The true values are
    # fixed, not drawn from the prior, so coverage is near 80 %, not just that.
    studies = 120
    sampler = Sampler(response_model, Sampling(warmup=300, draws=500, chains=1))
    data = [Answers.of(*study(seed, 10, 20)) for seed in range(studies)]
    held = dict.fromkeys(PARAMETERS, 0)
    for posterior in sampler.posteriors(data):
        for name in PARAMETERS:
            low, high = np.quantile(posterior.draws[name], [0.1, 0.9])
            held[name] += low <= TRUE[name] <= high
    shares = {name: count / studies for name, count in held.items()}
    print(shares)
    for name in ("intercept", "slope", "precision"):
        assert 0.7 <= shares[name] <= 0.9, shares  # 0.8 +- 2.7 standard errors
    assert all(share >= 0.65 for share in shares.values()), shares
