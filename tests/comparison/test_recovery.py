import numpy as np
import pandas as pd
import pytest

from pourcast.comparison import recovery
from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import candidates
from pourcast.comparison.choice import with_fitted
from pourcast.comparison.design import Design, model_recovery_table, power_table
from pourcast.comparison.recovery import (
    along,
    parameter_recovery_table,
    recover_models,
    recover_parameter,
    study_power,
)
from pourcast.errors import InputError
from pourcast.models.base import zeta_window
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene_file import write_scenes
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.statistics.observer import Population
from pourcast.study.trials import Trials
from pourcast.sweep.judgments import judgments_of
from pourcast.tables import write_table
from tests.comparison.make import (
    judgment_table,
    made_up,
    made_up_table,
    people_like,
    voronoi_scenes,
)

COMMON = {"population": Population(), "seed": 0}


def test_a_planted_zeta_is_recovered_within_one_step_in_90_of_100_studies():
    # Judgments of the uncertain IFE itself, from its own simulations.
    scenes, zetas = voronoi_scenes(24, seed=4), range(0, 14)
    outcomes = simulate([Pour(scene, WATER, 25, float(zeta)) for zeta in zetas for scene in scenes])
    single = np.array([one.judgment for one in outcomes]).reshape(len(zetas), len(scenes))
    centres = [zeta for zeta in zetas if zeta + 4 <= zetas[-1]]
    uncertain = np.array(
        [single[[int(z) for z in zeta_window(c, 4)]].mean(axis=0) for c in centres]
    )
    table = parameter_recovery_table(
        centres, uncertain, observers=30, studies=100, spread=0.0, **COMMON
    )
    assert (table["within_one_step"] >= 0.9).all(), table


def test_shares_add_up():
    _, judged = made_up(20)
    values, judgments = along(judged, "water", "ife:liquid=water", "damping_zeta")
    assert values == list(range(17))
    table = parameter_recovery_table(
        values, judgments, observers=5, studies=10, spread=1.0, **COMMON
    )
    assert table.drop(columns="within_one_step").sum(axis=1).to_numpy() == pytest.approx(
        np.ones(17)
    )
    assert table.index.name == "planted"


def test_other_parameters_can_be_recovered():
    _, judged = made_up(20)
    assert along(judged, "water", "ife:liquid=water", "n_particles")[0] == [15, 25, 50, 75]
    assert along(judged, "water", "ife:liquid=water", "viscosity_alpha")[0] == ["own", 0.2, 2.0]
    # Any liquid of the trial will do, if the model has one in its head.
    assert along(judged, "honey-exp1", "simple:g=0", "m")[1].shape == (11, 20)


@pytest.mark.parametrize(
    ("spec", "axis", "said"),
    [
        ("ife:liquid=water", "zeta", "there is no 'zeta'"),
        ("ife:liquid=water", "liquid", "there is no 'liquid'"),
        ("ife:liquid=water,n_particles=33", "damping_zeta", "0 of its values were swept"),
    ],
)
def test_what_was_not_swept_can_not_be_recovered(spec, axis, said):
    _, judged = made_up(5)
    with pytest.raises(InputError, match=said):
        along(judged, "water", spec, axis)


def of_water_trials(scenes, specs):
    """Judgments of models on trials with water alone."""
    rng = np.random.default_rng(3)
    tables = [judgment_table(scenes, spec, rng.random(len(scenes)), "water") for spec in specs]
    return judgments_of(tables, scenes)


@pytest.mark.parametrize("family", ["ife", "position-uncertainty"])
@pytest.mark.parametrize(("imagined", "taken"), [("trial", 0), ("water", 3), ("honey", 3)])
def test_another_liquid_s_judgments_stand_in_only_where_the_trial_makes_no_difference(
    family, imagined, taken
):
    scenes = voronoi_scenes(4)
    specs = [f"{family}:liquid={imagined},n_particles={n}" for n in (15, 20, 25)]
    judged = of_water_trials(scenes, specs)
    fixed = {"family": family, "imagined": imagined}
    assert len(judged.on_trials("water", **fixed)) == 3
    assert len(judged.on_trials("honey-exp1", **fixed)) == taken
    if taken:
        assert along(judged, "honey-exp1", specs[0], "n_particles")[0] == [15, 20, 25]
    else:
        with pytest.raises(InputError, match="0 of its values were swept"):
            along(judged, "honey-exp1", specs[0], "n_particles")


def test_models_that_use_no_liquid_stand_in_for_any_trial_and_unknown_ones_for_none():
    scenes = voronoi_scenes(4)
    judged = of_water_trials(scenes, ["marble:n_particles=15", "simple:g=0", "simple:g=1"])
    assert len(judged.on_trials("honey-exp1", family="marble")) == 1
    assert len(judged.on_trials("honey-exp1", family="simple")) == 2
    table = judgment_table(scenes, "simple:g=0", np.zeros(4), "water").assign(model="gone-away")
    assert len(judgments_of([table], scenes).on_trials("honey-exp1", family="gone-away")) == 0


def design_of(names, count=20, seed=0):
    rng, scenes = np.random.default_rng(seed), voronoi_scenes(count)
    models = {name: rng.random(count) for name in names}
    return Design("water", tuple(scenes), models, {})


def test_models_that_differ_much_are_recovered_and_told_apart():
    table = model_recovery_table(
        design_of("ab"), observers=20, studies=10, settings=Settings(), population=Population()
    )
    assert table[["a", "b"]].to_numpy() == pytest.approx(np.eye(2))
    assert (table["told"] > 0.5).all()


def test_a_model_that_comes_out_best_need_not_be_told_from_another():
    scenes, rng = voronoi_scenes(20), np.random.default_rng(0)
    right = rng.random(20)
    twin = np.clip(right + 0.02 * rng.standard_normal(20), 0, 1)
    design = Design("water", tuple(scenes), {"right": right, "twin": twin}, {})
    table = model_recovery_table(
        design, observers=20, studies=30, settings=Settings(), population=Population()
    )
    assert table.loc["right", "right"] > 0.5
    assert (table["told"] <= 0.2).all()
    few = model_recovery_table(
        design, observers=3, studies=3, settings=Settings(), population=Population()
    )
    assert (few["told"] == 0.0).all()  # Over three people nothing can be told.


def test_power_is_that_of_all_pairs_together():
    common = {"observers": [6, 20], "scenes": [10, 40], "studies": 40, "population": Population()}
    told = []
    power = power_table(
        design_of("ab"), "a", "b", settings=Settings(), report=lambda *said: told.append(said),
        **common,
    )  # fmt: skip
    sizes = [(6, 10), (6, 40), (20, 10), (20, 40)]
    assert list(zip(power["observers"], power["scenes"], strict=True)) == sizes
    assert ((power["low"] <= power["power"]) & (power["power"] <= power["high"])).all()
    assert power["drawn_again"].tolist() == [False, True, False, True]
    assert len(told) == 4
    # The same pair among eleven models, as `compare` corrects for 55 pairs.
    among = power_table(design_of("abcdefghijk"), "a", "b", settings=Settings(), **common)
    assert (among["power"] <= power["power"] + 0.1).all()
    assert among["power"].sum() < power["power"].sum() - 0.3


def power_between(true, rival, people, studies=40, scenes=None):
    count = len(true)
    design = Design("water", tuple(voronoi_scenes(count)), {"true": true, "rival": rival}, {})
    table = power_table(
        design, "true", "rival", observers=[people], scenes=[scenes or count], studies=studies,
        population=Population(), settings=Settings(),
    )  # fmt: skip
    return table.iloc[0]


def test_power_grows_with_participants_and_with_what_differs():
    rng = np.random.default_rng(0)
    true = rng.random(30)
    near = np.clip(true + 0.12 * rng.standard_normal(30), 0, 1)
    assert power_between(true, near, 60)["power"] > power_between(true, near, 6)["power"] + 0.2
    far = power_between(true, rng.random(30), 20)
    assert (far["power"], far["wrong"]) == (1.0, 0.0)
    same = power_between(true, np.clip(true + 1e-3 * rng.standard_normal(30), 0, 1), 20)
    assert same["power"] < 0.2


def test_a_model_that_says_the_same_of_all_scenes_is_told_from_none():
    rng = np.random.default_rng(0)
    assert power_between(rng.random(6), np.full(6, 0.5), 6, studies=3)["power"] == 0.0


def swept_design(count=24):
    """A family whose members differ, and a preset that is one of them."""
    scenes, judged = made_up(count)
    nobody = Trials("water", (), tuple(scenes), np.empty((0, count)))
    sets = candidates(judged, [nobody])
    one = sets["water-simple"]
    return Design("water", tuple(scenes), {"preset": one.judgments[3]}, {"water-simple": one})


def test_what_was_swept_is_fitted_to_each_study_anew():
    design, rng = swept_design(), np.random.default_rng(0)
    assert design.names == ["preset", "water-simple:fitted"]
    assert design.only_different().names == ["water-simple:fitted"]
    planted = [design.planted("water-simple:fitted", rng) for _ in range(20)]
    assert len({values.tobytes() for values in planted}) > 5
    population, everything = Population(), np.arange(24)
    for judgments in planted[:5]:
        responses = population.respond(judgments, population.draw(30, rng), rng)
        found = design.analysed(responses, everything, Settings())
        fitted = found.models["water-simple:fitted"]
        assert np.corrcoef(fitted, judgments)[0, 1] > 0.9


# Of a study ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study whose sweep is made up."""
    study, scenes = tmp_path_factory.mktemp("study"), voronoi_scenes(9)
    write_scenes(study / "scenes.json", scenes)
    write_table(study / "judgments" / "grid.parquet", made_up_table(scenes))
    return study


SMALL = {"observers": 5, "studies": 4, "population": Population()}


def test_a_model_that_inherits_from_another_liquid_is_fitted_to_each_study_with_what_was_chosen():
    scenes, judged = made_up(20)
    trials = [
        people_like(scenes, judged.find("water", "water-ife"), liquid=liquid)
        for liquid in ("water", "honey-exp1")
    ]
    sets = candidates(judged, trials)
    honey = with_fitted(
        [PeopleAndModels(trials[0], {}), PeopleAndModels(trials[1], {})], sets, Settings()
    )[1]
    assert "honey-ife-2:fitted" in honey.names
    design = Design.of(honey, sets)
    assert "honey-ife-2:fitted" in design.names
    everything = np.arange(len(scenes))
    planted = design.planted("honey-ife-2:fitted", np.random.default_rng(0))
    responses = Population().respond(
        planted, Population().draw(12, np.random.default_rng(1)), np.random.default_rng(2)
    )
    analysed = design.analysed(responses, everything, Settings())
    assert set(analysed.names) == set(design.names)


def test_a_parameter_of_a_study_is_recovered_from_its_tables(folder):
    found = recover_parameter(folder, "damping_zeta", "water", spread=0.0, seed=0, **SMALL)
    assert found.title == "water-ife: damping_zeta"
    assert list(found.table.index) == list(range(17))
    simple = recover_parameter(folder, "m", "honey", "simple:g=0", spread=0.0, seed=0, **SMALL)
    assert simple.title == "simple:g=0: m"
    assert len(simple.table) == 11
    assert not (folder / "sweep").exists()  # Nothing was simulated.


def test_models_of_a_study_are_judged_and_told_apart(folder, monkeypatch):
    monkeypatch.setattr(recovery, "complete_presets", lambda: ["gravity", "water-simple"])
    found = recover_models(folder, "water", settings=Settings(), **SMALL)
    assert found.title == "water trials: 5 participants, 9 scenes"
    fitted = ["water-ife:fitted", "water-marble:fitted", "water-simple:fitted"]
    assert list(found.table.index) == ["gravity", "water-simple", *fitted]
    shares = found.table.drop(columns="told")
    assert shares.sum(axis=1).to_numpy() == pytest.approx(np.ones(5))
    named = recover_models(
        folder, "water", ["gravity", "water-ife:fitted"], settings=Settings(), **SMALL
    )
    assert list(named.table.index) == ["gravity", "water-ife:fitted"]
    for specs, said in (
        (["gravity", "gravity"], "expected at least two models to tell apart"),
        (["gravity", "blobs:fitted"], "there is no 'blobs:fitted'"),
    ):
        with pytest.raises(InputError, match=said):
            recover_models(folder, "water", specs, settings=Settings(), **SMALL)


def test_power_of_a_study_has_its_own_size(folder, monkeypatch):
    rest = {"studies": 2, "settings": Settings(level=0.9), "population": Population()}
    two = ["gravity", "water-simple"]
    found = study_power(folder, "water", two, **rest)
    assert found.title == "gravity in people's heads, told from water-simple"
    # Nobody took part: as many as in each of the two groups of Experiment 1, whose scenes these are.
    assert set(found.table["observers"]) == {*recovery.OBSERVER_COUNTS, 32}
    assert set(found.table["scenes"]) == {9}
    small = study_power(folder, "water", two, observers=[7], scenes=[5], **rest).table
    assert small["scenes"].tolist() == [5, 9, 5, 9]
    rows = pd.DataFrame({"participant": [f"p{k}" for k in range(8)], "liquid": "water"})
    scene = voronoi_scenes(1)[0].id
    write_table(folder / "responses" / "a.csv", rows.assign(scene=scene, response=0.5))
    asked = study_power(folder, "water", two, observers=[7], **rest).table
    assert asked["observers"].tolist() == [7, 8]
    monkeypatch.setattr(recovery, "OPPONENTS", tuple(two))
    monkeypatch.setattr(recovery, "complete_presets", lambda: [*two, "honey-simple"])
    among = study_power(folder, "water", observers=[7], **rest)
    assert among.title.endswith("p corrected for all 15 pairs of 6 models")
    for wrong in (["gravity"], ["gravity", "gravity"]):
        with pytest.raises(InputError, match="expected two models to tell apart"):
            study_power(folder, "water", wrong, **rest)
