"""A point is measured through the sweep's store: resumed, and the same as by the models."""

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


def test_a_wrong_point_is_told_in_one_line(tmp_path, capsys):
    path = tmp_path / "point.toml"
    path.write_text("[engine]\nspeed = 1")
    assert calibrate.main(["--check", str(path), "--store", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "speed" in said


@pytest.mark.parametrize(
    "words",
    ["--waves 0", "--points 1", "--later-points -3", "--scenes 0", "--seed -1", "--workers 0"],
)
def test_a_number_that_is_too_small_is_told_in_a_line(words, tmp_path, capsys):
    with pytest.raises(SystemExit) as left:
        calibrate.main([*words.split(), "--store", str(tmp_path / "store")])
    assert left.value.code == 2
    assert f"{words.split()[0]}: expected at least" in capsys.readouterr().err
    assert not (tmp_path / "store").exists()
