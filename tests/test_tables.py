"""Tables are read in one way: what is wrong is said in one line, by file, row and column."""

import json

import numpy as np
import pandas as pd
import pytest

from pourcast.comparison.choice import read_choice
from pourcast.errors import InputError
from pourcast.prediction import predict, summarise
from pourcast.sweep.judgments import read_judgments, study_judgments
from pourcast.tables import read_table, write_table
from tests.make import ramp_scene, random_scenes


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_written_is_read(tmp_path, suffix):
    table = pd.DataFrame({"name": ["007", "x"], "value": [0.1, np.nan]})
    path = tmp_path / f"t{suffix}"
    write_table(path, table)
    assert read_table(path, text=("name",)).equals(table)


def test_verbatim_is_what_stands_there(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1.50,\nNA,02\n")
    write_table(path, read_table(path, verbatim=True))
    assert path.read_text() == "a,b\n1.50,\nNA,02\n"


def test_a_summary_is_over_the_scenes_in_any_order():
    judged = {"gravity": [0.0, 0.2, 1.0], "truth-water": [0.9, 0.5, 0.1], "level": [0.5, 0.5, 0.5]}
    table = pd.concat(
        [pd.DataFrame({"scene": list("abc"), "model": m, "judgment": j}) for m, j in judged.items()]
    )
    summary = summarise(table.iloc[[8, 1, 5, 0, 2, 7, 4, 3, 6]])
    assert set(summary.index) == set(judged)
    assert list(summary.columns) == ["mean", "sd", "r with truth-water"]
    expected = np.corrcoef(judged["gravity"], judged["truth-water"])[0, 1]
    assert summary.loc["gravity"].tolist() == pytest.approx(
        [0.4, np.std([0.0, 0.2, 1.0]), expected]
    )
    assert np.isnan(summary.loc["level", "r with truth-water"])
    by_nobody = summarise(table, ["absent"])
    assert by_nobody.index.tolist() == list(judged)
    assert by_nobody["r with absent"].isna().all()
    assert summarise(table[table["scene"] != "a"])["r with truth-water"].isna().all()


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("reader", [read_table, read_judgments])
@pytest.mark.parametrize("content", [b"", b"a,b\n1\n2,3,4,5\n", b"a,b\n\x81\x8d,1\n", None])
def test_what_is_no_table_is_one_line(tmp_path, suffix, reader, content):
    path = tmp_path / f"t{suffix}"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError) as error:
        reader(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def judgments(tmp_path, **changed):
    """A table of judgments, some cells of its second row changed."""
    table = predict(random_scenes(3, seed=2), ["gravity"]).astype(object)
    for column, value in changed.items():
        table.loc[1, column] = value
    path = tmp_path / "judgments" / "t.csv"
    write_table(path, table)
    return path


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("judgment", "most", "row 3, column judgment: expected a number, found 'most'"),
        ("judgment", 1.2, "row 3, column judgment: expected 0..1, found 1.2"),
        ("parameters", "g=0", "row 3, column parameters: expected a JSON object, found 'g=0'"),
        ("parameters", "[1]", r"row 3, column parameters: expected a JSON object, found '\[1\]'"),
        ("parameters", None, "row 3, column parameters: expected text, found nan"),
        ("digest", None, "row 3, column digest: expected text"),
        ("model", None, "row 3, column model: expected text"),
        ("seed", "first", "row 3, column seed: expected a number, found 'first'"),
        ("seed", None, "row 3, column seed: expected a number"),
    ],
)
def test_a_bad_judgment_is_named_by_row_and_column(tmp_path, column, value, said):
    path = judgments(tmp_path, **{column: value})
    with pytest.raises(InputError, match=said) as error:
        study_judgments(tmp_path, random_scenes(3, seed=2))
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_a_column_that_is_missing_is_named(tmp_path):
    path = judgments(tmp_path)
    write_table(path, read_table(path).drop(columns="seed"))
    with pytest.raises(InputError, match="column 'seed' is missing; expected digest, liquid"):
        study_judgments(tmp_path, random_scenes(3, seed=2))


@pytest.mark.parametrize("digest", ["123456789012", "12345e678901"])
def test_a_scene_whose_name_looks_like_a_number_keeps_its_judgments(tmp_path, digest, monkeypatch):
    monkeypatch.setattr(type(ramp_scene()), "digest", digest)
    scene = ramp_scene()
    write_table(tmp_path / "judgments" / "t.csv", predict([scene], ["gravity"]))
    found = study_judgments(tmp_path, [scene])
    assert found.find("water", "gravity") is not None
    assert json.loads(found.rows["parameters"].iloc[0])["g"] == 0.0


def test_a_choice_without_its_r_is_named_by_row(tmp_path):
    path = tmp_path / "report" / "tables" / "choice.csv"
    table = pd.DataFrame(
        {"model": ["a", "b"], "liquid": "water", "spec": ["a:g=0", "b"], "r": [0.5, None]}
    )
    write_table(path, table)
    with pytest.raises(InputError, match=r"choice\.csv: row 3, column r: expected a number"):
        read_choice(tmp_path)
