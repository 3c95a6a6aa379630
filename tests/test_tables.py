"""Tables are read in one way: what is wrong is said in one line, by file, row and column."""

import codecs
import json

import hypothesis
import hypothesis.strategies as st
import numpy as np
import pandas as pd
import pytest

from pourcast.comparison.choice import read_choice
from pourcast.errors import InputError
from pourcast.prediction import predict, summarise
from pourcast.sweep.judgments import read_judgments, study_judgments
from pourcast.tables import csv_bytes, read_table, write_table
from tests.make import ramp_scene, random_scenes


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_written_is_read(tmp_path, suffix):
    table = pd.DataFrame({"name": ["007", "x"], "value": [0.1, np.nan]})
    path = tmp_path / f"t{suffix}"
    write_table(path, table)
    assert read_table(path, text=("name",)).equals(table)


# What a spreadsheet would change, or what breaks a row, in names of people and columns.
AWKWARD = (
    "1E5", "00123", "=cmd", "+3", "-2", "@x", "NA", "\u00e9", "a,b", "a;b", 'say "x"', "two\nlines",
    "'quoted", "'=1", "''00", "1-2", "MAR1", "SEPT2", "TRUE", "12345678901234567890", "1,5", "50%",
    "\uff1dx", "2025-05-07", " x", "a\rb", "5f0c1e9ab3d4e5f60718293a",
)  # fmt: skip
letters = st.characters(
    blacklist_categories=("Cs",), blacklist_characters="\0", max_codepoint=0x2FFF
)
names = st.one_of(st.sampled_from(AWKWARD), st.text(letters, min_size=1, max_size=12))


@hypothesis.settings(max_examples=60, deadline=None)
@hypothesis.given(texts=st.lists(names, min_size=1, max_size=4))
@hypothesis.example(texts=list(AWKWARD))
def test_names_come_back_from_a_file_as_they_were(tmp_path_factory, texts):
    path = tmp_path_factory.getbasetemp() / "names.csv"
    path.write_bytes(csv_bytes(pd.DataFrame({"name": texts, "value": 0.5})))
    assert read_table(path, text=("name",))["name"].tolist() == texts


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@x", "\t=1", "1E5", "00123", "1-2", "MAR1"])
def test_what_a_spreadsheet_would_change_has_an_apostrophe_and_nothing_else_has(tmp_path, text):
    plain = ["p-1", "17", "marble-15", "sim-001", "exp1-004", "NA", "0.5 to 1"]
    path = tmp_path / "t.csv"
    write_table(path, pd.DataFrame({"name": [text, *plain], "value": -1.5}))
    assert path.read_text().splitlines()[1:] == [f"{one},-1.5" for one in (f"'{text}", *plain)]


def test_a_header_is_guarded_against_formulas_alone(tmp_path):
    path = tmp_path / "t.csv"
    write_table(path, pd.DataFrame({"=x": [1], "0.5": [2], "MAR1": [3]}))
    assert path.read_text().splitlines()[0] == "'=x,0.5,MAR1"
    assert list(read_table(path)) == ["=x", "0.5", "MAR1"]


@pytest.mark.parametrize(("text", "begin"), [("ana", b"name"), ("an\u00e9", codecs.BOM_UTF8)])
def test_letters_beyond_ascii_are_marked_as_utf_8(tmp_path, text, begin):
    write_table(tmp_path / "t.csv", pd.DataFrame({"name": [text]}))
    assert (tmp_path / "t.csv").read_bytes().startswith(begin)
    assert pd.read_csv(tmp_path / "t.csv")["name"].tolist() == [text]


def test_more_cells_than_the_header_are_no_table(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2,3\n4,5,6\n")
    with pytest.raises(InputError, match=r"not a table \(rows have more cells than the header"):
        read_table(path)
    path.write_text("a,b\n1,2,\n4,5,\n")  # a comma at each row's end does no harm
    assert read_table(path)["b"].tolist() == [2, 5]


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
