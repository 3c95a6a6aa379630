"""A study's own liquid, defined in its study.toml, in every command."""

import shlex

import numpy as np
import pandas as pd
import pytest

from pourcast import cli
from pourcast.errors import InputError
from pourcast.files import write_text
from pourcast.scenes.scene_file import write_scenes
from pourcast.study.folder import study_liquids, study_scenes
from pourcast.sweep.judgments import study_judgments
from tests.experiment.make import scenes_of

SYRUP = """
[liquids.syrup]
viscosity_alpha = 0.8
adhesion_normal = 30.0
adhesion_tangential = 30.0
kinematic_viscosity = 1e-4
colour = "#7a2f8f"
film_seconds = 1.0
"""

OWN = "ife:liquid=syrup,n_particles=15,zeta_sigma=0"


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_scenes(tmp_path / "s" / "scenes.json", scenes_of("exp1", 3))
    write_text(tmp_path / "s" / "study.toml", SYRUP)
    design = 'groups = [["water"], ["syrup"]]\npractice = 0\nfullscreen = false\n'
    write_text(tmp_path / "s" / "experiment.toml", design)
    return tmp_path / "s"


def run(line):
    assert cli.run(shlex.split(line)) == 0, line


def test_every_command_takes_it_by_its_name(study, capsys):
    run(f"predict s -m {OWN} -m ife:n_particles=15,zeta_sigma=0 --liquid syrup -o j.csv")
    judgments = pd.read_csv("j.csv")
    assert set(judgments["liquid"]) == {"syrup"}
    same, shown = (rows["judgment"].to_numpy() for _, rows in judgments.groupby("model"))
    assert (same == shown).all()  # the liquid that is shown is the one in the head
    run(f"show s -m {OWN} --liquid syrup -o pour.png")
    grid = '[[models]]\nmodel = "ife"\nliquids = ["water", "syrup"]\n'
    grid += "parameters.n_particles = 15\nparameters.zeta_sigma = 0\n"
    write_text(study / "g.toml", grid + 'parameters.liquid = ["trial", "syrup"]\n')
    run("sweep s --grid s/g.toml --workers 1")
    run("sweep s --status")
    run("stimuli s --preview --scenes 1 --seconds 0.1 --workers 1")
    run("experiment serve s --check")
    answers = scenes_with("syrup")
    answers.to_csv("r.csv", index=False)
    run(f"compare s --responses r.csv -m gravity -m {OWN}")
    assert "syrup" in capsys.readouterr().out
    run("experiment simulate s --observers 4 -m gravity")
    assert "4 simulated observers, 3 trials each" in capsys.readouterr().out
    simulated = pd.read_csv(study / "responses" / "simulated.csv")
    assert set(simulated["liquid"]) == {"water", "syrup"}  # as the design says
    run(f"report s --responses r.csv -m gravity -m {OWN} --films 0 --studies 0")
    assert "syrup trials" in (study / "report" / "report.html").read_text()
    assert "#7a2f8f" in (study / "report" / "figures" / "correlations.svg").read_text()


def scenes_with(liquid):
    """Made-up responses of four people."""
    rng = np.random.default_rng(0)
    rows = [
        {"participant": f"p{k}", "scene": scene.id, "liquid": liquid, "response": rng.random()}
        for k in range(4)
        for n, scene in enumerate(scenes_of("exp1", 3))
    ]
    return pd.DataFrame(rows)


def test_what_is_changed_in_it_is_judged_anew(study):
    run(f"sweep s --grid {grid_of(study)} --workers 1")
    table = study / "judgments" / "g.parquet"
    before = pd.read_parquet(table)["judgment"].to_numpy()
    write_text(study / "study.toml", SYRUP.replace("0.8", "2.5").replace("30.0", "90.0"))
    with pytest.raises(InputError, match=r"g\.parquet: liquid 'syrup' was another when this was"):
        study_judgments(study, study_scenes(study))
    run("sweep s --grid s/g.toml --workers 1")
    assert len(study_judgments(study, study_scenes(study)).rows) == 1
    after = pd.read_parquet(table)["judgment"].to_numpy()
    assert (before != after).any()
    write_text(study / "study.toml", SYRUP.replace("#7a2f8f", "#000000"))
    run("sweep s --grid s/g.toml --workers 1")
    assert (pd.read_parquet(table)["judgment"].to_numpy() == before).all()


def grid_of(study):
    text = '[[models]]\nmodel = "ife"\nliquids = ["syrup"]\nparameters.n_particles = 15\n'
    write_text(study / "g.toml", text + "parameters.zeta_sigma = 0\n")
    return "s/g.toml"


@pytest.mark.parametrize("value", ["true", '"0.1"'])
def test_only_numbers_are_taken_for_numbers(study, value):
    write_text(study / "study.toml", f"{SYRUP}cohesion = {value}\n")
    with pytest.raises(InputError, match=r"study\.toml: liquids\.syrup: cohesion: Input should be"):
        study_liquids(study)
    write_text(study / "study.toml", f"[generated]\ncount = {value}\nseed = 0\n")
    with pytest.raises(InputError, match=r"study\.toml: generated\.count: Input should be"):
        study_liquids(study)
    write_text(study / "study.toml", f"{SYRUP}cohesion = 0\n")  # a whole number is one
    assert study_liquids(study)[0].cohesion == 0


def test_a_liquid_that_is_not_there_is_told_with_those_that_are(study, capsys):
    assert cli.run(["predict", "s", "-m", "gravity", "--liquid", "sirup"]) == 2
    said = capsys.readouterr().err
    assert "liquid: there is no 'sirup'; did you mean 'syrup'? known: " in said
    assert len(said.splitlines()) == 1
