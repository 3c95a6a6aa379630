"""The experiment as files: whole, the same bytes again, and nothing in them that tells too much."""

import json
import zipfile

import pytest

from pourcast import cli
from tests.experiment.make import EXP1, small_study


def call(*arguments):
    return cli.run(["experiment", "export", *map(str, arguments)])


def test_a_static_folder_is_whole_and_tells_no_outcome(tmp_path, capsys):
    study = small_study(tmp_path / "s")
    out = tmp_path / "web"
    assert call(study, "--static", out, "--datapipe", "ABC123") == 0
    plan = json.loads((out / "plan.json").read_text())
    assert plan["datapipe"] == "ABC123"
    steps = plan["places"][0]["steps"]
    named = {step[what] for step in steps for what in ("still", "film") if what in step}
    assert named == {path.name for path in (out / "media").iterdir()}
    assert len([name for name in named if name.endswith(".mp4")]) == 1
    page = (out / "index.html").read_text()
    assert 'content="static"' in page
    for word in ("outcome", "scene-1", '"scene"', "mirrored"):
        assert word not in (out / "plan.json").read_text() + page
    assert call(study, "--static", out) == 2
    assert "not an empty folder" in capsys.readouterr().err


def test_a_jatos_archive_is_as_jatos_reads_it(tmp_path):
    study = small_study(tmp_path / "s", design=EXP1 + 'order = "own"\n')
    assert call(study, "--jatos", tmp_path / "a.jzip") == 0
    with zipfile.ZipFile(tmp_path / "a.jzip") as jzip:
        names = jzip.namelist()
        (jas,) = [name for name in names if name.endswith(".jas")]
        described = json.loads(jzip.read(jas))
        folder = described["data"]["dirName"]
        plan = json.loads(jzip.read(f"{folder}/plan.json"))
        page = jzip.read(f"{folder}/index.html").decode()
    assert described["version"] == "3"
    (component,) = described["data"]["componentList"]
    assert f"{folder}/{component['htmlFilePath']}" in names
    assert all(name == jas or name.startswith(f"{folder}/") for name in names)
    assert page.index('src="jatos.js"') < page.index("assets/app-")
    assert len(plan["places"]) == 24


CODES = (
    EXP1
    + '[recruiting]\ncomplete = "C1"\nscreened_out = "S1"\nredirect = "https://a.example/{code}"\n'
)
IDS = "PROLIFIC_PID={{%PROLIFIC_PID%}}&STUDY_ID={{%STUDY_ID%}}&SESSION_ID={{%SESSION_ID%}}"


def test_what_to_set_on_the_services_side_is_said(tmp_path, capsys):
    study = small_study(tmp_path / "s", design=CODES)
    assert call(study, "--static", tmp_path / "web", "--datapipe", "ABC123") == 0
    said = capsys.readouterr().out
    assert 'https://pipe.jspsych.org/admin/ABC123 > "Enable data collection": on' in said
    assert "required field trial_type" in said
    assert f"study link https://YOUR-HOST/index.html?{IDS}" in said
    assert "completion path with the code C1, for who completes" in said
    assert "completion path with the code S1, for whose screen is too small" in said
    assert "no code for who fails the questions" in said
    assert "no way back" not in said
    assert call(study, "--static", tmp_path / "without") == 0
    assert "DataPipe" not in capsys.readouterr().out
    assert call(small_study(tmp_path / "bare"), "--jatos", tmp_path / "a.jzip") == 0
    said = capsys.readouterr().out
    assert f"study link STUDY-LINK?{IDS}" in said
    assert "no way back" in said
    assert '"End Redirect URL" is not used' in said


def test_the_same_study_makes_the_same_archive(tmp_path):
    study = small_study(tmp_path / "s")
    call(study, "--jatos", tmp_path / "a.jzip")
    call(study, "--jatos", tmp_path / "b.jzip")
    assert (tmp_path / "a.jzip").read_bytes() == (tmp_path / "b.jzip").read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "either --jatos FILE.jzip or --static DIR"),
        (["--jatos", "a.zip"], "expected a name that ends in .jzip"),
        (["--jatos", "a.jzip", "--datapipe", "X"], "--datapipe goes with --static"),
    ],
)
def test_a_wrong_call_is_told_of(tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    assert call(small_study(tmp_path / "s"), *options) == 2
    assert message in capsys.readouterr().err
