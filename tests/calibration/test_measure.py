"""A point is measured through the sweep's store: resumed, and the same as by the models."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks import calibrate
from benchmarks.calibration import measure as measuring
from benchmarks.calibration import space
from benchmarks.calibration.chaos import mean_changes
from benchmarks.calibration.check import Checked, check_table
from benchmarks.calibration.measure import SECOND_ZETA, dampings_of, measure
from benchmarks.calibration.targets import MODELS

from pourcast.errors import InputError
from pourcast.models.ife import IntuitiveFluidsEngine
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.study.experiments.exp1 import EXPERIMENT
from pourcast.study.selection import Selection, drawn_scene
from pourcast.sweep.store import Store

POINT = {"family.liquid_spread": 0.0, "engine.sound_speed": 25.0, "honey.adhesion_normal": 30.0}


def test_windows_are_the_presets():
    assert dampings_of("water-ife", 1) == [float(k) for k in range(1, 10)]
    assert dampings_of("honey-ife-2", SECOND_ZETA) == [7.0, 9.0, 11.0, 13.0, 15.0]
    assert dampings_of("truth-honey", SECOND_ZETA) == [0.0]
    assert dampings_of("water-marble", SECOND_ZETA) == [0.0, 2.0, 4.0, 6.0]
    assert dampings_of("gravity", 1) == []


@pytest.mark.slow
def test_a_point_is_measured_resumed_and_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(measuring, "SHARD_SECONDS", 0.5)
    whole = measure(POINT, 3, 7, tmp_path / "whole", SECOND_ZETA)
    assert not whole.failure
    assert whole.scenes == 3
    write, left = Store.write, [3]

    def writes_three(self, shard, table):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        write(self, shard, table)

    monkeypatch.setattr(Store, "write", writes_three)
    with pytest.raises(KeyboardInterrupt):
        measure(POINT, 3, 7, tmp_path / "cut", SECOND_ZETA)
    kept = {
        path: path.stat().st_mtime_ns for path in Store(tmp_path / "cut/sweep").paths().values()
    }
    assert len(kept) == 3
    monkeypatch.setattr(Store, "write", write)
    assert measure(POINT, 3, 7, tmp_path / "cut", SECOND_ZETA) == whole
    assert all(path.stat().st_mtime_ns == time for path, time in kept.items())

    here, scenes = space.world(POINT), read_scenes(tmp_path / "whole/scenes.json")
    pours = [
        replace(pour, damping_zeta=zeta)
        for scene in scenes
        for pour in IntuitiveFluidsEngine(zeta_sigma=0).pours(scene, here.water)
        for zeta in dampings_of("water-ife", SECOND_ZETA)
    ]
    ends = [end.judgment for end in simulate(pours, settings=here.engine)]
    assert np.allclose(np.reshape(ends, (3, -1)).mean(axis=1), whole.judgments["water-ife"])
    assert set(whole.judgments) == set(MODELS)
    changes = mean_changes(POINT, tmp_path / "whole")
    assert changes["truth-water"] == pytest.approx(change_by_hand(here, scenes))
    assert mean_changes(POINT, tmp_path / "whole") == changes
    said = check_table({"it": [Checked(whole, changes)]})
    assert "r(gravity, truth-honey)" in said
    assert f"start moved by 0.1 mm, truth-water |  | {changes['truth-water']:.3f}" in said

    monkeypatch.setattr(measuring, "_measure", None)  # What is done is read.
    assert measure(POINT, 3, 7, tmp_path / "whole", SECOND_ZETA) == whole
    with pytest.raises(InputError, match="take another --store"):
        measure(POINT, 3, 8, tmp_path / "whole", SECOND_ZETA)


def change_by_hand(here, scenes):
    """Of the water truth's 200 particles, when the start is 0.1 mm further to the right."""

    def judged(shift):
        moved = [one.model_dump() for one in scenes]
        for one in moved:
            x, y = one["liquid"]["centre"]
            one["liquid"]["centre"] = (x + shift, y)
        pours = [Pour(Scene.model_validate(one), here.water, 200) for one in moved]
        return np.array([end.judgment for end in simulate(pours, settings=here.engine)])

    return np.abs(judged(1e-4) - judged(0.0)).mean()


def test_a_point_that_breaks_says_so_and_hurts_no_other(tmp_path):
    broken = {"family.cell_count": 3}  # Cells are larger than what may be solid.
    found = measure(broken, 3, 7, tmp_path)
    assert "pass the filter" in found.failure
    assert measure(broken, 3, 7, tmp_path) == found


def test_the_key_holds_all_that_decides(monkeypatch):
    """Each part of the product that a point doesn't name, and each choice that it does."""
    kept = measuring.key_of(space.world({}), 10, 1, 1)
    assert kept == measuring.key_of(space.world({}), 10, 1, 1)
    assert json.loads(json.dumps(kept)) == kept
    changes = {
        "engine": {"engine.sound_speed": 25.0},
        "water": {"water.viscosity_alpha": 0.2},
        "honey": {"honey.tension": 0.1},
        "family": {"family.band_top": 1.2},
        "filter": {"filter.n_particles": 40},
    }
    for section, change in changes.items():
        standard = replace(space.product_sections()[section], **field_of(change))
        with monkeypatch.context() as patch:
            sections = space.product_sections() | {section: standard}
            patch.setattr(space, "product_sections", lambda sections=sections: sections)
            assert measuring.key_of(space.world({}), 10, 1, 1) != kept, section
    with monkeypatch.context() as patch:
        other = {name: dict(one) for name, one in measuring.presets().items()}
        other["gravity"]["parameters"] = {"n_particles": 7}
        patch.setattr(measuring, "presets", lambda: other)
        assert measuring.key_of(space.world({}), 10, 1, 1) != kept
    sources = measuring.sources_of_key()
    assert {"pourcast.models.simple", "pourcast.models.marble"} <= set(sources)


def field_of(change):
    return {name.partition(".")[2]: value for name, value in change.items()}


def test_other_scenes_and_those_of_an_older_key_are_drawn_again(tmp_path, monkeypatch):
    drawn = []

    def few(family, count, seed, *, rule):
        drawn.append(seed)
        scenes = [drawn_scene(EXPERIMENT.family, seed, k) for k in range(60)]
        return Selection([scene for scene in scenes if scene][:count], 60, count, ())

    monkeypatch.setattr(measuring, "filtered_scenes", few)
    here = space.world({})
    first, *_ = measuring._scenes(here, 3, 7, tmp_path)
    assert measuring._scenes(here, 3, 7, tmp_path)[0] == first
    assert drawn == [7]
    path = tmp_path / "scenes.json"
    was = path.read_bytes()
    path.write_bytes(was + b" ")
    assert measuring._scenes(here, 3, 7, tmp_path)[0] == first
    assert path.read_bytes() == was
    measuring._scenes(space.world({"family.band_top": 1.2}), 3, 7, tmp_path)
    assert drawn == [7, 7, 7]


@pytest.mark.parametrize("text", ["{", "[1]", "\xff", '{"key": {}}'])
def test_a_damaged_result_is_told_in_one_line(text, tmp_path):
    (tmp_path / "measured.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"measured\.json: ") as told:
        measure({}, 5, 1, tmp_path)
    assert "\n" not in str(told.value)


def test_a_wrong_point_is_told_in_one_line(tmp_path, capsys):
    path = tmp_path / "point.toml"
    path.write_text("[engine]\nspeed = 1")
    assert calibrate.main(["--check", str(path), "--store", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "speed" in said


@pytest.mark.parametrize(
    "words",
    [
        "--waves 0",
        "--points 9",
        "--scenes 4",
        "--points 1",
        "--later-points -3",
        "--scenes 0",
        "--seed -1",
        "--workers 0",
    ],
)
def test_a_number_that_is_too_small_is_told_in_a_line(words, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        calibrate.main([*words.split(), "--store", str(tmp_path / "store")])
    assert left.value.code == 2
    assert f"{words.split()[0]}: expected at least" in capsys.readouterr().err
    assert not (tmp_path / "store").exists()
