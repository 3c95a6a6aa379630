"""Posterior predictive checks: calm where the response model made the data, and not where not."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit
from scipy.stats import kurtosis

from pourcast.comparison.posterior_checks import UNLIKE
from pourcast.statistics.answer_statistics import STATISTICS, Design, tenths
from pourcast.statistics.nuts import Posterior, Sampler
from pourcast.statistics.ordered_beta import Answering, draw_answers, predictor
from pourcast.statistics.predictive_checks import OTHER_TENTHS, predictive_checks
from pourcast.statistics.response_model import Answers, response_model
from pourcast.statistics.sampling import Sampling
from tests.statistics.test_likelihood import TRUE, draw

PEOPLE, SCENES = 12, 30
ANSWERING = Answering(*(TRUE[name] for name in Answering._fields))


def world(kind, seed, people=PEOPLE, scenes=SCENES):
    """Judgments, effects and answers: of the response model, but for what the kind says."""
    rng = np.random.default_rng(seed)
    judgments = rng.random(scenes)
    x = predictor(judgments)
    u = TRUE["spread_intercept"] * rng.standard_normal(people)
    v = TRUE["spread_slope"] * rng.standard_normal(people)
    w = TRUE["spread_scene"] * rng.standard_normal(scenes)
    if kind == "two kinds of people":
        v = np.where(np.arange(people) % 2, 0.6, -0.6)
    if kind == "a few odd scenes":
        w = np.concatenate([[2.5, -2.5], 0.1 * rng.standard_normal(scenes - 2)])
    bent = 0.35 * (x**2 - 3.0) if kind == "curved" else 0.0
    eta = TRUE["intercept"] + u[:, None] + w + (TRUE["slope"] + v[:, None]) * x + bent
    answers = draw_answers(eta, ANSWERING, rng)
    if kind == "three buttons":
        answers = np.round(2.0 * answers) / 2.0
    if kind == "half of people guess":
        answers[: people // 2] = rng.random((people // 2, scenes))
    if kind == "a slider's steps":
        answers = np.round(100.0 * answers) / 100.0
    if kind == "judged at random":
        judgments = rng.random(scenes)
    return judgments, (u, v, w), answers


MISSED = {
    "two kinds of people": "kurtosis of participants' slopes",
    "a few odd scenes": "kurtosis of scenes' residuals",
    "curved": "curvature",
    "three buttons": OTHER_TENTHS,
    "half of people guess": "SD of participants' noise",
}
"""What the response model can't make, and where that shows."""


SPREADS = ("spread_intercept", "spread_slope", "spread_scene")


def known(effects, draws=200, spreads=None):
    """A posterior of somebody who knows the truth; spreads are those of the effects."""
    u, v, w = effects
    once = TRUE | {"participant_intercept": u, "participant_slope": v, "scene": w}
    once |= spreads or dict(zip(SPREADS, (one.std() for one in effects), strict=True))
    return Posterior(
        {
            name: np.broadcast_to(value, (1, draws, *np.shape(value)))
            for name, value in once.items()
        },
        0,
    )


def checked(kind, seed, *size):
    judgments, effects, answers = world(kind, seed, *size)
    return predictive_checks(known(effects), Answers.of(answers, judgments), seed)


def test_draws_are_those_of_the_density():
    # Its oracle draws likewise, and is tested against the density.
    rng, judgments = np.random.default_rng(0), np.full(40_000, 0.8)
    true = TRUE | dict.fromkeys(SPREADS, 0.0)
    true |= {"lapse": 0.3, "cut_low": -1.0, "cut_high": 2.0}
    oracle = draw(rng, 1, judgments, true)
    eta = true["intercept"] + true["slope"] * predictor(judgments)
    ours = draw_answers(eta, Answering(*(true[name] for name in Answering._fields)), rng)
    for share in (0.0, 0.004, 0.3, 0.6, 0.996):
        assert np.mean(ours <= share) == pytest.approx(np.mean(oracle <= share), abs=0.012)
    assert np.isfinite(draw_answers(np.array([-800.0, 800.0]), ANSWERING, rng)).all()


def test_p_is_uniform_where_the_truth_is_known():
    p = {}
    for seed in range(120):
        judgments, effects, answers = world("as modelled", seed, 8, 12)
        posterior = known(effects, 49, {name: TRUE[name] for name in SPREADS})
        found = predictive_checks(posterior, Answers.of(answers, judgments), seed).statistics
        for name, one in zip(found["statistic"], found["p"], strict=True):
            p.setdefault(name, []).append(one)
    assert set(p) == {*STATISTICS, OTHER_TENTHS}
    for name, values in p.items():
        # Four standard errors of a share of .1 and of a half; ties of counts only raise p.
        assert np.mean(np.array(values) <= 0.1) < 0.2, name
        assert np.mean(np.array(values) <= 0.5) < 0.67, name
        if not name.startswith("answers of"):
            assert np.mean(np.array(values) <= 0.5) > 0.33, name


@pytest.mark.parametrize("kind", MISSED)
def test_what_the_model_can_t_make_shows(kind):
    size = (30, 60) if kind == "half of people guess" else (PEOPLE, SCENES)
    rows = checked(kind, 1, *size).statistics.set_index("statistic")
    row = rows.loc[MISSED[kind]]
    assert row["p"] < 0.02
    assert not row["low"] <= row["observed"] <= row["high"]


def test_statistics_are_what_they_say():
    judgments, _, answers = world("as modelled", 3)
    answers[1, 2] = answers[4, 5] = np.nan
    answers[:, 7] = answers[3] = np.nan
    data = Answers.of(answers, judgments)
    design = Design(data.answered, expit(data.x))
    found = {name: make(data.answers[None], design)[0] for name, (_, make) in STATISTICS.items()}
    people, scenes = np.delete(np.arange(PEOPLE), 3), np.delete(np.arange(SCENES), 7)
    kept, z = answers[np.ix_(people, scenes)], judgments[scenes]
    mean = np.nanmean(kept, axis=0)
    slopes, noise, r = [], [], []
    for k, row in enumerate(kept):
        on = np.isfinite(row)
        others = np.nanmean(np.delete(kept, k, axis=0), axis=0)[on]
        slopes.append(np.polyfit(expit(predictor(z[on])), row[on], 1)[0])
        residuals = row[on] - np.polyval(np.polyfit(others, row[on], 1), others)
        noise.append(np.sqrt(np.mean(residuals**2)))
        r.append(np.corrcoef(row[on], others)[0, 1])
    off = mean - np.polyval(np.polyfit(z, mean, 1), z)
    square = z**2 - np.polyval(np.polyfit(z, z**2, 1), z)
    expected = {
        "answers of 0": np.mean(kept[np.isfinite(kept)] == 0.0),
        "answers of 1": np.mean(kept[np.isfinite(kept)] == 1.0),
        "SD of answers": np.nanstd(kept),
        "SD of participants' noise": np.std(noise, ddof=1),
        "r between participants": np.mean(r),
        "SD of participants' means": np.std(np.nanmean(kept, axis=1), ddof=1),
        "SD of participants' slopes": np.std(slopes, ddof=1),
        "kurtosis of participants' slopes": kurtosis(slopes, fisher=False),
        "SD of scenes' residuals": np.std(off, ddof=1),
        "kurtosis of scenes' residuals": kurtosis(off, fisher=False),
        "curvature": np.corrcoef(off, square)[0, 1],
        "r with the model": np.corrcoef(mean, z)[0, 1],
    }
    assert found == pytest.approx(expected)


def test_an_answer_on_an_edge_counts_half_on_either_side():
    answers = np.array([[[0.0, 0.1, 0.1, 0.55, 1.0]]])
    design = Design(np.ones((1, 5), dtype=bool), np.linspace(0.1, 0.9, 5))
    expected = [0.4, 0.2, 0, 0, 0, 0.2, 0, 0, 0, 0.2]
    assert tenths(answers, design)[0] == pytest.approx(expected)


def test_what_data_don_t_have_is_left_out():
    # Three people: nothing over people; one judgment for all scenes: nothing about the model.
    _, (u, v, w), answers = world("as modelled", 2)
    posterior = known((u[:3], v[:3], w))
    found = predictive_checks(posterior, Answers.of(answers[:3], np.full(SCENES, 0.5))).statistics
    assert set(found["statistic"]) == {
        "answers of 0", "answers of 1", "SD of answers", "SD of scenes' residuals",
        "kurtosis of scenes' residuals", OTHER_TENTHS,
    }  # fmt: skip
    assert found.notna().all(axis=None)


def test_the_same_seed_makes_the_same_answers():
    first, again = (checked("as modelled", 5) for _ in range(2))
    assert first.statistics.equals(again.statistics)
    assert first.tenths.equals(again.tenths)
    assert first.tenths[["observed", "mean"]].sum().to_numpy() == pytest.approx(1.0)


@pytest.fixture(scope="module")
def sampler():
    return Sampler(response_model, Sampling(warmup=300, draws=500, chains=1))


def fitted(sampler, kind, seed, people=PEOPLE, scenes=SCENES):
    judgments, _, answers = world(kind, seed, people, scenes)
    data = Answers.of(answers, judgments)
    return predictive_checks(sampler.posterior(*data, seed=seed), data, seed).statistics


def p_of(sampler, kind, studies, *size):
    """A row a study, a column a statistic."""
    tables = [fitted(sampler, kind, seed, *size) for seed in range(studies)]
    return pd.DataFrame([table.set_index("statistic")["p"] for table in tables])


@pytest.mark.slow
def test_a_fit_shows_what_the_model_can_t_make(sampler):
    for kind in ("two kinds of people", "curved"):
        rows = fitted(sampler, kind, 1).set_index("statistic")
        assert rows.loc[MISSED[kind], "p"] < UNLIKE, kind


@pytest.mark.study
@pytest.mark.parametrize("kind", ["as modelled", "a slider's steps", "judged at random"])
def test_checks_are_conservative(sampler, kind):
    p = p_of(sampler, kind, 60)
    outside, told = p < 0.05, (p < UNLIKE).any(axis=1)
    print(f"{kind}: outside {outside.mean().mean():.3f}, told of {told.mean():.3f}")
    print(outside.mean().to_dict())
    assert outside.mean().mean() < 0.03
    assert outside.mean().max() < 0.05 + 3.0 * 0.03  # and three standard errors
    assert told.mean() < 0.05 + 3.0 * 0.03


@pytest.mark.study
@pytest.mark.parametrize(
    ("kind", "size"),
    [
        ("two kinds of people", (PEOPLE, SCENES)),
        ("a few odd scenes", (PEOPLE, SCENES)),
        ("curved", (PEOPLE, SCENES)),
        ("half of people guess", (30, 60)),
    ],
)
def test_checks_find_what_the_model_can_t_make(sampler, kind, size):
    found = (p_of(sampler, kind, 10, *size)[MISSED[kind]] < UNLIKE).sum()
    print(f"{kind}: {found} of 10")
    assert found >= 7
