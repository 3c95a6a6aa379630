"""Mixtures of models over people: the grid of settings, what is planted, and calibration."""

import numpy as np
import pytest
from benchmarks.mixture import ranks, smooth_heads

from pourcast.statistics.mixture import (
    LEAST_SPREAD,
    SHARED,
    Head,
    Mixture,
    MixtureModel,
    _Settings,
    mean_of,
    names_of,
    share_of,
)
from pourcast.statistics.nuts import Posterior
from pourcast.statistics.observer import Population
from pourcast.statistics.sampling import Sampling

HEADS = {
    "one": Head(np.random.default_rng(0).random((6, 5)), {"zeta": np.arange(6.0)}),
    "other": Head(np.random.default_rng(1).random((4, 5)), {}),
}


def test_settings_of_a_model_share_its_probability():
    there = _Settings(HEADS)
    prior = np.exp(there.log_prior(np.array([0.3, 0.7]), np.array([0.0]), np.array([0.4])))
    assert prior[:6].sum() == pytest.approx(0.3, rel=1e-5)
    assert prior[6:] == pytest.approx(np.full(4, 0.7 / 4), rel=1e-5)  # No parameter: all alike.
    # zeta is on a scale from -1 to 1: normal about its middle.
    places = np.linspace(-1.0, 1.0, 6)
    normal = np.exp(-0.5 * (places / 0.4) ** 2)
    assert prior[:6] == pytest.approx(0.3 * normal / normal.sum(), rel=1e-5)


def test_predictors_are_in_units_of_their_model():
    there = _Settings(HEADS | {"none": Head(np.full((1, 5), 0.5), {})})
    for rows in (slice(0, 6), slice(6, 10)):
        assert there.x[rows].mean() == pytest.approx(0.0, abs=1e-12)
        assert there.x[rows].std() == pytest.approx(1.0)
    assert (there.x[10] == 0.0).all()


def test_what_is_in_heads_is_read_off_the_draws():
    settings = np.array([[[0, 7], [5, 7], [5, 1], [9, 6]]])  # One chain, four draws, two people.
    shares = np.array([[[0.2, 0.8], [0.6, 0.4], [0.7, 0.3], [0.9, 0.1]]])
    found = Mixture(HEADS, Posterior({"setting": settings, "shares": shares}, 0))
    assert found.probabilities().tolist() == [[0.75, 0.25], [0.25, 0.75]]
    first, second = found.values("one", "zeta")
    assert first.tolist() == [0.0, 5.0, 5.0]
    assert second.tolist() == [1.0]
    table = found.shares(0.5)
    assert table["exceedance"].tolist() == [0.75, 0.25]
    assert table["share"].tolist() == pytest.approx([0.6, 0.4])


def test_parameters_are_named_on_their_own_scale():
    model = MixtureModel(HEADS)
    draws = {"means": np.array([[[-1.0]]]), "spreads": np.array([[[1.0]]])}
    named = model.named(draws | {"shares": np.array([[[0.2, 0.8]]])})
    assert named[mean_of("one", "zeta")] == pytest.approx(0.0)
    assert named["one: SD of zeta"] == pytest.approx(2.5 * (1.0 + LEAST_SPREAD))
    assert named[share_of("other")] == pytest.approx(0.8)
    assert set(names_of(HEADS)) >= {"one: share", "one: mean of zeta", *SHARED}


@pytest.mark.slow
def test_what_was_planted_is_found():
    rng, people, scenes = np.random.default_rng(3), 24, 60
    heads = smooth_heads(scenes, 9, 3, 5)
    simulation, heuristic = heads["simulation"], heads["heuristic"]
    kind = np.arange(people) % 4  # Half simulate, a quarter each has the heuristic, or no model.
    zeta = rng.integers(9, size=people)
    judged = np.where((kind < 2)[:, None], simulation.judgments[9 + zeta], 0.5)
    judged = np.where((kind == 2)[:, None], heuristic.judgments[4], judged)
    population = Population()
    answers = population.respond(judged, population.draw(people, rng), rng)
    answers[:, ::7] = np.nan
    model = MixtureModel(heads, Sampling(warmup=300, draws=400, chains=2))
    found = model.fit(answers, seed=1)
    told = found.probabilities().argmax(axis=1)
    assert (told == np.select([kind < 2, kind == 2], [0, 1], 2)).mean() > 0.9
    shares = found.shares(0.95)
    assert shares["share"].to_numpy() == pytest.approx([0.5, 0.25, 0.25], abs=0.1)
    assert shares["exceedance"].iloc[0] > 0.8
    own = [v.mean() for v, one in zip(found.values("simulation", "zeta"), kind, strict=True)
           if one < 2]  # fmt: skip
    assert np.corrcoef(own, 2.0 * zeta[kind < 2])[0, 1] > 0.8
    summary = found.posterior.summary(names_of(heads), 0.95)
    assert (summary["r_hat"] < 1.05).all(), summary
    again = model.fit(answers, seed=1)
    assert (again.posterior.draws["setting"] == found.posterior.draws["setting"]).all()


@pytest.mark.study
def test_it_knows_what_it_does_not_know():
    found = [ranks(seed, 12, 30) for seed in range(30)]
    held = np.mean([held for one in found for _, held in one.values()])
    assert 0.91 < held < 0.98
    rank = np.array([[rank for rank, _ in one.values()] for one in found])
    # Standard error of a mean rank: 0.289 / sqrt(30).
    assert np.abs(rank.mean(axis=0) - 0.5).max() < 0.053 * 3.5
