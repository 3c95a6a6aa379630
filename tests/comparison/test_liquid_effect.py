"""The effect of a liquid, with names: which people, scenes and models it is of."""

import numpy as np
import pytest

from pourcast.comparison import liquid_effect
from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.progress import no_report
from pourcast.statistics.sampling import Sampling
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.trials import Trials
from tests.comparison.make import voronoi_scenes

EXP2 = EXPERIMENTS.get("exp2")


def two_liquids(people_of_honey=range(6), shown=12):
    """Six participants, of whom the second is called first with honey; 12 scenes, honey without two."""
    rng = np.random.default_rng(0)
    scenes = voronoi_scenes(shown)
    water, honey = rng.random((2, shown))

    def seen(liquid, who, some, judgments, models):
        answers = np.clip(judgments[some] + 0.1 * rng.standard_normal((len(who), len(some))), 0, 1)
        trials = Trials(
            liquid, tuple(f"p{k}" for k in who), tuple(scenes[k] for k in some), answers
        )
        return PeopleAndModels(trials, {name: each[some] for name, each in models.items()})

    both = {"gravity": water, "position-uncertainty": None, "water-ife": water}
    both |= {"honey-ife-2": honey, "truth-water": water, "truth-honey": honey}
    first = seen(
        "water",
        [0, 1, 2, 3, 4, 5],
        list(range(shown)),
        water,
        both | {"position-uncertainty": water},
    )
    second = seen(
        "honey",
        list(people_of_honey)[::-1],
        list(range(shown))[2:],
        honey,
        both | {"position-uncertainty": honey},
    )
    return first, second


def test_answers_are_those_of_the_same_person_and_scene():
    one, other = two_liquids(range(1, 7))
    responses = liquid_effect._responses(one, other)
    assert responses.shape == (2, 7, 10)
    assert responses[0, 2] == pytest.approx(one.trials.responses[2, 2:])
    assert responses[1, 2] == pytest.approx(other.trials.responses[4])
    assert np.isnan(responses[1, 0]).all()
    assert np.isnan(responses[0, 6]).all()
    assert liquid_effect._judged_both(responses) == 5


def test_models_are_those_that_judge_liquids_differently_or_in_pairs():
    one, other = two_liquids()
    models = liquid_effect._models_of_both(one, other, EXP2)
    assert list(models) == [
        "position-uncertainty", "truth-water / truth-honey", "water-ife / honey-ife-2",
    ]  # fmt: skip
    assert models["water-ife / honey-ife-2"] == pytest.approx(
        np.stack([one.models["water-ife"][2:], other.models["honey-ife-2"]])
    )
    assert liquid_effect.unknown_liquid_effects((one, other), EXP2) == [
        "water and honey: no effect of the liquid by gravity: they judge both alike"
    ]


def test_participants_of_one_liquid_each_have_no_effect_of_it():
    one, other = two_liquids(range(6, 12))
    table = liquid_effect.liquid_effect_table((one, other), EXP2, Settings(), no_report)
    assert table.empty
    [why] = liquid_effect.unknown_liquid_effects((one, other), EXP2)
    assert "0 participants judged scenes with both" in why


@pytest.mark.slow
def test_the_table_has_a_row_a_model(monkeypatch):
    monkeypatch.setattr(
        "pourcast.comparison.liquid_effect.Sampling",
        lambda seed: Sampling(warmup=100, draws=100, chains=2, seed=seed),
    )
    table = liquid_effect.liquid_effect_table(two_liquids(), EXP2, Settings(), no_report)
    assert len(table) == 3
    assert set(table["participants"]) == {6}
    assert set(table["scenes"]) == {10}
    assert (table["sensitivity_low"] < table["sensitivity_high"]).all()
    assert table.set_index("model").loc["water-ife / honey-ife-2", "probability"] > 0.9
