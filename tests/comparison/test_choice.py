from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import candidates
from pourcast.comparison.choice import (
    carried_table,
    choice_table,
    cross_validation_table,
    judgments_of_fitted,
    scores_table,
)
from pourcast.models.registry import make_model
from pourcast.statistics.differences import compare_pairs
from pourcast.sweep.judgments import judgments_of
from tests.comparison.make import (
    judgment_table,
    made_up,
    made_up_table,
    people_like,
    smooth,
)

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
    axes = {name: np.tile(column, 2) for name, column in one.axes.items()}
    twice = replace(one, axes=axes, judgments=np.tile(one.judgments, (2, 1)))
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


# Any other model --------------------------------------------------------------------------


def with_rival(study):
    """The made-up sweep, and a family of its own in it: `position-uncertainty`, made up too."""
    scenes, _ = study
    rng = np.random.default_rng(8)
    family = smooth(rng, len(scenes), range(6))
    tables = [
        judgment_table(
            scenes, f"position-uncertainty:n_particles=25,position_sd={0.01 * k}", family[k],
            "water",
        )
        for k in range(1, 6)
    ]  # fmt: skip
    return scenes, judgments_of([made_up_table(scenes), *tables], scenes), family


def test_a_rival_is_fitted_by_its_own_parameters(study):
    scenes, judged, family = with_rival(study)
    sets = candidates(judged, [people_like(scenes, family[3], noise=0.05)])
    rival = sets["position-uncertainty"]
    assert rival.free == ("position_sd",)  # The others have one value only.
    row = choice_table(sets, SETTINGS).set_index("model").loc["position-uncertainty"]
    assert row["position_sd"] == pytest.approx(0.03)
    assert row["spec"] == "position-uncertainty:n_particles=25,position_sd=0.03"
    assert make_model(row["spec"]).n_particles == 25
    assert (row["candidates"], row["fitted"], row["paper"]) == (5, "position_sd", "")
    validated = cross_validation_table(sets, SETTINGS, halvings=20).set_index("model")
    assert "position_sd=0.03" in validated.loc["position-uncertainty", "chosen"]
    assert set(scores_table(sets)["model"]) >= {"position-uncertainty", "water-ife"}


def test_a_rival_is_fitted_to_each_liquid_where_the_trial_s_makes_no_difference(study):
    scenes, judged = study
    trials = [
        people_like(scenes, judged.judgments[0], liquid=liquid) for liquid in ("water", "oil")
    ]
    sets = candidates(judged, trials)
    assert {"water-ife", "ife (oil)", "marble (oil)", "simple (oil)"} <= set(sets)
    swept = {"liquid", "n_particles", "viscosity_alpha", "damping_zeta", "zeta_sigma"}
    assert set(sets["ife (oil)"].free) == swept
    table = choice_table(sets, SETTINGS)
    oil = table[table["liquid"] == "oil"].set_index("model")
    for spec in oil["spec"]:
        make_model(spec)
    assert "liquid=" in oil.loc["ife", "spec"]


def test_a_half_is_judged_with_what_was_chosen_on_the_other(study):
    scenes, judged = study
    sets = candidates(judged, [people_like(scenes, judged.find("water", WATER), noise=0.3)])
    fitted = judgments_of_fitted(sets, SETTINGS)
    again = judgments_of_fitted(sets, SETTINGS)
    assert set(fitted) == {"water-ife", "water-marble", "water-simple"}
    assert all((fitted[name] == again[name]).all() for name in fitted)
    # Another answer to a scene changes nothing of what that scene's half was chosen on.
    one = sets["water-simple"]
    fitted = judgments_of_fitted({"water-simple": one}, SETTINGS, halvings=1)
    for scene in (0, 7, 20):
        responses = one.trials.responses.copy()
        responses[:, scene] = 1.0 - responses[:, scene]
        changed = {"water-simple": replace(one, trials=replace(one.trials, responses=responses))}
        after = judgments_of_fitted(changed, SETTINGS, halvings=1)["water-simple"]
        assert after[scene] == fitted["water-simple"][scene]


def test_what_is_found_hardly_depends_on_the_seed(study):
    sets = fitted(study, WATER, None, noise=0.5, people=6)
    means = sets["water-ife"].trials.responses.mean(axis=0)
    spread = {}
    for halvings in (1, 25):
        judged = [judgments_of_fitted(sets, Settings(seed=k), halvings) for k in range(16)]
        for name in sets:
            r = [np.corrcoef(means, each[name])[0, 1] for each in judged]
            spread.setdefault(name, []).append(np.std(r))
    for one, median in spread.values():
        assert median <= max(0.5 * one, 1e-3)


def test_halves_that_choose_the_same_setting_are_that_setting(study):
    judged = study[1]
    one = fitted(study, WATER, None, noise=0.02)["water-ife"]
    best = judged.find("water", WATER)
    found = judgments_of_fitted({"water-ife": one}, SETTINGS)["water-ife"]
    assert (found == best).all()
    pair = compare_pairs(one.trials.responses, np.stack([best, found]), "both")
    assert (pair.difference[0], pair.p[0]) == (0.0, 1.0)


def test_settings_that_differ_in_level_and_scale_alone_are_one_model(study):
    scenes, judged = study
    shape = judged.judgments[0]
    gains, bases = np.linspace(0.2, 1.0, 12), np.linspace(0.0, 0.3, 12)
    settings = np.clip(bases[:, None] + gains[:, None] * 0.7 * shape, 0.0, 1.0)
    one = fitted(study, WATER, None)["water-simple"]
    for seed in range(5):
        trials = people_like(scenes, shape, noise=0.4, people=6, seed=seed)
        rival = replace(
            one, trials=trials, axes={"gain": gains}, free=("gain",), judgments=settings
        )
        found = judgments_of_fitted({"rival": rival}, Settings(seed=seed))["rival"]
        assert np.corrcoef(found, shape)[0, 1] == pytest.approx(1.0)


def test_all_settings_worse_than_nothing_stay_so(study):
    scenes, judged = study
    rng, shape = np.random.default_rng(0), judged.judgments[0]
    own = rng.random((6, len(scenes)))
    settings = np.clip(1.0 - shape + 0.3 * own - np.linspace(0.0, 0.5, 6)[:, None], 0.0, 1.0)
    one = fitted(study, WATER, None)["water-simple"]
    trials = people_like(scenes, shape, noise=0.1)
    rival = replace(one, trials=trials, axes={"k": np.arange(6.0)}, free=("k",), judgments=settings)
    found = judgments_of_fitted({"rival": rival}, SETTINGS)["rival"]
    assert np.corrcoef(found, shape)[0, 1] < -0.5


def test_scenes_of_one_liquid_alone_are_halved_by_themselves(study):
    scenes, judged = study
    water, honey = (
        people_like(scenes[rows], judged.judgments[3][rows], liquid=liquid)
        for liquid, rows in (("water", slice(0, 9)), ("honey-exp1", slice(9, 25)))
    )
    sets = candidates(judged, [water, honey])
    assert {"water-simple", "honey-simple"} <= set(judgments_of_fitted(sets, SETTINGS))
    few = candidates(judged, [people_like(scenes[:7], judged.judgments[3][:7]), honey])
    assert "water-simple" not in judgments_of_fitted(few, SETTINGS)


def test_too_few_scenes_and_single_candidates_are_not_fitted(study):
    scenes, judged = made_up(6)
    assert judgments_of_fitted(candidates(judged, [people_like(scenes, WAVE[:6])]), SETTINGS) == {}
    scenes, judged = study
    sets = candidates(judged, [people_like(scenes, WAVE)])
    one = sets["water-simple"]
    single = replace(one, axes={k: v[:1] for k, v in one.axes.items()}, judgments=one.judgments[:1])
    assert judgments_of_fitted({"water-simple": single}, SETTINGS) == {}


WAVE = np.linspace(0.1, 0.9, 30)
