"""Cycles, for real: Blender renders a still and a film; what is liquid, what is solid is told.

Slow, and needs Blender: POURCAST_BLENDER names it, or a Python that has `bpy` (as `.ci/run` does).
"""

import json
import os
import shlex
import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from pourcast import cli
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene_file import write_scenes
from pourcast.stimuli.contact_sheet import last_picture
from pourcast.stimuli.manifest import read_set, set_folder
from pourcast.stimuli.renderers import cycles
from tests.make import ramp_scene
from tests.test_docs import CYCLES_LINE

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(cycles.VARIABLE not in os.environ, reason=f"{cycles.VARIABLE} is not set"),
]

OPTIONS = [
    "--renderer", "cycles", "--samples", "4", "--size", "120x180", "--resolution", "40",
    "--scenes", "1", "--seconds", "0.2",
]  # fmt: skip


@pytest.fixture
def study(tmp_path):
    write_scenes(tmp_path / "scenes.json", [ramp_scene()])
    return tmp_path


def test_both_liquids_are_rendered_and_told_apart(study):
    assert cli.run(["stimuli", str(study), *OPTIONS]) == 0
    made = read_set(set_folder(study, "lbm-cycles"))
    images = {}
    for liquid in (WATER, HONEY_EXP1):
        stimulus = made.find(ramp_scene(), liquid)
        assert made.is_whole(stimulus)
        with Image.open(made.folder / stimulus.still) as still:
            images[liquid.name] = np.asarray(still, float)
        assert np.asarray(last_picture(made.folder / stimulus.film)).shape == (180, 120, 3)
    water, honey = images["water"], images["honey-exp1"]
    assert water.shape == (180, 120, 3)
    # They differ where the liquid starts, and nowhere far from it.
    differ = np.abs(water - honey).max(axis=2) > 60
    rows, columns = np.nonzero(differ)
    assert columns.mean() / 120 == pytest.approx(0.4, abs=0.06)
    assert 1.5 * (1.0 - rows.mean() / 180) == pytest.approx(1.3, abs=0.08)
    assert not differ[90:].any()
    # Water is bluish, honey amber, the ramp dark, the wall bright.
    place = np.s_[rows.min() + 4 : rows.max() - 4, columns.min() + 4 : columns.max() - 4]
    assert water[place][..., 2].mean() > water[place][..., 0].mean() + 15
    assert honey[place][..., 0].mean() > honey[place][..., 2].mean() + 60
    assert water[88:92, 40:50].mean() < 140
    assert water[60:80, 90:110].mean() > 200


def test_the_extra_alone_is_enough(study):
    # As somebody has it who followed the documentation: pourcast and bpy in one environment.
    python = shutil.which(os.environ[cycles.VARIABLE])
    have = subprocess.run([python, "-c", "import pourcast, bpy"], check=False, capture_output=True)
    if have.returncode != 0:
        pytest.skip("that Blender's Python has no pourcast")
    environment = {name: v for name, v in os.environ.items() if name != cycles.VARIABLE}
    call = [
        python,
        "-m",
        "pourcast",
        "stimuli",
        str(study),
        *OPTIONS,
        "--liquid",
        "water",
        "--json",
    ]
    run = subprocess.run(call, check=False, capture_output=True, text=True, env=environment)
    assert run.returncode == 0, run.stderr
    (stimulus,) = json.loads(run.stdout)["stimuli"]
    assert (study / "stimuli" / "lbm-cycles" / stimulus["film"]).is_file()


def test_the_line_of_the_how_to_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "looks").mkdir()
    write_scenes(tmp_path / "looks" / "scenes.json", [ramp_scene()])
    assert cli.run(shlex.split(CYCLES_LINE)[1:]) == 0
    made = read_set(set_folder(tmp_path / "looks", "lbm-cycles"))
    assert last_picture(made.folder / made.manifest.stimuli[0].film).size == (320, 480)
