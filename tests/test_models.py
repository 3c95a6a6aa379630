"""Contract tests over every model that is found, and the registry."""

import subprocess
import sys
import tomllib
from dataclasses import FrozenInstanceError, dataclass, replace
from importlib.resources import files

import numpy as np
import pytest

from pourcast.errors import InputError, ModelError
from pourcast.models.base import Model, SimulationModel, checked_judgments, parameter
from pourcast.models.registry import (
    MODELS,
    complete_presets,
    make_model,
    model_names,
    parameter_table,
    parse_parameter,
    presets,
)
from pourcast.pictures.demo import demo_scenes
from pourcast.registry import Registry
from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.liquids.registry import (
    HONEY_EXP1,
    HONEY_EXP2,
    WATER,
    imagined_liquid,
    resolve_liquid,
)
from tests.make import ramp_scene, random_scenes

SMALL = {
    "blobs": "blobs:n_molecules=50",
    "ife": "ife:n_particles=20,zeta_sigma=1",
    "marble": "marble:n_particles=15,zeta_sigma=1",
    "position-uncertainty": "position-uncertainty:n_particles=20,n_draws=8",
    "simple": "simple",
}
"""A small variant of every family, so that the contract is cheap to test."""


def test_every_family_is_under_contract():
    # That of networks is in `tests/networks`: it needs one, and torch.
    assert {*SMALL, "convnet"} == set(MODELS.names())


@pytest.mark.parametrize("name", SMALL)
def test_contract(name):
    check_contract(make_model(SMALL[name]), random_scenes(6, seed=11))


def check_contract(model, scenes):
    """What any model owes on six scenes."""
    seen = []
    judged = model.judge(scenes, WATER, 1, progress=lambda *count: seen.append(count))
    assert judged.shape == (6,)
    assert judged.dtype == np.float64
    assert ((judged >= 0) & (judged <= 1)).all()
    assert len(set(np.round(judged, 6))) > 2
    assert seen[-1][0] == seen[-1][1]
    # Same seed, same answer, whatever the company.
    assert (model.judge(scenes, WATER, 1) == judged).all()
    assert (model.judge(scenes[3:], WATER, 1) == judged[3:]).all()
    with pytest.raises(FrozenInstanceError):
        model.n_particles = 3


@pytest.mark.parametrize("name", SMALL)
def test_a_mirrored_scene_has_a_mirrored_judgment(name):
    # Few particles: one of 15 is 0.07. The mean over scenes says whether a side is preferred.
    scenes = random_scenes(24, seed=12)
    model = make_model(SMALL[name])
    here = model.judge(scenes, WATER)
    there = model.judge([scene.mirrored() for scene in scenes], WATER)
    expected = np.where([s.goal.kind == "basins" for s in scenes], 1.0 - there, there)
    assert np.abs(here - expected).mean() < 0.08
    assert abs(np.mean(here - expected)) < 0.04


@pytest.mark.parametrize("name", SMALL)
def test_a_model_that_is_said_not_to_follow_the_trial_does_not(name):
    for liquid in ("trial", "water", "honey"):
        spec = SMALL[name]
        if "liquid" in make_model(spec).parameters():
            spec += f",liquid={liquid}"
        model, scenes = make_model(spec), random_scenes(4, seed=11)
        same = (model.judge(scenes, WATER, 1) == model.judge(scenes, HONEY_EXP1, 1)).all()
        assert same == (not type(model).follows_trial(model.parameters())), spec


SHARING = [n for n in SMALL if getattr(MODELS.get(n), "same_pours_everywhere", False)]


@pytest.mark.parametrize("name", SHARING)
def test_pours_that_are_said_to_be_the_same_everywhere_are(name):
    model = make_model(SMALL[name])
    assert isinstance(model, SimulationModel)
    for kind in ("basins", "cup"):
        scenes = [s for s in random_scenes(6, seed=14) if s.goal.kind == kind]
        first = model.pours(scenes[0], HONEY_EXP1, seed=0)
        for scene in scenes[1:]:
            there = [replace(pour, scene=scenes[0]) for pour in model.pours(scene, HONEY_EXP1, 5)]
            assert there == first


def test_presets_are_the_papers_table():
    def values(name):
        return make_model(name).parameters()

    common = {"n_particles": 50, "zeta_sigma": 4, "viscosity_alpha": None}
    assert values("water-ife") == common | {"damping_zeta": 5.0, "liquid": "water"}
    assert values("honey-ife-1") == common | {"damping_zeta": 5.0, "liquid": "honey"}
    assert values("honey-ife-2") == common | {"damping_zeta": 11.0, "liquid": "water"}
    truth = {"damping_zeta": 0.0, "zeta_sigma": 0, "viscosity_alpha": None}
    assert values("truth-water") == truth | {"n_particles": 200, "liquid": "water"}
    assert values("truth-honey") == truth | {"n_particles": 100, "liquid": "honey"}
    assert values("water-marble") == {"n_particles": 25, "damping_zeta": 2.0, "zeta_sigma": 4}
    assert values("honey-marble") == {"n_particles": 75, "damping_zeta": 6.0, "zeta_sigma": 4}
    simple = {"m_sigma": 0.04, "n_points": 100}
    assert values("water-simple") == simple | {"g": 0.1, "m": 0.1}
    assert values("honey-simple") == simple | {"g": 0.0, "m": 0.04}
    assert values("gravity") == {"g": 0.0, "m": 0.0, "m_sigma": 0.0, "n_points": 100}
    assert values("position-uncertainty")["damping_zeta"] == 0.0
    assert values("blobs") == {"n_molecules": 100}
    assert len(presets()) == 14
    assert set(presets()) - set(complete_presets()) == {"water-convnet", "honey-convnet"}


def test_every_preset_says_where_it_is_from():
    content = tomllib.loads(files("pourcast.models").joinpath("presets.toml").read_text())
    assert all(entry["source"] for entry in content.values())


def test_honey_is_that_of_the_experiment():
    ramp = ramp_scene()
    cup = ramp.model_copy(update={"goal": Cup(centre_x=0.5)})
    assert resolve_liquid("honey", ramp) is HONEY_EXP1
    assert resolve_liquid("honey", cup) is HONEY_EXP2
    assert (HONEY_EXP1.viscosity_alpha, HONEY_EXP2.viscosity_alpha) == (2.0, 1.25)
    assert imagined_liquid("trial", HONEY_EXP2, ramp) is HONEY_EXP2
    assert imagined_liquid("water", HONEY_EXP2, ramp) is WATER


def test_a_model_with_the_trials_liquid_tells_water_from_honey():
    scenes = random_scenes(8, seed=13)
    model = make_model("ife:n_particles=20,zeta_sigma=0")
    water, honey = model.judge(scenes, WATER), model.judge(scenes, HONEY_EXP1)
    assert np.abs(water - honey).max() > 0.05
    fixed = make_model("water-ife:n_particles=20,zeta_sigma=0")
    assert (fixed.judge(scenes, HONEY_EXP1) == water).all()


def test_a_parameter_may_be_yes_or_no():
    @dataclass(frozen=True)
    class Blinking:
        blinks: bool = False

    assert parse_parameter("blinking", Blinking, "blinks", "True") is True
    assert parse_parameter("blinking", Blinking, "blinks", "false") is False
    with pytest.raises(InputError, match="blinks: expected true or false, found '1'"):
        parse_parameter("blinking", Blinking, "blinks", "1")


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("water-if", "there is no 'water-if'; did you mean 'water-ife'"),
        ("zzz", "there is no 'zzz'; known: water-ife"),
        ("water-ife:n_partcles=5", "there is no 'n_partcles'; did you mean 'n_particles'"),
        ("water-ife:n_particles=many", "n_particles: expected a whole number, found 'many'"),
        ("water-ife:n_particles=0", "n_particles: expected 1 to 2000, found 0"),
        ("water-ife:damping_zeta=nan", "damping_zeta: expected 0 to 100 1/s, found nan"),
        ("water-ife:damping_zeta", "expected parameter=value"),
        ("water-ife:liquid=watr", "there is no 'watr'; did you mean 'water'"),
        ("gravity:g=1.5", "g: expected 0 to 1, found 1.5"),
        ("", "there is no ''"),
    ],
)
def test_a_wrong_name_or_value_is_answered_with_the_nearest_right_one(spec, message):
    with pytest.raises(InputError, match="(?s)" + message) as caught:
        make_model(spec)
    assert "\n" not in str(caught.value)


def test_parameters_can_be_set_and_unset():
    model = make_model("honey-ife-1: n_particles=75, viscosity_alpha=1.25")
    assert (model.n_particles, model.viscosity_alpha, model.damping_zeta) == (75, 1.25, 5.0)
    assert make_model("ife:viscosity_alpha=none").viscosity_alpha is None


FREE_WORDS = {("convnet", "weights"), ("convnet", "liquid")}


def test_parameter_tables_are_complete():
    for name in MODELS.names():
        for row in parameter_table(name):
            assert row["meaning"]
            assert row["range"] or (name, row["parameter"]) in FREE_WORDS


def test_names_are_listed_without_importing_models():
    code = (
        "import sys, pourcast.models.registry as m; m.model_names(); "
        "print([k for k in sys.modules if k.startswith('pourcast.models.') and k[16:] not in ('base', 'registry')])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_model_that_cannot_be_loaded_hurts_only_itself(monkeypatch):
    class Broken:
        name = "broken"

        def load(self):
            raise ImportError("No module named 'torch'")

    monkeypatch.setattr(Registry, "third_party", lambda self: {"broken": Broken()})
    assert "broken" in model_names()
    assert make_model("gravity").g == 0.0
    with pytest.raises(InputError, match="'broken' cannot be loaded: No module named 'torch'"):
        make_model("broken")


def test_what_is_no_model_is_refused(monkeypatch):
    class Wrong:
        def load(self):
            return 3

    monkeypatch.setattr(Registry, "third_party", lambda self: {"wrong": Wrong()})
    with pytest.raises(InputError, match="expected a subclass of pourcast"):
        MODELS.get("wrong")


PLUGIN = '''
from dataclasses import dataclass
import numpy as np
from pourcast import Model, parameter

@dataclass(frozen=True)
class Coin(Model):
    """Says the same of every scene."""
    bias: float = parameter(0.5, low=0, high=1, doc="what it says")

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        return np.full(len(scenes), self.bias)
'''


def test_a_third_party_package_registers_a_model(tmp_path):
    package = tmp_path / "package"
    package.mkdir()
    (package / "coin_model.py").write_text(PLUGIN)
    (package / "pyproject.toml").write_text(
        '[build-system]\nrequires = ["hatchling"]\nbuild-backend = "hatchling.build"\n'
        '[project]\nname = "coin-model"\nversion = "1"\n'
        '[project.entry-points."pourcast.models"]\ncoin = "coin_model:Coin"\n'
        '[tool.hatch.build.targets.wheel]\ninclude = ["coin_model.py"]\n'
    )
    site = tmp_path / "site"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "-q", "--no-build-isolation", "--no-deps",
         "--target", str(site), str(package)],
        check=True, capture_output=True,
    )  # fmt: skip
    from tests.test_cli import scene_file

    run = subprocess.run(
        [sys.executable, "-m", "pourcast", "predict", str(scene_file(tmp_path, 2)),
         "-m", "coin:bias=0.25", "--json"],
        capture_output=True, text=True, check=True, env={"PYTHONPATH": str(site), "HOME": str(tmp_path)},
    )  # fmt: skip
    assert run.stdout.count('"judgment": 0.25') == 2


def test_models_are_models():
    for name in MODELS.names():
        assert issubclass(MODELS.get(name), Model)


@pytest.mark.parametrize(
    ("said", "complaint"),
    [
        (
            lambda scenes: np.full(len(scenes), np.nan),
            "scene 'basins': expected a judgment from 0 ",
        ),
        (lambda scenes: np.array([0.5, 1.01]), "scene 'cup': expected .* found 1.01"),
        (lambda scenes: np.array([-0.1, 0.5]), "scene 'basins': expected .* found -0.1"),
        (lambda scenes: np.zeros(1), r"one judgment for each of 2 scenes.* shape \[1\]"),
        (lambda scenes: np.zeros((2, 1)), r"one judgment for each of 2 scenes"),
    ],
)
def test_what_is_no_judgment_is_not_returned(said, complaint):
    scenes = [
        scene.model_copy(update={"id": scene.goal.kind})
        for scene in sorted(demo_scenes(), key=lambda scene: scene.goal.kind)
    ]
    with pytest.raises(ModelError, match=f"model 'odd': .*{complaint}"):
        checked_judgments(said(scenes), "odd", scenes)


@dataclass(frozen=True)
class OpenRanges(Model):
    """Parameters whose ranges are open at an end."""

    rate: float = parameter(1.0, low=0, unit="1/s", doc="at least 0")
    share: float = parameter(0.5, high=1, doc="at most 1")
    any_number: float = parameter(0.0, doc="any number")

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        """Nothing falls."""
        return np.zeros(len(scenes))


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"rate": -1.0}, "rate: expected at least 0 1/s, found -1"),
        ({"share": 1.5}, "share: expected at most 1, found 1.5"),
        ({"rate": float("inf")}, "rate: expected at least 0 1/s, found inf"),
        ({"any_number": float("nan")}, "any_number: expected a finite number, found nan"),
    ],
)
def test_a_range_that_is_open_at_an_end_is_told_in_words(values, complaint):
    with pytest.raises(InputError, match=f"^OpenRanges: {complaint}$"):
        OpenRanges(**values)


def test_no_table_of_parameters_says_none():
    for name in MODELS.names():
        assert all("None" not in row["range"] for row in parameter_table(name))
