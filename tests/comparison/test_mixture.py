import json

import numpy as np
import pandas as pd
import pytest

from pourcast import cli
from pourcast.comparison.candidates import Candidates, candidates
from pourcast.comparison.matching import ComparisonOptions
from pourcast.comparison.mixture import NO_MODEL, head_of, study_mixture
from pourcast.errors import InputError
from pourcast.scenes.scene_file import write_scenes
from pourcast.statistics.sampling import Sampling
from pourcast.study.trials import Trials
from pourcast.tables import write_table
from tests.comparison.make import made_up, made_up_table, people_like, voronoi_scenes

NOBODY = Trials("water", (), (), np.empty((0, 2)))


def of(axes, judgments):
    return Candidates("m", "m", NOBODY, axes, tuple(axes), np.asarray(judgments, dtype=float))


def test_between_values_that_lie_far_apart_judgments_are_interpolated():
    head = head_of(of({"zeta": np.array([8.0, 0.0, 16.0])}, [[0.4, 1.0], [0.0, 0.0], [0.8, 0.0]]))
    assert head.parameters["zeta"].tolist() == list(range(17))
    assert head.judgments[:, 0] == pytest.approx(np.arange(17) * 0.05)
    assert head.judgments[[4, 8, 12], 1].tolist() == [0.5, 1.0, 0.5]
    # What lies near enough stays as it is.
    zeta = np.arange(17.0)
    dense = head_of(of({"zeta": zeta}, np.outer(zeta, [0.05, 0.0])))
    assert dense.parameters["zeta"].tolist() == zeta.tolist()


def test_each_value_of_the_others_is_interpolated_by_itself():
    axes = {
        "zeta": np.array([0.0, 4.0, 8.0, 0.0, 4.0, 8.0]),
        "N": np.array([25.0, 25.0, 25.0, 50.0, 50.0, 50.0]),
        "imagined": np.array(["water"] * 6, dtype=object),
    }
    head = head_of(of(axes, [[0.0, 0], [0.1, 0], [0.2, 0], [1.0, 0], [0.9, 0], [0.8, 0]]))
    assert set(head.parameters) == {"zeta"}  # Two values of N have no distribution.
    assert len(head.judgments) == 34
    assert head.judgments[:17, 0] == pytest.approx(np.linspace(0.0, 0.2, 17))
    assert head.judgments[17:, 0] == pytest.approx(np.linspace(1.0, 0.8, 17))


def test_the_swept_models_of_the_paper_are_heads():
    scenes, judged = made_up(12)
    sets = candidates(judged, [people_like(scenes, judged.judgments[0])])
    head = head_of(sets["water-ife"])
    assert set(head.parameters) == {"n_particles", "damping_zeta"}
    assert head.judgments.shape[0] == len(sets["water-ife"].judgments)
    assert set(head_of(sets["water-simple"]).parameters) == {"m"}


@pytest.fixture
def folder(tmp_path):
    scenes = voronoi_scenes(10)
    write_scenes(tmp_path / "scenes.json", scenes)
    swept = made_up_table(scenes)
    write_table(tmp_path / "judgments" / "grid.parquet", swept)
    rows = swept[swept["parameters"].str.contains('"m": 0.1,')]["judgment"].to_numpy()[:10]
    people = people_like(scenes, rows, people=8)
    wide = pd.DataFrame(people.responses, people.participants, [s.id for s in scenes])
    wide = wide.rename_axis("participant").reset_index()
    table = wide.melt("participant", var_name="scene", value_name="response")
    write_table(tmp_path / "responses" / "a.csv", table.assign(liquid="water"))
    return tmp_path


def test_what_was_not_swept_is_in_no_head(folder):
    options = ComparisonOptions(models=("blobs:fitted",))
    with pytest.raises(InputError, match="there is no 'blobs:fitted'"):
        study_mixture(folder, options, Sampling(10, 10, 1))


@pytest.mark.slow
def test_the_command_tells_shares_and_writes_who_has_what_in_the_head(folder, capsys):
    out = folder / "heads"
    line = ["mixture", folder, "-m", "water-simple:fitted", "-m", "gravity", "--draws", "100"]
    assert cli.run([*map(str, line), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "water-simple:fitted" in said
    people = pd.read_csv(out / "people.csv")
    assert len(people) == 8
    models = ["p_water-simple:fitted", "p_gravity", f"p_{NO_MODEL}"]
    assert people[models].sum(axis=1).to_numpy() == pytest.approx(np.ones(8))
    assert (people["model"] == "water-simple:fitted").mean() > 0.7
    own = pd.read_csv(out / "people_parameters.csv")
    assert set(own["parameter"]) == {"m"}
    assert (own["low"] <= own["mean"]).all()
    assert (out / "people.svg").is_file()
    assert cli.run([*map(str, line), "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["tables"]) == {
        "shares", "people", "people_parameters", "population",
    }  # fmt: skip
