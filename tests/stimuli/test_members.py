"""What every solver and renderer keeps to; one of another package is as good as ours."""

from dataclasses import fields

import numpy as np
import pytest

from pourcast import cli
from pourcast.errors import InputError
from pourcast.registry import Registry
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import HONEY_EXP1, HONEY_EXP2, WATER, known_liquids
from pourcast.scenes.scene_file import write_scenes
from pourcast.stimuli.manifest import Manifest, best_set, read_set, set_folder
from pourcast.stimuli.recording import Moment, RecordedPour
from pourcast.stimuli.renderers.preview import Preview
from pourcast.stimuli.renderers.registry import RENDERERS
from pourcast.stimuli.settings import StimulusSettings, stimulus_settings
from pourcast.stimuli.solvers.base import Solver
from pourcast.stimuli.solvers.registry import SOLVERS
from pourcast.stimuli.solvers.sph import true_pour

SYRUP = Liquid("syrup", viscosity_alpha=1.0, adhesion_tangential=20.0)
OIL = Liquid("oil", viscosity_alpha=0.3)


@pytest.mark.parametrize("name", SOLVERS.names())
def test_every_solver_pours_any_liquid(ramp, name):
    solver = SOLVERS.get(name)()
    for liquid in (*known_liquids(), SYRUP):
        identity = solver.liquid_identity(liquid)
        assert identity
        assert set(identity) <= {field.name for field in fields(Liquid)}
        assert identity == {key: getattr(liquid, key) for key in identity}
    pour = solver.pour(ramp, SYRUP, 0.1)
    assert len(pour.moments) == 3
    assert pour.volume == pytest.approx(np.pi / 4 * 0.148**3, rel=0.02)
    assert 0.0 <= pour.outcome <= 1.0


@pytest.mark.parametrize("solver", SOLVERS.names())
@pytest.mark.parametrize("renderer", RENDERERS.names())
def test_a_manifest_comes_back_from_its_file_as_it_was(solver, renderer):
    resolution = 33 if solver == "lbm" else None
    options = {"resolution": resolution}
    settings = stimulus_settings(solver, renderer, size=(80, 120), options=options)
    manifest = Manifest(settings=settings).with_liquids([*known_liquids(), SYRUP])
    assert Manifest.model_validate_json(manifest.model_dump_json(by_alias=True)) == manifest
    content = manifest.content()
    assert content["recipe"]["flow"]["solver"] == solver
    assert content["recipe"]["look"]["renderer"] == renderer
    assert set(content["liquids"]) == {one.name for one in known_liquids()} | {"syrup"}


def test_the_true_pour_of_any_liquid_is_undamped_with_the_papers_number_of_particles(ramp):
    counts = {
        liquid.name: true_pour(ramp, liquid).n_particles
        for liquid in (WATER, HONEY_EXP1, HONEY_EXP2, SYRUP, OIL)
    }
    assert counts == {
        "water": 200, "honey-exp1": 100, "honey-exp2": 100, "syrup": 100, "oil": 200,
    }  # fmt: skip
    assert true_pour(ramp, SYRUP).liquid == SYRUP
    assert true_pour(ramp, SYRUP).damping_zeta == 0.0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"flow": {"solver": "lbn"}, "look": {"renderer": "preview"}}, "did you mean 'lbm'"),
        ({"flow": {}, "look": {"renderer": "preview"}}, "expected an object with the field 'sol"),
        (
            {"flow": {"solver": "sph"}, "look": {"renderer": "preview", "width": 1}},
            "width: Input should",
        ),
        ({"flow": {"solver": "sph", "width": 80}, "look": {"renderer": "preview"}}, "Extra inp"),
    ],
)
def test_settings_that_are_wrong_are_told(content, said):
    with pytest.raises(ValueError, match=said):
        StimulusSettings.model_validate(content)


# Of another package ---------------------------------------------------------------------


class Frozen(Solver):
    """A liquid that stays where it is."""

    name = "frozen"
    fidelity = 2
    hardness: float = 1.0

    def pour(self, scene, liquid, seconds, *, threads=1, report=None):
        x, y = scene.liquid.centre
        depth = scene.box.depth
        volume = np.pi / 4 * scene.liquid.diameter**2 * depth
        moment = Moment(
            np.zeros((0, 0, 0), np.uint8), np.array([[x, y, depth / 2, volume]], np.float32)
        )
        count = round(seconds * 30)
        return RecordedPour(
            (moment,) * count, 0.1, (0, 0, 0), np.zeros((0, 0, 0), np.float32), 0.25, 1.0
        )

    def liquid_identity(self, liquid):
        return {}


class Entry:
    def __init__(self, member):
        self.name, self.member = getattr(member, "name", "frozen"), member

    def load(self):
        return self.member


def installed(monkeypatch, member):
    entry = Entry(member)
    monkeypatch.setattr(
        Registry, "third_party", lambda self: {"frozen": entry} if self is SOLVERS else {}
    )


def test_a_solver_of_another_package_makes_stimuli_by_its_name(ramp, tmp_path, monkeypatch, capsys):
    installed(monkeypatch, Frozen)
    write_scenes(tmp_path / "scenes.json", [ramp])
    call = ["stimuli", str(tmp_path), "--seconds", "0.1", "--size", "80", "--liquid", "water"]
    assert cli.run([*call, "--solver", "frozen"]) == 0
    assert "frozen-preview: 1 stimuli" in capsys.readouterr().out
    made = read_set(set_folder(tmp_path, "frozen-preview"))
    assert made.manifest.settings == StimulusSettings(
        solver=Frozen(), renderer=Preview(width=80), seconds=0.1
    )
    assert made.find(ramp, WATER).outcome == 0.25
    assert cli.run([*call, "--solver", "sph"]) == 0
    assert best_set(tmp_path, []) == made


def test_what_is_no_solver_is_told(monkeypatch):
    for member, said in [
        (Preview, "expected a subclass of Solver"),
        (type("Other", (Frozen,), {"name": "other"}), "its name should be 'frozen', not 'other'"),
    ]:
        installed(monkeypatch, member)
        with pytest.raises(InputError, match=said):
            SOLVERS.get("frozen")
