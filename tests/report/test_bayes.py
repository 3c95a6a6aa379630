"""The likelihood of single answers, from a table of responses to what is printed and written."""

import json

import pytest

from pourcast import cli
from pourcast.comparison.compare import TABLES, compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.observers.observers import Observers
from pourcast.observers.responses import rehearse
from pourcast.report import contents
from pourcast.report.methods import methods
from pourcast.scenes.scene_file import write_scenes
from pourcast.statistics.sampling import Sampling
from tests.comparison.make import voronoi_scenes


@pytest.mark.slow
def test_compare_prints_and_writes_what_single_answers_say(tmp_path, monkeypatch, capsys):
    study = tmp_path / "study"
    scenes = voronoi_scenes(7)
    write_scenes(study / "scenes.json", scenes)
    heads = {"water": "water-simple", "honey": "gravity"}
    rehearse(study, scenes, Observers(4, heads, (("water", "honey"),), spreads={}))
    shorter = Sampling(warmup=100, draws=40, chains=2)
    monkeypatch.setattr("pourcast.comparison.compare.Sampling", lambda seed: shorter)
    models = ["-m", "water-simple", "-m", "honey-simple", "-m", "gravity"]
    assert cli.run(["compare", str(study), *models, "--bayes", "-o", str(tmp_path / "t")]) == 0
    told = capsys.readouterr().out
    assert TABLES["loo"] in told
    for note in (
        "water: trust the posterior by gravity less: ",
        "water: no leaving out of participants (4): it needs at least 5",
        "honey-exp1: no leaving out of participants (4): it needs at least 5",
        "water and honey: no effect of the liquid: 4 participants judged scenes with both, and it "
        "needs at least 5",
    ):
        assert note in told
    assert {path.stem for path in (tmp_path / "t").iterdir()} >= {
        "loo", "loo_differences", "posterior", "predictive_checks", "predictive_tenths",
    }  # fmt: skip
    assert cli.run(["compare", str(study), *models, "--bayes", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)["tables"]
    assert {row["unit"] for row in tables["loo"]} == {"scenes"}
    assert {"largest_k", "refitted", "divergences", "p_loo", "weight"} <= set(tables["loo"][0])
    assert {"r_hat", "ess_bulk", "ess_tail", "divergences"} <= set(tables["posterior"][0])
    assert {"prior_sensitivity", "diagnosis"} <= set(tables["posterior"][0])
    assert {"same", "new"} == {row["replicated"] for row in tables["predictive_checks"]}
    assert "note: water: priors count in the posteriors of " in told
    found = compare_study(study, ComparisonOptions(models=("gravity",), bayes=True))
    said = methods(found)
    assert "1,000 data sets of the same participants and scenes" in said
    assert any(one.name == "predictive_checks_honey" for one in contents.figures(found))
    assert "4 chains of 500 + 500 draws" in said
    assert "scenes were left out one at a time" in said
    assert "participants were left out" not in said
    assert "sensitivity to the liquid" not in said
