"""Members of other packages that are broken, or odd: each hurts only itself, in one line."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pourcast import cli
from pourcast.errors import InputError, StoreError
from pourcast.files import write_text
from pourcast.models.base import Model, SimulationModel, parameter
from pourcast.pictures.show import show
from pourcast.prediction import predict
from pourcast.registry import Registry
from pourcast.scenes.scene_file import write_scenes
from pourcast.simulation.pour import Pour
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.sweep.judgments import judge_in_study, judgments_of, study_judgments
from tests.experiment.make import scenes_of


class Entry:
    """An entry point that loads something, or raises."""

    def __init__(self, member):
        self.member = member

    def load(self):
        if isinstance(self.member, Exception):
            raise self.member
        return self.member


@pytest.fixture
def installed(monkeypatch):
    """Install members for a while: group -> name -> what is loaded."""
    members = {}

    def third_party(registry):
        return {name: Entry(one) for name, one in members.get(registry.group, {}).items()}

    monkeypatch.setattr(Registry, "third_party", third_party)
    return lambda group, **named: members.setdefault(f"pourcast.{group}", {}).update(named)


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_scenes(tmp_path / "s" / "scenes.json", scenes_of("exp1", 2))
    return tmp_path / "s"


def complaint(capsys, *arguments, code=2):
    assert cli.run([str(argument) for argument in arguments]) == code
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1, said
    return said


@pytest.mark.parametrize("member", [RuntimeError("boom"), SyntaxError("boom"), "boom", 3])
@pytest.mark.parametrize("group", ["liquids", "goals", "experiments", "models"])
def test_one_that_is_broken_hurts_only_itself(installed, study, capsys, group, member):
    installed(group, bad=member)
    for command in (["list"], ["models"], ["predict", "s", "-m", "gravity"]):
        assert cli.run(command) == 0, capsys.readouterr().err
        said = capsys.readouterr().out
        listed = command[0] == ("models" if group == "models" else "list")
        assert ("note: " in said and "'bad'" in said) == listed
    calls = {
        "liquids": ["predict", "s", "-m", "gravity", "--liquid", "bad"],
        "models": ["predict", "s", "-m", "bad"],
        "experiments": ["scenes", "bad", "-o", "x.json"],
    }
    if group in calls:
        assert f"{group[:-1]} 'bad'" in complaint(capsys, *calls[group])


@dataclass(frozen=True)
class Says(Model):
    """Says something, which may be no judgment."""

    what = 0.5

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        if isinstance(self.what, Exception):
            raise self.what
        return np.full(len(scenes), self.what) if isinstance(self.what, float) else self.what


def saying(what):
    return type("Saying", (Says,), {"what": what})


ODD = [1.7, -3.0, float("inf"), float("nan"), ["a", "b"], [0.5], "x", ZeroDivisionError("no")]


@pytest.mark.parametrize("what", ODD, ids=str)
def test_what_is_no_judgment_is_refused_by_every_way_to_ask(installed, study, capsys, what):
    installed("models", odd=saying(what))
    assert "model 'odd'" in complaint(capsys, "predict", "s", "-m", "odd", code=1)
    with pytest.raises(StoreError, match="model 'odd'") as told:
        judge_in_study(study, scenes_of("exp1", 2), [("water", "odd")], "asked")
    assert "\n" not in str(told.value)


@dataclass(frozen=True)
class Stubborn(SimulationModel):
    """Pours, but says what it likes."""

    same_pours_everywhere = True

    def pours(self, scene, liquid, seed=0):
        return [Pour(scene, liquid, 5, 7.0)]

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        return 0.25 + 0.0 * super().judge(scenes, liquid, seed)


def test_a_pouring_model_that_judges_in_its_own_way_is_asked_by_every_way_to_ask(
    installed, study, tmp_path
):
    installed("models", stubborn=Stubborn)
    scenes = scenes_of("exp1", 2)
    assert (predict(scenes, ["stubborn"])["judgment"] == 0.25).all()
    (shown,) = show(scenes[0], tmp_path / "p.png", ["stubborn"])
    assert shown.judgment == 0.25
    asked = judge_in_study(study, scenes, [("water", "stubborn")], "asked")
    assert (asked["water", "stubborn"] == 0.25).all()


@pytest.mark.parametrize("said", [None, [], [1, 2]], ids=str)
def test_who_gives_no_pours_is_named_and_no_other_model(installed, study, capsys, said):
    installed("models", odd=pouring(lambda *_: said), good=pouring(_one_pour))
    complaints = complaint(capsys, "predict", "s", "-m", "good", "-m", "odd", code=1)
    assert "model 'odd' failed" in complaints


def test_pours_may_come_one_by_one(installed, study, capsys):
    installed("models", odd=pouring(lambda *given: iter(_one_pour(*given))))
    assert cli.run(["predict", "s", "-m", "odd"]) == 0, capsys.readouterr().err


def _one_pour(_model, scene, liquid, _seed=0):
    return [Pour(scene, liquid, 5, 7.0)]


def pouring(pours):
    return dataclass(frozen=True)(type("Pouring", (SimulationModel,), {"pours": pours}))


def test_a_model_without_parameters_is_a_model(installed, study, capsys):
    installed("models", half=saying(0.5))
    assert cli.run(["models"]) == 0
    assert "\nhalf\n" in capsys.readouterr().out
    assert cli.run(["predict", "s", "-m", "half"]) == 0


@dataclass(frozen=True)
class Named(Says):
    """Parameters that are named as columns of ours."""

    family: int = parameter(1, low=0, doc="a number")
    parameters_: int = parameter(2, low=0, doc="another")
    imagined: int = parameter(3, low=0, doc="and another")


def test_parameters_may_be_called_as_columns_are(installed, study):
    installed("models", named=Named)
    scenes = scenes_of("exp1", 2)
    found = judge_in_study(study, scenes, [("water", "named:family=4")], "asked")
    assert (found["water", "named:family=4"] == 0.5).all()
    write_text(study / "g.toml", '[[models]]\nmodel = "named"\nparameters.family = [1, 2]\n')
    assert cli.run(["sweep", "s", "--grid", "s/g.toml", "--workers", "1"]) == 0
    judgments = study_judgments(study, scenes)
    assert sorted(judgments.rows["model_family"]) == [1, 2]
    assert set(judgments.rows["family"]) == {"named"}
    assert len(judgments_of([], scenes).rows) == 0


def test_liquids_that_flow_alike_are_one_computation_and_two_rows(study):
    write_text(study / "study.toml", '[liquids.red]\nviscosity_alpha = 0.01\ncolour = "#ff0000"\n')
    specs = [f"ife:liquid={name},n_particles=15,zeta_sigma=0" for name in ("water", "red")]
    scenes = scenes_of("exp1", 2)
    found = judge_in_study(study, scenes, [("water", spec) for spec in specs], "asked")
    assert (found["water", specs[0]] == found["water", specs[1]]).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"goal": "nogoal"}, "goal: there is no 'nogoal'"),
        ({"models": ("nomodel",)}, "there is no 'nomodel'"),
        ({"groups": ("water",)}, "groups: expected tuples of liquids"),
        ({"groups": (("water", "water"),)}, "a liquid is twice in a group"),
        ({"groups": (("water",),), "mirrored": ("honey",)}, "mirrored: no group sees 'honey'"),
        ({"groups": (("lava",),)}, "there is no 'lava'"),
        ({"scene_count": 2.5}, "scene_count: expected a whole number, at least 1, found 2.5"),
        ({"participants": 0}, "participants: expected a whole number, at least 1, found 0"),
    ],
)
def test_an_experiment_checks_itself(change, said):
    with pytest.raises(InputError, match=said):
        replace(EXPERIMENTS.get("exp1"), **change)
