"""Tables of other programs, read by a mapping: what they hold, what is left out and told."""

import hashlib
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pourcast import cli
from pourcast.comparison.compare import compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.errors import InputError, ManyFaultsError
from pourcast.report.methods import provenance
from pourcast.scenes.scene_file import write_scenes
from pourcast.study.columns import Columns, find_columns, parse_columns, read_columns
from pourcast.study.programs import SHORT
from pourcast.study.responses import read_responses
from pourcast.study.trials import arrange, uncompared
from tests.comparison.make import voronoi_scenes

TABLES = Path(__file__).parent / "tables"
HOW_TO = Path(__file__).parents[1] / "docs" / "how-to" / "tables-of-other-programs.md"
SCENES = [
    scene.model_copy(update={"id": f"exp1-{k + 1:03d}"})
    for k, scene in enumerate(voronoi_scenes(6))
]
FILES = {
    "jspsych": "jspsych.csv", "psychopy": "psychopy", "qualtrics": "qualtrics.csv",
    "matrix": "matrix.csv", "labjs": "labjs.csv", "means": "means.csv",
}  # fmt: skip


def mapping(tmp_path, program):
    """The how-to's mapping."""
    text = re.search(rf"^# added to {program}.toml\n(.*?)^```", HOW_TO.read_text(), re.M | re.S)[1]
    path = tmp_path / f"{program}.toml"
    path.write_text(text)
    return path


def read(tmp_path, program, text=None):
    path = tmp_path / "other.toml"
    path.write_text(text or "")
    columns = read_columns(path if text else mapping(tmp_path, program))
    return read_responses(TABLES / FILES[program], SCENES, columns=columns)


HELD = {
    "jspsych": {"ab12c": {"004": 0.0, "002": 0.27, "001": None, "006": 0.31}},
    "psychopy": {name: {"004": 0.0, "002": 0.27, "001": None} for name in ("7", "8")},
    "qualtrics": {
        "R_1abc": {"001": 0.01, "002": 0.27, "004": 0.0},
        "R_2def": {"001": 0.04, "002": None, "004": None},
    },
    "matrix": {
        "p01": {"001": 0.01, "002": 0.27, "004": 0.0, "006": 0.31},
        "p02": {"001": 0.1, "002": 0.44, "004": None, "006": 0.52},
    },
    "labjs": {"5f0aa": {"004": 0.0, "002": 0.27}},
    "means": {"": {"001": 0.12, "002": 0.35, "004": 0.05, "006": 0.41}},
}
"""Participant -> scene -> response; None where it is missing."""

FILES_OF_SHORT = ("jspsych", "psychopy", "qualtrics", "matrix", "labjs", "means")
"""In the order of `SHORT`."""

TIMES = {"jspsych": [2.3919, 3.7502, np.nan, 8.13], "psychopy": [2.392, 3.75, np.nan] * 2,
         "labjs": [2.3924, 3.7509]}  # fmt: skip

TOLD = {
    "jspsych": "jspsych.csv: 6 rows, 4 of them trials; left out: 2 no trials",
    "psychopy": "psychopy: 10 rows, 6 of them trials; left out: 2 of practice, 2 no trials",
    "qualtrics": "qualtrics.csv: columns that name no scene are left alone: StartDate, Finished, Q9",
    "matrix": "matrix.csv: responses are those of 4 columns: exp1-001 (exp1-001), exp1-002",
    "labjs": "labjs.csv: 4 rows, 2 of them trials; left out: 2 no trials",
    "means": "",
}


@pytest.mark.parametrize("program", FILES)
def test_a_mapping_reads_what_programs_write(tmp_path, program):
    table = read(tmp_path, program)
    found = {
        who: {
            scene.removeprefix("exp1-"): None if np.isnan(response) else pytest.approx(response)
            for scene, response in zip(rows["scene"], rows["response"], strict=True)
        }
        for who, rows in table.groupby("participant")
    }
    assert found == HELD[program]
    assert set(table["liquid"]) == {"water"}
    assert TOLD[program] in " | ".join(table.attrs["told"])
    if program in TIMES:
        assert table["rt"].tolist() == pytest.approx(TIMES[program], nan_ok=True)
    missing = sum(value is None for scenes in HELD[program].values() for value in scenes.values())
    said = f"{missing} test trials have no response: they count as missing"
    assert (said in uncompared(table)) == (missing > 0)


def test_the_short_mappings_of_the_help_read_what_programs_write():
    for short, file in zip(SHORT.values(), FILES_OF_SHORT, strict=True):
        table = read_responses(TABLES / FILES[file], SCENES, columns=parse_columns(short))
        values = sorted(table["response"].dropna())
        assert values == pytest.approx(
            sorted(v for one in HELD[file].values() for v in one.values() if v is not None)
        )


def test_who_did_not_finish_is_left_out_if_that_is_said(tmp_path):
    text = mapping(tmp_path, "qualtrics").read_text() + 'trials = { Finished = "True" }\n'
    table = read(tmp_path, "qualtrics", text)
    assert set(table["participant"]) == {"R_1abc"}
    assert "2 rows, 1 of them trials; left out: 1 no trials" in " ".join(table.attrs["told"])


def test_means_are_of_nobody(tmp_path):
    (trials,) = arrange(read(tmp_path, "means"), SCENES, "")
    assert trials.responses.shape == (1, 4)
    assert trials.means_of.tolist() == [31, 31, 30, 31]


def test_a_mapping_in_the_study_is_found_told_and_kept_in_the_report(tmp_path, capsys):
    study = tmp_path / "study"
    write_scenes(study / "scenes.json", SCENES)
    (study / "responses").mkdir()
    shutil.copy(TABLES / "jspsych.csv", study / "responses")
    shutil.copy(mapping(tmp_path, "jspsych"), study / "responses" / "columns.toml")
    assert cli.run(["compare", str(study), "-m", "gravity"]) == 0
    printed = capsys.readouterr().out
    assert f"columns are mapped by {study / 'responses' / 'columns.toml'}" in printed
    assert "jspsych.csv: 6 rows, 4 of them trials; left out: 2 no trials" in printed
    assert "jspsych.csv: responses are on the scale 0..100" in printed
    found = provenance(compare_study(study, ComparisonOptions(models=("gravity",))))
    digest = hashlib.sha256((study / "responses" / "columns.toml").read_bytes()).hexdigest()
    assert dict(found)["columns of the responses"] == f"columns.toml: sha256 {digest}"
    assert cli.run(["compare", str(study), "-m", "gravity", "--scale", "0-10"]) == 2
    assert "scale: --scale has another one than the mapping (0-100)" in capsys.readouterr().err


# What is wrong ---------------------------------------------------------------------------


def test_the_program_is_told_and_its_mapping_guessed():
    for program, name in {
        "jspsych": "jsPsych", "qualtrics": "Qualtrics", "matrix": "a matrix of people by scenes",
        "labjs": "lab.js", "means": "means alone",
    }.items():  # fmt: skip
        with pytest.raises(InputError, match=f"missing; expected .*looks like {name}") as error:
            read_responses(TABLES / FILES[program], SCENES)
        assert isinstance(parse_columns(_guess(error)), Columns)
    file = next((TABLES / "psychopy").iterdir())
    with pytest.raises(
        InputError, match=r"'liquid', 'response' are missing.*looks like PsychoPy"
    ) as e:
        read_responses(file, SCENES)
    guess = f"{_guess(e)},scale:-1..1"
    table = read_responses(file, SCENES, columns=parse_columns(guess))
    assert table["response"].dropna().tolist() == pytest.approx([0.0, 0.27])


def _guess(error):
    return re.search(r"--columns, such as (\S+)", str(error.value))[1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('particpant = "x"', "there is no 'particpant'; did you mean 'participant'"),
        ('scene = { column = "a", value = "b" }', "scene: expected one of `column`, `value`"),
        ('scene = { column = "a", pattern = "(" }', "pattern: not a regular expression"),
        ('scene = { column = "a", pattern = "a" }', "pattern: expected a pattern with one group"),
        ('scene = { pattern = "(a)" }', "goes with `wide = true`"),
        ('rt_unit = "min"', "rt_unit: Input should be 's' or 'ms'"),
        ('scale = "100"', "scale: expected LOW-HIGH"),
        ("header_rows = -1", "header_rows: Input should be greater than or equal to 0, found -1"),
        ('wide = true\nresponse = "r"', "response: a wide table"),
        ("means = true\nwide = true", "means: they are of no participant"),
        ('answers = "n"', "answers: goes with `means = true`"),
        ("wide = ", "not TOML"),
        ("participant = 3", "participant: expected a column's name, or such as"),
        ("trials = { kind = { a = 1 } }", "trials.kind: expected a value, or a list of values"),
        ('trials = "slider"', "trials: "),
    ],
)
def test_a_wrong_mapping_is_told_in_a_line(tmp_path, text, said):
    path = tmp_path / "columns.toml"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_columns(path)
    assert str(error.value).startswith(f"{path}: ")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["nonsense", "PID=participant", "participant", "rt_unit:h"])
def test_a_wrong_short_mapping_is_told_in_a_line(text):
    with pytest.raises(InputError, match=r"^columns: "):
        parse_columns(text)


@pytest.mark.parametrize(
    ("program", "change", "said"),
    [
        ("jspsych", ('"subject"', '"who"'), r"column 'who' \(participant\) is missing; expected"),
        ("jspsych", ("trial_type =", "kind ="), r"column 'kind' \(trials\) is missing"),
        ("jspsych", ("image-slider", "video-slider"), "no rows.*found in trial_type: survey-text,"),
        ("jspsych", ('"0-100"', '"0-10"'), r"row 4, column response: expected 0\.\.10, found 27"),
        (
            "jspsych",
            ('"ms"', '"s"'),
            r"column rt: expected seconds, found a median of 37.*rt_unit:ms",
        ),
        (
            "jspsych",
            (r"_(\w+)\.png", r"_(\d+)\.png"),
            r"row 3, column stimulus: expected a text that",
        ),
        ("psychopy", ('"fluid"', '"scene"'), r"row 4 of 7_pour.*there is no 'exp1-004'"),
        ("qualtrics", ('"0-100"', '"0-20"'), r"row 4 \(exp1-002_1\), column response: .*found 27"),
        (
            "qualtrics",
            ("header_rows = 2", ""),
            r"row 2 \(exp1-001_1\), column response: expected a num",
        ),
        ("means", ('"mean"', '"scene"'), "row 2, column scene: expected a number"),
    ],
)
def test_what_does_not_fit_is_named_as_the_file_names_it(tmp_path, program, change, said):
    text = mapping(tmp_path, program).read_text()
    assert change[0] in text
    with pytest.raises(InputError, match=said):
        read(tmp_path, program, text.replace(*change))


def test_a_mapping_without_a_table_is_refused(tmp_path, capsys):
    out = str(tmp_path / "out")
    assert cli.run(["reproduce", "exp1", "-o", out, "--columns", "participant=p"]) == 2
    assert "columns: goes with --responses" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_scale_is_said_once(tmp_path):
    from pourcast.study.scale import SHARES

    with pytest.raises(InputError, match="scale: --scale has another one than the mapping"):
        read_columns(mapping(tmp_path, "jspsych")).scale_or(SHARES)


# Kinds of tables ---------------------------------------------------------------------------


def table_of(tmp_path, text, columns="", name="t.csv"):
    path = tmp_path / name
    path.write_text(text)
    return read_responses(path, SCENES, columns=parse_columns(columns) if columns else None)


def by_file(tmp_path, text, mapping):
    """The same, by a mapping in a file of its own."""
    path, columns = tmp_path / "t.csv", tmp_path / "mapping.toml"
    path.write_text(text)
    columns.write_text(mapping)
    return read_responses(path, SCENES, columns=read_columns(columns))


def test_a_scene_is_found_as_a_word_and_only_if_there_is_one(tmp_path):
    text = "participant,stimulus,liquid,response\np,media/{}.mp4,water,0.5\n"
    for written, scene in {"exp1-004": "exp1-004", "v2_exp1-003_honey": "exp1-003"}.items():
        table = table_of(tmp_path, text.format(written), "scene=stimulus")
        assert table["scene"].tolist() == [scene]
        assert "scenes are those that stimulus names" in " ".join(table.attrs["told"])
    for wrong in ("exp1-0041", "xexp1-004", "exp1-001/exp1-002", "none"):
        with pytest.raises(InputError, match="row 2, column stimulus: expected a scene"):
            table_of(tmp_path, text.format(wrong), "scene=stimulus")


@pytest.mark.parametrize(("missing", "gone"), [("-1", [True, False]), ("-1.0", [True, False])])
def test_declared_missing_answers_are_missing(tmp_path, missing, gone):
    text = "participant,scene,liquid,response\np,exp1-001,water,-1\np,exp1-002,water,0.5\n"
    table = table_of(tmp_path, text, f"missing:{missing}")
    assert table["response"].isna().tolist() == gone
    with pytest.raises(InputError, match="found -1"):
        table_of(tmp_path, text)


def test_decimal_commas_beside_text_are_numbers(tmp_path):
    text = (
        "who;stimulus;response;kind\na;;{yes};quiz\na;exp1-001;0,27;trial\nb;exp1-001;0,5;trial\n"
    )
    said = "participant=who,scene=stimulus,liquid:water,trials.kind:trial"
    assert table_of(tmp_path, text, said)["response"].tolist() == [0.27, 0.5]


def test_a_folder_is_one_table_and_all_its_faults_are_told(tmp_path):
    folder = tmp_path / "people"
    shutil.copytree(TABLES / "psychopy", folder)
    columns = read_columns(mapping(tmp_path, "psychopy"))
    (folder / "aborted.csv").write_text(next(folder.iterdir()).read_text().splitlines()[0] + "\n")
    table = read_responses(folder, SCENES, columns=columns)
    assert table["participant"].nunique() == 2
    for name in ("9.csv", "10.csv"):
        (folder / name).write_text("scene,who\nexp1-001,p\n")
    with pytest.raises(ManyFaultsError) as error:
        read_responses(folder, SCENES, columns=columns)
    assert [Path(line.partition(":")[0]).name for line in error.value.lines] == ["10.csv", "9.csv"]
    with pytest.raises(InputError, match=r"no table, expected \.csv, \.tsv, \.parquet"):
        (tmp_path / "empty").mkdir()
        read_responses(tmp_path / "empty", SCENES)


def test_the_file_s_name_may_be_the_participant(tmp_path):
    columns = tmp_path / "columns.toml"
    columns.write_text(
        "participant = { file = true, pattern = '^(\\w+?)_' }\nliquid = { value = 'water' }\n"
    )
    path = tmp_path / "007_pour.csv"
    path.write_text("scene,response\nexp1-001,0.5\n")
    found, said = find_columns(None, path)
    assert said == str(columns)
    assert read_responses(path, SCENES, columns=found)["participant"].tolist() == ["007"]


def test_a_mapping_lies_beside_its_table(tmp_path):
    data = tmp_path / "answers.csv"
    assert find_columns(None, data) == (Columns(), "")
    (tmp_path / "columns.toml").write_text('participant = "a"')
    assert find_columns(None, data)[0].participant.column == "a"
    (tmp_path / "answers.toml").write_text('participant = "b"')
    assert find_columns(None, data)[0].participant.column == "b"
    assert find_columns("participant=c", data)[0].participant.column == "c"
    assert find_columns(str(tmp_path / "columns.toml"), data)[0].participant.column == "a"
    with pytest.raises(InputError, match=r"none.toml: cannot be read"):
        find_columns(str(tmp_path / "none.toml"), data)


def test_a_liquid_may_stand_in_a_wide_table_s_header(tmp_path):
    columns = tmp_path / "columns.toml"
    columns.write_text(
        "wide = true\nscene = { pattern = '^(.+)_' }\nliquid = { pattern = '_(.+)$' }\n"
    )
    path = tmp_path / "t.csv"
    path.write_text("participant,exp1-001_water,exp1-001_honey\np,0.1,0.2\n")
    table = read_responses(path, SCENES, columns=read_columns(columns))
    assert dict(zip(table["liquid"], table["response"], strict=True)) == {
        "water": 0.1,
        "honey-exp1": 0.2,
    }


def test_columns_that_are_ids_are_the_scenes_and_others_are_not(tmp_path):
    text = "participant,liquid,exp1-001,exp1-001_First Click,exp1-002\np,water,0.5,3.2,0.7\n"
    table = table_of(tmp_path, text, "wide:true")
    assert table["response"].tolist() == [0.5, 0.7]
    assert "left alone: exp1-001_First Click" in " ".join(table.attrs["told"])


def test_headers_with_line_breaks_are_left_out_whole(tmp_path):
    text = 'ResponseId,exp1-001_1\n"The\nid","How\nmuch\n?"\n"{""a"":1}","{""b"":2}"\nR_1,0.5\n'
    table = table_of(tmp_path, text, "participant=ResponseId,liquid:water,wide:true,header_rows:2")
    assert table[["participant", "response", "row"]].to_numpy().tolist() == [
        ["R_1", 0.5, "4 (exp1-001_1)"]
    ]


def test_a_response_may_be_a_part_of_a_text(tmp_path):
    columns = tmp_path / "columns.toml"
    columns.write_text("response = { column = 'said', pattern = '^(\\d+) of' }\nscale = '0-100'\n")
    path = tmp_path / "t.csv"
    path.write_text(
        "participant,scene,liquid,said\np,exp1-001,water,63 of 100\np,exp1-002,water,\n"
    )
    table = read_responses(path, SCENES, columns=read_columns(columns))
    assert table["response"].tolist() == pytest.approx([0.63, np.nan], nan_ok=True)
    path.write_text("participant,scene,liquid,said\np,exp1-001,water,most of it\n")
    with pytest.raises(InputError, match="row 2, column said: expected a text that matches"):
        read_responses(path, SCENES, columns=read_columns(columns))


def test_tabs_may_stand_in_a_tsv_file(tmp_path):
    text = "participant\tscene\tliquid\tresponse\np\texp1-001\twater\t0.5\n"
    for name in ("t.tsv", "t.txt"):
        table = table_of(tmp_path, text, name=name)
        assert table["response"].tolist() == [0.5]
        assert table.attrs["told"] == (f"{name}: read as separated by tabs",)


def test_a_constant_that_was_taken_for_a_column_is_explained(tmp_path):
    text = "participant,scene,response\np,exp1-001,0.5\n"
    with pytest.raises(InputError, match=r"'water' \(liquid\) is missing.*what all rows share is"):
        table_of(tmp_path, text, "liquid=water")


def test_parquet_is_mapped_too(tmp_path):
    path = tmp_path / "t.parquet"
    pd.DataFrame({"PID": [7, 8], "s": ["exp1-001"] * 2, "response": [0.1, 0.2]}).to_parquet(path)
    columns = parse_columns("participant=PID,scene=s,liquid:water")
    assert read_responses(path, SCENES, columns=columns)["participant"].tolist() == ["7", "8"]


# All faults at once ------------------------------------------------------------------------


def test_all_faults_of_a_table_are_told_a_line_each(tmp_path, capsys):
    rows = [f"p{k},exp1-{k % 6 + 1:03d},water,0.5,2.0,false" for k in range(40)]
    bad = ["p,exp1-001,water,7,2.0,false"] * 9 + [
        ",exp1-001,water,0.5,2.0,false", "p,nowhere,water,0.5,2.0,false",
        "p,exp1-001,oil,0.5,2.0,false", "p,exp1-002,tar,0.5,2.0,false",
        "p,exp1-001,water,much,2.0,false", "p,exp1-001,water,0.5,late,false",
        "p,exp1-001,water,0.5,2.0,perhaps",
    ]  # fmt: skip
    study = tmp_path / "study"
    write_scenes(study / "scenes.json", SCENES)
    path = tmp_path / "t.csv"
    path.write_text("\n".join(["participant,scene,liquid,response,rt,mirrored", *rows, *bad, ""]))
    assert cli.run(["compare", str(study), "--responses", str(path), "-m", "gravity"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"pourcast: {path}: row ") for line in lines)
    assert len(lines) == 8
    text = "\n".join(lines)
    assert "row 42, column response: expected 0..1" in text
    assert "found 7 (and 8 more rows: 43, 44, 45, 46, 47, ...)" in text
    for said in (
        "row 51, column participant: expected a name", "row 52, column scene: expected a scene",
        "row 53, column liquid: there is no 'oil'", "row 54, column liquid: there is no 'tar'",
        "row 55, column response: expected a number, found 'much'",
        "row 56, column rt: expected a number, found 'late'",
        "row 57, column mirrored: expected true or false, found 'perhaps'",
    ):  # fmt: skip
        assert said in text


def test_of_many_faults_the_first_are_told_and_the_number(tmp_path):
    liquids = [f"p,exp1-001,l{k},0.5" for k in range(30)]
    with pytest.raises(ManyFaultsError) as error:
        table_of(tmp_path, "\n".join(["participant,scene,liquid,response", *liquids, ""]))
    assert len(error.value.lines) == 21
    assert error.value.lines[-1] == "and 10 more faults"


def test_who_it_was_is_never_taken_from_somebody_else_s_row(tmp_path):
    # A name that the pattern doesn't match, and none at all: not the person's above.
    for second in ('""id"": ""P-02""', '""id"": """"', '""other"": 1'):
        text = (
            'meta,scene,liquid,response\n"{""id"": ""ana""}",exp1-001,water,0.5\n'
            f',exp1-002,water,0.5\n"{{{second}}}",exp1-001,water,0.5\n,exp1-002,water,0.5\n'
        )
        columns = 'participant = { column = "meta", pattern = \'"id": ?"(\\w+)"\', fill = true }'
        with pytest.raises(InputError, match=r"row 4, column meta: expected a text that matches"):
            by_file(tmp_path, text, columns)


def test_several_columns_of_a_scene_are_not_averaged(tmp_path):
    text = "who,exp1-001_First Click,exp1-001_1,exp1-002_1\na,3.2,0.5,0.6\n"
    columns = 'participant = "who"\nliquid = { value = "water" }\nwide = true\n'
    with pytest.raises(InputError, match="several columns name a scene: exp1-001_First Click, exp"):
        by_file(tmp_path, text, columns)
    found = by_file(tmp_path, text, f"{columns}scene = {{ pattern = '^(exp1-\\d+)_1$' }}")
    assert found["response"].tolist() == [0.5, 0.6]


def test_of_columns_that_share_a_name_none_is_taken(tmp_path):
    own = "participant,scene,liquid,response,response\na,exp1-001,water,0.5,0.6\n"
    with pytest.raises(InputError, match="column 'response': several are called so, expected one"):
        table_of(tmp_path, own)
    mapped = "who,scene,liquid,slider,slider\na,exp1-001,water,0.5,0.6\n"
    with pytest.raises(InputError, match="column 'slider': several are called so"):
        table_of(tmp_path, mapped, "participant=who,response=slider")
    # Others than those that are read may be called as they like.
    others = "participant,scene,liquid,response,click,click\na,exp1-001,water,0.5,1,2\n"
    assert table_of(tmp_path, others)["response"].tolist() == [0.5]


def test_a_constant_is_a_text():
    with pytest.raises(InputError, match="expected a text"):
        parse_columns("participant: ,scene=s,liquid:water,response=r")


def test_percents_may_have_decimal_commas(tmp_path):
    text = "participant;scene;liquid;response\n" + "".join(
        f"a;exp1-00{k};water;{value}\n" for k, value in enumerate(("12,5 %", "7,25%", "100 %"), 1)
    )
    assert table_of(tmp_path, text)["response"].tolist() == [0.125, 0.0725, 1.0]


def test_a_study_s_own_file_beside_a_table_is_no_mapping(tmp_path):
    (tmp_path / "study.toml").write_text('experiment = "exp1"\n')
    assert find_columns(None, tmp_path / "study.csv") == (Columns(), "")
    (tmp_path / "study.toml").write_text('participant = "PID"\n')
    assert find_columns(None, tmp_path / "study.csv")[0].participant.column == "PID"


def test_means_are_of_somebody(tmp_path):
    text = "scene,liquid,response,n\nexp1-001,water,0.5,0\nexp1-002,water,0.5,-2\n"
    with pytest.raises(InputError, match="column n: expected a number above 0"):
        by_file(tmp_path, text, 'means = true\nanswers = "n"\n')
