"""Units left out: integrals against sums over a fine grid, and weights against fits without them."""

import numpy as np
import pandas as pd
import pytest
from benchmarks.bayes_error_rates import told
from benchmarks.error_rates import World
from scipy.special import logsumexp
from scipy.stats import norm

from pourcast.comparison.posterior_checks import not_converged
from pourcast.statistics import leave_out as module
from pourcast.statistics.leave_out import UNITS, largest_k, leave_out
from pourcast.statistics.loo import compare_models, stacking_weights, units_of
from pourcast.statistics.nuts import Sampler
from pourcast.statistics.quadrature import places_of
from pourcast.statistics.response_model import Answers, information, response_model
from tests.statistics.test_likelihood import TRUE, draw, ordered_beta_log_density
from tests.statistics.test_response_model import study

FINE = np.linspace(-6.0, 6.0, 121)
"""Effects over their spread."""
STEP = FINE[1] - FINE[0]


@pytest.fixture(scope="module")
def sampler():
    return Sampler(response_model)


def density(data, eta, one):
    """By NumPy: log density of answers at a draw, 0 where there are none."""
    nodes = (1,) * (eta.ndim - 2)
    answers = np.broadcast_to(data.answers.reshape(*data.answers.shape, *nodes), eta.shape)
    cuts = one["cut_low"], one["cut_high"]
    found = ordered_beta_log_density(answers, eta, one["precision"], cuts, one["lapse"])
    return np.where(data.answered.reshape(*data.answers.shape, *nodes), found, 0.0)


def scenes_on_a_grid(data, one):
    """Log density of each answer with scenes' effects on the grid, and the log of their prior."""
    own = one["intercept"] + one["spread_scene"] * FINE
    slopes = one["slope"] + one["participant_slope"]
    eta = one["participant_intercept"][:, None] + slopes[:, None] * data.x
    return density(data, eta[..., None] + own, one), norm.logpdf(FINE) + np.log(STEP)


def scene_known(data, one):
    each, prior = scenes_on_a_grid(data, one)
    return logsumexp(each.sum(axis=0) + prior, axis=-1)


def participant_known(data, one, who):
    """The same of a participant, by what the others answered."""
    each, prior = scenes_on_a_grid(data, one)
    others = each.sum(axis=0) + prior - each[who]
    others -= logsumexp(others, axis=-1)[:, None]
    coarse = FINE[::4]
    u, v = (grid.ravel() for grid in np.meshgrid(coarse, coarse))
    line = one["intercept"] + one["spread_intercept"] * u
    line = line + (one["slope"] + one["spread_slope"] * v) * data.x[:, None]
    eta = line[:, None] + (one["spread_scene"] * FINE)[:, None]
    own = data._replace(answers=data.answers[[who]], answered=data.answered[[who]])
    predicted = logsumexp(density(own, eta[None], one)[0] + others[..., None], axis=1)
    weights = norm.logpdf(u) + norm.logpdf(v) + 2.0 * np.log(4.0 * STEP)
    return logsumexp(predicted.sum(axis=0) + weights)


@pytest.mark.parametrize("spread", [0.0, 0.3, 1.5])
@pytest.mark.slow
def test_effects_are_integrated_out(spread, sampler):
    spreads = ("spread_scene", "spread_intercept", "spread_slope")
    answers, judgments = study(3, 8, 12, TRUE | dict.fromkeys(spreads, spread))
    answers[0, 1] = np.nan
    data = Answers.of(answers, judgments)
    posterior = sampler.posterior(*data)
    places = places_of(posterior, data)
    # The draws with the least spread, too: a rule with few nodes may miss what is narrow.
    for at in (0, *(int(posterior.flat(name, 500).argmin()) for name in spreads)):
        for unit, tolerance in (("scenes", 0.05), ("participants", 0.15)):
            kind = module._KINDS[unit]
            some = np.array([0, 5])
            found = kind.likelihood(posterior, data, places, some)[at]
            names = [*TRUE, "participant_intercept", "participant_slope"]
            one = {name: posterior.flat(name, kind.most_draws)[at] for name in names}
            known = (
                scene_known(data, one)[some]
                if unit == "scenes"
                else [participant_known(data, one, who) for who in some]
            )
            assert found == pytest.approx(known, abs=tolerance), (unit, at)


def test_what_answers_say_is_counted():
    known = information(np.array([[True, True], [True, False]]), np.array([1.0, 3.0]))
    assert known == (1.5, 7.5, 1.5)


@pytest.mark.slow
def test_a_unit_whose_weights_are_good_is_predicted_as_by_a_fit_without_it(sampler, monkeypatch):
    data = Answers.of(*study(4, 8, 12))
    posterior = sampler.posterior(*data)
    for unit in UNITS:
        weighted = leave_out(unit, sampler, posterior, data)
        best = weighted.k.min()
        assert best < 0.5
        with monkeypatch.context() as patch:
            # Only that one counts as high.
            patch.setattr(module, "_high", lambda k, draws, best=best: k == best)
            again = leave_out(unit, sampler, posterior, data)
        assert again.refitted.sum() == 1
        assert again.elpd[again.refitted] == pytest.approx(weighted.elpd[again.refitted], abs=0.15)
        assert (again.elpd[~again.refitted] == weighted.elpd[~again.refitted])[
            ~weighted.refitted[~again.refitted]
        ].all()
        assert weighted.p_loo.sum() > 0.0


@pytest.mark.slow
def test_the_true_model_wins_and_equally_good_ones_are_not_told():
    rng = np.random.default_rng(1)
    judgments = rng.random(30)
    answers = draw(rng, 8, judgments)
    models = {"other": rng.random(30), "true": judgments, "same": judgments}
    found = compare_models(answers, models)
    scenes = found.loo[found.loo["unit"] == "scenes"].set_index("model")
    assert scenes.index[-1] == "other"
    assert scenes.loc["other", "told"] == "yes"
    assert scenes["weight"].sum() == pytest.approx(1.0)
    assert scenes["weight"]["other"] < 0.05
    assert set(found.loo["unit"]) == set(UNITS)
    pairs = found.differences[found.differences["unit"] == "scenes"]
    words = {frozenset(pair): word for *pair, word in pairs[["model", "rival", "told"]].to_numpy()}
    assert words == {
        frozenset(("other", "true")): "yes",
        frozenset(("other", "same")): "yes",
        frozenset(("true", "same")): "no",
    }


def test_stacking_is_that_of_models_each_good_at_half_of_the_units():
    elpd = np.array([[0.0] * 5 + [-4.0] * 5, [-4.0] * 5 + [0.0] * 5, [-2.0] * 10])
    assert stacking_weights(elpd) == pytest.approx([0.5, 0.5, 0.0], abs=1e-6)


def test_too_few_units_are_not_left_out():
    assert units_of(np.zeros((4, 5))) == ["scenes"]
    assert units_of(np.zeros((5, 4))) == ["participants"]
    assert largest_k(500) < largest_k(2500) == 0.7


def test_posteriors_that_are_not_to_be_relied_on_are_told():
    good = {"liquid": "water", "model": "a", "r_hat": 1.004, "ess_bulk": 900.0, "ess_tail": 800.0,
            "divergences": 0}  # fmt: skip
    rows = [
        good,
        good | {"model": "b", "r_hat": 1.02},
        good | {"model": "c", "ess_tail": 300.0},
        good | {"model": "d", "divergences": 3},
        good | {"model": "d", "divergences": 3},
    ]
    doubts = list(not_converged(pd.DataFrame(rows), ""))
    assert [doubt.split(":")[1].split()[-2] for doubt in doubts] == ["b", "c", "d"]
    assert "R-hat 1.020" in doubts[0]
    assert "300 draws" in doubts[1]
    assert "3 of its trajectories diverged" in doubts[2]


@pytest.mark.study
def test_equally_good_models_are_seldom_told_apart():
    # 5 % of 40 studies: more than 6 in 1 of 70 such tests.
    _, wrong, _ = told(World(8, 20, (0.9, 0.9)), "scenes", 40)
    print(wrong)
    assert wrong <= 6 / 40
