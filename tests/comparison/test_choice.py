import numpy as np
import pandas as pd
import pytest

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.choice import (
    candidates,
    carried_table,
    choice_table,
    cross_validation_table,
    scores_table,
)
from pourcast.models.registry import make_model
from tests.comparison.make import made_up, people_like

SETTINGS = Settings()


@pytest.fixture(scope="module")
def study():
    return made_up()


def fitted(study, water, honey, **more):
    scenes, judged = study
    trials = []
    for liquid, spec in (("water", water), ("honey-exp1", honey)):
        if spec:
            trials.append(people_like(scenes, judged.find("water", spec), liquid=liquid, **more))
    return candidates(judged, trials)


WATER = "ife:liquid=water,n_particles=25,damping_zeta=5,zeta_sigma=4"
HONEY = "ife:liquid=honey,n_particles=75,damping_zeta=5,zeta_sigma=4"


def test_n_comes_from_both_liquids(study):
    table = choice_table(fitted(study, WATER, HONEY, noise=0.02), SETTINGS).set_index("model")
    assert table.loc["water-ife", "n_particles"] == 50  # the mean of 25 and 75, as in the paper
    assert table.loc["water-ife", "viscosity_alpha"] == "own"
    assert abs(table.loc["water-ife", "damping_zeta"] - 5) <= 1


def test_honey_models_inherit(study):
    table = choice_table(fitted(study, WATER, HONEY, noise=0.02), SETTINGS).set_index("model")
    water, first, second = (table.loc[name] for name in ("water-ife", "honey-ife-1", "honey-ife-2"))
    assert first["n_particles"] == water["n_particles"]
    assert first["damping_zeta"] == water["damping_zeta"]
    assert first["fitted"] == "none"
    assert second["n_particles"] == water["n_particles"]
    assert second["viscosity_alpha"] == water["viscosity_alpha"]
    assert second["fitted"] == "damping_zeta"


@pytest.mark.parametrize("zeta", [0, 3, 11, 16])
def test_model_2_finds_its_own_zeta(study, zeta):
    honey = f"ife:liquid=water,n_particles=50,damping_zeta={zeta},zeta_sigma=4"
    table = choice_table(fitted(study, honey, honey, noise=0.05), SETTINGS).set_index("model")
    assert abs(table.loc["honey-ife-2", "damping_zeta"] - zeta) <= 1


@pytest.mark.parametrize(
    ("spec", "model"),
    [
        ("marble:n_particles=75,damping_zeta=9,zeta_sigma=4", "water-marble"),
        ("simple:g=0,m=0.14", "water-simple"),
    ],
)
def test_other_models_find_theirs(study, spec, model):
    table = choice_table(fitted(study, spec, None, noise=0.02), SETTINGS).set_index("model")
    planted = make_model(spec).parameters()
    for name in ("damping_zeta", "m"):
        if name in planted:
            step = 1 if name == "damping_zeta" else 0.02
            assert abs(table.loc[model, name] - planted[name]) <= step + 1e-9
    assert "honey-marble" not in table.index


def test_one_liquid_alone_is_fitted_with_what_there_is(study):
    water = choice_table(fitted(study, WATER, None), SETTINGS).set_index("model")
    assert water.loc["water-ife", "n_particles"] == 25
    honey = choice_table(fitted(study, None, HONEY), SETTINGS).set_index("model")
    assert "honey-ife-2" in honey.index
    assert honey.loc["honey-ife-2", "n_particles"] == 75


def test_flat_optima_and_ties_are_told(study):
    table = choice_table(fitted(study, WATER, HONEY, noise=0.3, people=6), SETTINGS).set_index(
        "model"
    )
    flat = table.loc["water-ife", "flat"]
    zetas = flat.partition("damping_zeta: ")[2].split(", ")
    assert f"{table.loc['water-ife', 'damping_zeta']:g}" in zetas
    assert len(zetas) > 1
    sets = fitted(study, "simple:g=0,m=0.14", None)
    one = sets["water-simple"]
    twice = type(one)(
        one.trials, {k: np.tile(v, 2) for k, v in one.axes.items()}, np.tile(one.judgments, (2, 1))
    )
    # Itself twice; and g = 0.5, which here only halves the spread, twice.
    assert choice_table({"water-simple": twice}, SETTINGS)["ties"].iloc[0] == 3


def test_chosen_specs_are_models(study):
    table = choice_table(fitted(study, WATER, HONEY), SETTINGS)
    for spec, zeta in zip(table["spec"], table["damping_zeta"], strict=True):
        model = make_model(spec)
        if np.isfinite(zeta):
            assert model.damping_zeta == zeta
            assert model.zeta_sigma == 4


def test_cross_validation_tells_the_optimism(study):
    noisy = cross_validation_table(
        fitted(study, WATER, HONEY, noise=0.6, people=5), SETTINGS, halvings=100
    )
    noisy = noisy.set_index("model")
    assert (noisy["optimism"] == noisy["train"] - noisy["test"]).all()
    assert noisy.loc["water-simple", "optimism"] > 0
    assert noisy.loc["water-ife", "train"] > noisy.loc["water-ife", "test"]
    clear = cross_validation_table(
        fitted(study, WATER, WATER, noise=0.02), SETTINGS, halvings=100
    ).set_index("model")
    assert abs(clear.loc["water-ife", "optimism"]) < 0.02
    assert "damping_zeta=5" in clear.loc["water-ife", "chosen"]


def test_too_few_scenes_are_not_halved():
    few = made_up(6)
    assert cross_validation_table(fitted(few, WATER, HONEY), SETTINGS).empty
    assert not choice_table(fitted(few, WATER, HONEY), SETTINGS).empty


def test_scores_hold_every_candidate(study):
    sets = fitted(study, WATER, HONEY)
    scores = scores_table(sets)
    assert len(scores) == sum(len(one.judgments) for one in sets.values())
    best = scores[scores["model"] == "water-ife"].sort_values("r").iloc[-1]
    assert (best["n_particles"], best["damping_zeta"]) == (25, 5)


def test_without_a_sweep_nothing_is_chosen(study):
    scenes, judged = study
    trials = [people_like(scenes, judged.judgments[0])]
    empty = type(judged)(judged.scenes, judged.rows.iloc[:0], judged.judgments[:0])
    assert candidates(empty, trials) == {}
    assert choice_table({}, SETTINGS).empty
    assert scores_table({}).empty


def test_carried_parameters_are_judged_unchanged(study):
    scenes, judged = study
    table = choice_table(fitted(study, WATER, HONEY), SETTINGS)
    trials = people_like(scenes, judged.find("water", WATER), seed=5)
    models = dict.fromkeys(table["spec"], judged.judgments[0])
    carried = carried_table([PeopleAndModels(trials, models)], table, SETTINGS)
    assert set(carried["model"]) == {"water-ife", "water-marble", "water-simple"}
    assert isinstance(carried, pd.DataFrame)
    expected = np.corrcoef(trials.responses.mean(axis=0), judged.judgments[0])[0, 1]
    assert carried["r"].to_numpy() == pytest.approx(np.full(3, expected))
