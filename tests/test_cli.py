"""The command line: what it does, what it says, and what it leaves behind."""

import json
import os
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pourcast import cli
from pourcast.scenes.scene_file import read_scenes, write_scenes
from pourcast.simulation.memory import REMEMBERED
from tests.make import ramp_scene, random_scenes
from tests.test_docs import COMMANDS

EXAMPLES = Path(__file__).parents[1] / "examples"
QUICK = "ife:n_particles=20,zeta_sigma=0"


def scene_file(folder, count=3):
    path = folder / "scenes.json"
    scenes = random_scenes(count, seed=21)
    write_scenes(path, [s.model_copy(update={"id": f"s{k}"}) for k, s in enumerate(scenes, 1)])
    return path


def call(*arguments):
    return cli.run([str(argument) for argument in arguments])


def listing(folder):
    return sorted(path.name for path in folder.iterdir())


# What it does ------------------------------------------------------------------------


def test_scenes_twice_are_the_same_bytes(tmp_path, capsys):
    for experiment, extra in (("exp1", []), ("exp2-v0", ["--candidates", "24"])):
        one, two = tmp_path / f"{experiment}a.json", tmp_path / f"{experiment}b.json"
        for path in (one, two):
            assert call("scenes", experiment, "-n", 4, "--seed", 1, "-o", path, *extra) == 0
        assert one.read_bytes() == two.read_bytes()
        assert len(read_scenes(one)) == 4
    printed = capsys.readouterr().out
    assert "at most 5% of it ends on an obstacle" in " ".join(printed.split())
    assert (
        "correlation of water-ife:liquid=water-v0 and honey-ife-1:liquid=honey-exp2-v0" in printed
    )


def test_predict_writes_a_row_per_scene_and_model(tmp_path, capsys):
    path = scene_file(tmp_path, 5)
    out = tmp_path / "j.csv"
    assert call("predict", path, "-m", QUICK, "-m", "gravity", "-m", "water-simple", "-o", out) == 0
    table = pd.read_csv(out)
    assert len(table) == 15
    assert table["judgment"].between(0, 1).all()
    assert list(table.columns) == [
        "scene",
        "digest",
        "liquid",
        "model",
        "parameters",
        "seed",
        "judgment",
    ]
    assert json.loads(table["parameters"][0])["n_particles"] == 20
    printed = capsys.readouterr().out
    assert "r with" in printed
    assert "15 judgments" in printed
    parquet = tmp_path / "j.parquet"
    assert call("predict", path, "-m", "gravity", "-o", parquet) == 0
    assert len(pd.read_parquet(parquet)) == 5


def test_predict_prints_json(tmp_path, capsys):
    assert call("predict", scene_file(tmp_path, 2), "-m", "gravity", "--json") == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row["scene"] for row in rows] == ["s1", "s2"]


def test_practice_scenes_are_others_and_leave_the_scenes_as_they_are(tmp_path):
    with_practice, without = tmp_path / "a", tmp_path / "b"
    assert call("new", "exp1", with_practice, "-n", 3, "--practice", 2) == 0
    assert call("new", "exp1", without, "-n", 3, "--practice", 0) == 0
    scenes = (with_practice / "scenes.json").read_bytes()
    assert scenes == (without / "scenes.json").read_bytes()
    assert not (without / "practice.json").exists()
    practice = read_scenes(with_practice / "practice.json")
    assert [scene.id for scene in practice] == ["practice-exp1-001", "practice-exp1-002"]
    judged = {scene.digest for scene in read_scenes(with_practice / "scenes.json")}
    assert judged.isdisjoint(scene.digest for scene in practice)


def test_a_study_folder_stands_for_its_scenes(tmp_path, capsys):
    study = tmp_path / "study"
    assert call("new", "exp1", study, "-n", 2, "--seed", 3) == 0
    assert listing(study) == ["chosen.json", "practice.json", "scenes.json", "study.toml"]
    assert call("predict", study, "-m", "gravity") == 0
    assert call("new", "exp1", study, "-n", 2) == 2
    assert "not an empty folder" in capsys.readouterr().err
    assert listing(study) == ["chosen.json", "practice.json", "scenes.json", "study.toml"]


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_show_a_picture(tmp_path, suffix):
    path = scene_file(tmp_path)
    out = tmp_path / f"p.{suffix}"
    models = ["-m", QUICK, "-m", "water-simple", "-m", "marble:n_particles=15,zeta_sigma=0"]
    assert call("show", path, "--scene", "2", *models, "-o", out) == 0
    once = out.read_bytes()
    REMEMBERED.forget_all()
    assert call("show", path, "--scene", "s2", *models, "-o", out) == 0
    assert out.read_bytes() == once
    if suffix == "png":
        pixels = np.asarray(Image.open(out).convert("RGB")).reshape(-1, 3)
        assert len(np.unique(pixels, axis=0)) > 50
    assert call("show", path, "-o", out) == 0


def test_show_all_scenes_on_a_page(tmp_path, capsys):
    path = scene_file(tmp_path, 3)
    out = tmp_path / "all.png"
    models = ["-m", QUICK, "-m", "water-simple", "-m", "marble:n_particles=15,zeta_sigma=0"]
    assert call("show", path, "--scene", "all", *models, "-o", out) == 0
    assert "all.png: 3 scenes" in capsys.readouterr().out
    once = out.read_bytes()
    REMEMBERED.forget_all()
    assert call("show", path, "--scene", "all", *models, "-o", out) == 0
    assert out.read_bytes() == once
    one = tmp_path / "one.svg"
    assert call("show", path, "--scene", "all", "-m", QUICK, "-o", one) == 0
    assert one.read_text(encoding="utf-8").count("<image") == 3  # a panel's liquid each


def test_show_films(tmp_path):
    path = scene_file(tmp_path)
    out = tmp_path / "p.mp4"
    assert call("show", path, "-m", QUICK, "-m", "water-simple", "-o", out) == 0
    with av.open(str(out)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert stream.average_rate == 30
    assert len(frames) > 30
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 60
    gif = tmp_path / "p.gif"
    assert call("show", path, "-m", "marble:n_particles=15,zeta_sigma=0", "-o", gif) == 0
    with Image.open(gif) as image:
        assert image.n_frames > 15
        assert image.info["duration"] == 60 or image.info["duration"] == 66


@pytest.mark.parametrize("name", ["drawing.svg", "plinko.json", "splishsplash.json"])
def test_import_then_predict(tmp_path, name):
    out = tmp_path / "mine.json"
    assert call("import", EXAMPLES / name, "-o", out) == 0
    assert call("predict", out, "-m", QUICK, "-m", "gravity") == 0


def test_import_several_and_export(tmp_path):
    out = tmp_path / "all.json"
    files = [EXAMPLES / "drawing.svg", EXAMPLES / "drawing.svg", EXAMPLES / "plinko.json"]
    assert call("import", *files, "-o", out) == 0
    assert [s.id for s in read_scenes(out)] == ["drawing-1", "drawing-2", "plinko-3"]
    exported = tmp_path / "splish" / "scene.json"
    assert call("export", out, "--scene", "1", "-o", exported) == 0
    assert call("import", exported, "-o", tmp_path / "back.json") == 0


def test_the_scene_of_the_documentation(capsys):
    assert call("predict", EXAMPLES / "ramp.json", "-m", "gravity") == 0
    assert "ramp" in capsys.readouterr().out


def test_demo(tmp_path, capsys, poured):
    assert call("demo", "-o", tmp_path / "demo") == 0
    assert listing(tmp_path / "demo") == ["basins.gif", "basins.png", "cup.png"]
    assert len(poured) == 1, "pictures and film show what was poured for the judgments"
    printed = capsys.readouterr().out
    for name in ("water-ife", "truth-honey", "gravity", "position-uncertainty", "basins.gif"):
        assert name in printed


def test_models_are_listed(capsys):
    assert call("models") == 0
    assert "damping_zeta" in capsys.readouterr().out
    assert call("models", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["presets"]) == 14


def test_units_in_a_tables_head_are_no_markup(capsys):
    assert call("list") == 0
    assert "[m2/s]" in capsys.readouterr().out


def test_every_command_has_help_with_an_example(capsys):
    assert call() == 0
    overview = capsys.readouterr().out
    for command in COMMANDS:
        assert command.split()[0] in overview
        assert call(*command.split(), "--help") == 0
        assert f"Example: pourcast {command}" in capsys.readouterr().out.replace("\n ", "")


# Bad input ---------------------------------------------------------------------------


def bad_calls(folder):
    good = scene_file(folder)
    (folder / "broken.json").write_text('{"schema_version": 1, ')
    (folder / "old.json").write_text('{"schema_version": 0, "scenes": []}')
    (folder / "empty.json").write_text('{"schema_version": 1, "scenes": []}')
    (folder / "nan.json").write_text(good.read_text().replace("0.148", "NaN", 1))
    (folder / "file").write_text("x")
    return {
        "missing file": (["predict", folder / "no.json"], r"no.json: cannot be read"),
        "folder without scenes": (["predict", folder], None),
        "broken JSON": (["predict", folder / "broken.json"], "broken.json: not a JSON file"),
        "old schema": (["predict", folder / "old.json"], "old.json: schema_version: expected 1, found 0"),
        "empty list": (["predict", folder / "empty.json"], "empty.json: scenes: the list is empty"),
        "not finite": (["predict", folder / "nan.json"], "finite number"),
        "no such model": (["predict", good, "-m", "watr-ife"], "did you mean 'water-ife'"),
        "no such scene": (["show", good, "--scene", "9", "-o", folder / "p.png"], "a number from 1 to 3"),
        "unwritable": (["predict", good, "-o", folder / "file" / "j.csv"], "j.csv: cannot be written"),
        "unwritable scenes": (["scenes", "exp1", "-o", folder / "file" / "s.json"], "cannot be written"),
        "unknown table": (["predict", good, "-o", folder / "j.xls"], r"j.xls: expected a name that ends"),
        "unknown picture": (["show", good, "-o", folder / "p.bmp"], "p.bmp: expected a name that ends"),
        "film of nothing": (["show", good, "-o", folder / "p.mp4"], "needs at least one --model"),
        "film of all": (
            ["show", good, "--scene", "all", "-m", QUICK, "-o", folder / "p.mp4"],
            "p.mp4: all scenes make a picture",
        ),
        "page of nothing": (
            ["show", good, "--scene", "all", "-o", folder / "p.png"], "needs at least one --model"
        ),
        "bad film model": (["show", good, "-m", "x", "-o", folder / "p.mp4"], "there is no 'x'"),
        "bad option": (["predict", good, "--colour"], "No such option"),
        "bad command": (["flow"], "No such command 'flow'"),
        "bad count": (["scenes", "exp1", "-n", "0", "-o", folder / "s.json"], "greater than or equal to 1"),
        "few candidates": (
            ["scenes", "exp2", "-n", "5", "--candidates", "4", "-o", folder / "s.json"], "at least 5",
        ),
        "import nothing": (["import", folder / "no.svg", "-o", folder / "m.json"], "no.svg: cannot be read"),
        "import text": (["import", folder / "file", "-o", folder / "m.json"], "expected an SVG or a JSON"),
    }  # fmt: skip


@pytest.mark.parametrize("name", [
    "missing file", "folder without scenes", "broken JSON", "old schema", "empty list", "not finite",
    "no such model", "no such scene", "unwritable", "unwritable scenes", "unknown table",
    "unknown picture", "film of nothing", "film of all", "page of nothing", "bad film model", "bad option", "bad command", "bad count",
    "few candidates", "import nothing", "import text",
])  # fmt: skip
def test_bad_input_is_one_line_exit_2_and_leaves_nothing(tmp_path, capsys, name):
    calls = bad_calls(tmp_path)
    arguments, message = calls[name]
    if name == "folder without scenes":
        (tmp_path / "scenes.json").unlink()
        message = "scenes.json: cannot be read"
    before = listing(tmp_path)
    assert call(*arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert message in printed.err
    assert "Traceback" not in printed.err
    assert listing(tmp_path) == before


def test_every_bad_call_is_tested(tmp_path):
    marks = test_bad_input_is_one_line_exit_2_and_leaves_nothing.pytestmark
    assert set(marks[0].args[1]) == set(bad_calls(tmp_path))


def test_a_failure_of_ours_is_exit_1_without_a_traceback(tmp_path, capsys, monkeypatch):
    def fail(path):
        raise RuntimeError("a bug")

    monkeypatch.setattr("pourcast.study.folder.load_scenes", fail)
    assert call("predict", scene_file(tmp_path)) == 1
    assert capsys.readouterr().err.startswith("pourcast: RuntimeError: a bug")


def test_an_existing_table_survives_a_failed_run(tmp_path, monkeypatch):
    path, out = scene_file(tmp_path), tmp_path / "j.csv"
    out.write_text("precious")
    monkeypatch.setattr("pourcast.tables.pd.DataFrame.to_csv", _disk_full)
    assert call("predict", path, "-m", "gravity", "-o", out) == 1
    assert out.read_text() == "precious"
    assert listing(tmp_path) == ["j.csv", "scenes.json"]


def _disk_full(*args, **kwargs):
    raise OSError(28, "No space left on device")


# Starting up -------------------------------------------------------------------------


def test_every_public_name_can_be_had():
    import pourcast

    for name in pourcast.__all__:
        assert getattr(pourcast, name) is not None
    assert set(pourcast.__all__) == set(pourcast._MODULE_OF)
    with pytest.raises(AttributeError, match="no attribute 'flow'"):
        pourcast.flow  # noqa: B018


def test_a_read_only_home_is_no_obstacle(tmp_path):
    home = tmp_path / "home"
    home.mkdir(mode=0o500)
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": str(home / "file")}
    (tmp_path / "blocked").write_text("")
    environment["XDG_CACHE_HOME"] = str(tmp_path / "blocked")
    command = [
        sys.executable,
        "-m",
        "pourcast",
        "predict",
        str(EXAMPLES / "ramp.json"),
        "-m",
        "gravity",
    ]
    run = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert run.returncode == 0, run.stderr


def test_ramp_example_is_the_scene_of_the_tests():
    assert read_scenes(EXAMPLES / "ramp.json")[0].digest == ramp_scene().digest
