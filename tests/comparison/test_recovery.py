import numpy as np
import pytest

from pourcast.comparison import recovery
from pourcast.comparison.recovery import (
    along,
    model_recovery_table,
    parameter_recovery_table,
    power_table,
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
from pourcast.sweep.judgments import judgments_of
from pourcast.tables import write_table
from tests.comparison.make import judgment_table, made_up, made_up_table, voronoi_scenes

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


def test_models_and_power():
    rng = np.random.default_rng(0)
    models = {"a": rng.random(20), "b": rng.random(20)}
    table = model_recovery_table(models, observers=10, studies=10, **COMMON)
    assert table.to_numpy() == pytest.approx(np.eye(2))
    told = []
    power = power_table(
        models, observers=[3, 6], scenes=[10, 40], studies=4, over="both", level=0.95,
        report=lambda *progress: told.append(progress), **COMMON,
    )  # fmt: skip
    assert list(zip(power["observers"], power["scenes"], strict=True)) == [
        (3, 10),
        (3, 40),
        (6, 10),
        (6, 40),
    ]
    assert ((power["low"] <= power["power"]) & (power["power"] <= power["high"])).all()
    assert len(told) == 4


# Of a study ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study whose sweep is made up."""
    study, scenes = tmp_path_factory.mktemp("study"), voronoi_scenes(6)
    write_scenes(study / "scenes.json", scenes)
    write_table(study / "judgments" / "grid.parquet", made_up_table(scenes))
    return study


SMALL = {"observers": 5, "studies": 4, **COMMON}


def test_a_parameter_of_a_study_is_recovered_from_its_tables(folder):
    found = recover_parameter(folder, "damping_zeta", "water", spread=0.0, **SMALL)
    assert found.title == "water-ife: damping_zeta"
    assert list(found.table.index) == list(range(17))
    simple = recover_parameter(folder, "m", "honey", "simple:g=0", spread=0.0, **SMALL)
    assert simple.title == "simple:g=0: m"
    assert len(simple.table) == 11
    assert not (folder / "sweep").exists()  # Nothing was simulated.


def test_models_of_a_study_are_judged_and_told_apart(folder, monkeypatch):
    monkeypatch.setattr(recovery, "complete_presets", lambda: ["gravity", "water-simple"])
    found = recover_models(folder, "water", **SMALL)
    assert found.title == "water trials: 5 participants, 6 scenes"
    assert list(found.table.index) == ["gravity", "water-simple"]
    assert found.table.sum(axis=1).to_numpy() == pytest.approx(np.ones(2))
    with pytest.raises(InputError, match="expected at least two models to tell apart"):
        recover_models(folder, "water", ["gravity", "gravity"], **SMALL)


def test_power_of_a_study(folder, monkeypatch):
    rest = {"studies": 2, "over": "both", "level": 0.9, **COMMON}
    two = ["gravity", "water-simple"]
    found = study_power(folder, "water", two, **rest)
    assert found.title == "gravity in people's heads, told from water-simple"
    assert list(found.table["observers"]) == list(recovery.OBSERVER_COUNTS)
    assert set(found.table["scenes"]) == {6}
    small = study_power(folder, "water", two, observers=[3], scenes=[3, 5], **rest).table
    assert list(small["scenes"]) == [3, 5]
    monkeypatch.setattr(recovery, "OPPONENTS", tuple(two))
    assert study_power(folder, "water", **rest).table.equals(found.table)
    for wrong in (["gravity"], ["gravity", "gravity"], [*two, "honey-simple"]):
        with pytest.raises(InputError, match="expected two models to tell apart"):
            study_power(folder, "water", wrong, **rest)
