"""Data out of the database and back in: every answer, described, and deleted when asked for."""

import json
import re

import pandas as pd
import pytest

from pourcast import cli
from pourcast.errors import InputError
from pourcast.experiment.data.dataset import write_data
from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.data.record_import import import_records
from pourcast.experiment.data.responses import study_responses
from pourcast.experiment.data.tables import (
    PARTICIPANT_COLUMNS,
    TRIAL_COLUMNS,
    trials_table,
)
from pourcast.experiment.design.materials import prepare_materials
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage, study_storage
from pourcast.files import write_text
from pourcast.spreadsheets import guarded
from pourcast.study.folder import study_scenes
from pourcast.study.trials import arrange
from tests.experiment.conftest import api_of
from tests.experiment.make import EXP1, answer, judgment, scenes_of, small_study


def call(*arguments):
    return cli.run(["experiment", *map(str, arguments)])


@pytest.fixture
def collected(tmp_path):
    """A study with two participants (one from Prolific, who stopped half way) and a preview."""
    study = small_study(tmp_path / "s", "exp2")
    with api_of(study) as api:
        api.run(api.begin("request-1").json())
        link = {"PROLIFIC_PID": "5f0secret", "STUDY_ID": "st", "SESSION_ID": "se"}
        half = api.begin("request-2", link=link).json()
        for step in half["steps"][:8]:
            api.put(half, step["seq"], answer(step["kind"], 0.75))
        api.put(half, 3, judgment(0.1))
        from pourcast.experiment.design.links import link_key

        api.run(
            api.begin("request-3", link={"preview": link_key(api.storage.secret, "preview")}).json()
        )
    return study


def test_tables_hold_every_answer_and_no_platform_id(collected, tmp_path, capsys):
    assert call("data", collected, "-o", tmp_path / "out") == 0
    assert "2 participants, 17 judgments" in capsys.readouterr().out
    trials = pd.read_csv(tmp_path / "out" / "trials.csv")
    people = pd.read_csv(tmp_path / "out" / "participants.csv")
    assert list(trials.columns) == [name for name in TRIAL_COLUMNS if name != "trajectory"]
    assert list(people.columns) == list(PARTICIPANT_COLUMNS)
    assert people["state"].tolist() == ["complete", "open"]
    assert people["test_trials"].tolist() == [12, 3]
    assert people["kept_aside"].tolist() == [0, 1]
    assert people["remarks"].tolist()[0] == "'=1+1 <b>fine</b>"
    assert (trials.groupby("participant")["trial"].max() <= 12).all()
    text = "".join(path.read_text() for path in (tmp_path / "out").iterdir())
    assert "5f0secret" not in text
    call("data", collected, "-o", tmp_path / "ids", "--identifiers", "--preview")
    people = pd.read_csv(tmp_path / "ids" / "participants.csv")
    assert len(people) == 3
    assert people["id_PROLIFIC_PID"].tolist()[1] == "5f0secret"


def test_a_judgment_says_how_large_its_picture_was_but_older_ones_stay_as_they_are(tmp_path):
    size = {"picture_width": 215.3, "picture_height": 323.0, "pixel_ratio": 1.25}
    with api_of(small_study(tmp_path)) as api:
        told = api.begin().json()
        seqs = [step["seq"] for step in told["steps"] if step["kind"] == "judgment"]
        # A page, or a file, of an earlier release says nothing of it, nor does what is stored.
        assert api.put(told, seqs[0], judgment(0.5)).status_code == 200
        assert api.put(told, seqs[1], judgment(0.6, **size)).status_code == 200
        old, new = (json.loads(record.body) for record in api.storage.records())
        assert not size.keys() & old.keys()
        assert size.items() <= new.items()
        table = trials_table(api.storage)
        assert table[list(size)].isna().all(axis=1).tolist() == [True, False]
        assert table[list(size)].iloc[1].to_dict() == size


def test_comparing_reads_the_database_and_turns_no_cup_around(collected):
    scenes = study_scenes(collected)
    table, source = study_responses(collected, None, scenes)
    assert source == collected / "responses.sqlite"
    water, honey = arrange(table, scenes, "x")
    assert water.responses.shape[1] == len(scenes)
    assert honey.liquid == "honey-exp2"
    plan = {(row.scene, row.liquid, row.participant): row.response for row in table.itertuples()}
    for trials, liquid in ((water, "water"), (honey, "honey-exp2")):
        for i, who in enumerate(trials.participants):
            for j, scene in enumerate(trials.scenes):
                answered = plan.get((scene.id, liquid, who))
                assert (
                    trials.responses[i, j] == pytest.approx(answered, nan_ok=True)
                    or answered is None
                )


def test_a_table_beside_the_database_must_be_chosen(collected):
    (collected / "responses").mkdir()
    (collected / "responses" / "simulated.csv").write_text("participant\n")
    with pytest.raises(InputError, match=r"more than one source .*responses.sqlite, responses/sim"):
        study_responses(collected, None, study_scenes(collected))


def test_a_study_that_nobody_took_part_in_says_what_to_do(tmp_path):
    study = small_study(tmp_path)
    with pytest.raises(InputError, match="collect some with `pourcast experiment serve`"):
        study_responses(study, None, study_scenes(study))


PSYCH_DS_NAME = re.compile(r"([a-z]+-[A-Za-z0-9]+)(_[a-z]+-[A-Za-z0-9]+)*_data\.csv")
"""Psych-DS: keywords, parted by underscores, and the suffix `_data`."""


def test_psych_ds_keeps_the_standards_rules(collected, tmp_path):
    out = tmp_path / "ds"
    assert call("data", collected, "--format", "psych-ds", "-o", out) == 0
    described = json.loads((out / "dataset_description.json").read_text())
    assert described["@context"] == "https://schema.org/"
    assert described["@type"] == "Dataset"
    assert described["name"]
    assert described["description"]
    variables = {one["name"]: one for one in described["variableMeasured"]}
    assert all(one["@type"] == "PropertyValue" and one["description"] for one in variables.values())
    tables = list((out / "data").iterdir())
    assert len(tables) == 2
    for path in tables:
        assert PSYCH_DS_NAME.fullmatch(path.name)
        assert set(pd.read_csv(path).columns) <= set(variables)
    assert (out / "materials" / "scenes.json").is_file()
    # A second time it would mix what is old with what is new.
    assert call("data", collected, "--format", "psych-ds", "-o", out) == 2


def test_who_withdraws_is_gone_from_everywhere(collected, capsys):
    table = collected / "responses" / "people.csv"
    call("data", collected, "-o", collected / "responses")
    (collected / "responses" / "trials.csv").rename(table)
    capsys.readouterr()
    before = pd.read_csv(table)
    assert call("data", collected, "--withdraw", "5f0secret") == 0
    said = capsys.readouterr().out
    assert "database: 8 rows of records" in said
    assert "responses.jsonl: 10 lines" in said
    assert "responses/people.csv: 4 rows" in said
    left = b"".join(
        path.read_bytes()
        for path in collected.rglob("*")
        if path.is_file() and "stimuli" not in str(path)
    )
    gone = set(before["participant"]) - set(pd.read_csv(table)["participant"])
    assert len(gone) == 1
    assert b"5f0secret" not in left
    assert gone.pop().encode() not in left
    # The study's and the session's ids at Prolific are nobody's name.
    for nobody in ("5f0secret", "st", "se", ""):
        assert call("data", collected, "--withdraw", nobody) == 2
    assert "there is no participant '5f0secret'" in capsys.readouterr().err


def offered(told, steps):
    """The file that the page offers when the server can't be reached."""
    lines = [{"format": "pourcast-records", "schema_version": 1, "session": told["token"]}]
    lines += [
        {"session": told["token"], "seq": step["seq"], "body": answer(step["kind"], 0.5)}
        for step in steps
    ]
    return "".join(json.dumps(line) + "\n" for line in lines)


def test_a_file_that_a_participant_downloaded_completes_the_session(tmp_path, capsys):
    study = small_study(tmp_path / "s")
    with api_of(study) as api:
        told = api.begin().json()
        api.put(told, 0, answer("consent"))
        api.put(told, 3, judgment(0.9))
    path = tmp_path / "answers.jsonl"
    path.write_text(offered(told, told["steps"]))
    assert call("data", study, "--import", path) == 0
    assert (
        f"{len(told['steps']) - 2} new records, 1 that were there, 1 kept aside"
        in capsys.readouterr().out
    )
    call("status", study, "--json")
    said = json.loads(capsys.readouterr().out)
    assert said["groups"] == [{"group": 1, "complete": 1}]
    assert said["judgments"] == 7
    assert call("data", study, "--import", path) == 0
    assert (
        f"0 new records, {len(told['steps'])} that were there, 0 kept aside; nothing has changed"
        in capsys.readouterr().out
    )


def test_a_file_of_a_session_that_no_server_saw_makes_one(tmp_path, capsys):
    study = small_study(tmp_path / "s", design=EXP1)
    with api_of(study) as api:
        steps = [step.model_dump() for step in api.experiment.materials.steps(0, 2)]
    opening = {
        "format": "pourcast-records", "schema_version": 1, "session": "a1b2c3d4e5", "entry": "jatos",
        "identifiers": {"PROLIFIC_PID": "5f0"}, "group": 0, "place": 2,
    }  # fmt: skip
    told = {"token": "a1b2c3d4e5"}
    text = json.dumps(opening) + "\n" + offered(told, steps).split("\n", 1)[1]
    path = tmp_path / "results.txt"
    path.write_text(text)
    assert call("data", study, "--import", path, "-o", tmp_path / "out") == 0
    people = pd.read_csv(tmp_path / "out" / "participants.csv")
    assert people["state"].tolist() == ["complete"]
    assert people["entry"].tolist() == ["jatos"]
    trials = pd.read_csv(tmp_path / "out" / "trials.csv")
    assert trials["scene"].tolist() == [s["scene"] for s in steps if s["kind"] == "judgment"]


def test_a_session_from_a_file_gets_into_the_journal_with_who_it_is(tmp_path):
    study = small_study(tmp_path / "s", design=EXP1)
    storage, journal = Storage.of_study(study), Journal.of_study(study)
    materials = prepare_materials(study, storage.secret)
    steps = [step.model_dump() for step in materials.steps(0, 2)]
    opening = {"format": "pourcast-records", "session": "a1b2c3d4e5", "group": 0, "place": 2}
    path = tmp_path / "results.txt"
    records = offered({"token": "a1b2c3d4e5"}, steps).split("\n", 1)[1]
    path.write_text(json.dumps(opening) + "\n" + records)
    for new in (len(steps), 0):
        summary = import_records(path, storage, journal, materials.steps, 5.0)
        assert (summary.sessions, summary.new) == (1, new)
        assert [line["seq"] for line in journal.lines() if "seq" in line] == [*range(len(steps))]
    assert study_overview(study, storage, 6.0).missing_in_journal == 0
    storage.close()


def test_an_overview_warns_of_conflicts_and_of_what_the_journal_has_not(collected, capsys):
    lines = (collected / "responses.jsonl").read_text().splitlines(keepends=True)
    (collected / "responses.jsonl").write_text("".join(lines[:-2]))
    with study_storage(collected, None) as storage:
        seen = study_overview(collected, storage, 1_700_000_000.0)
        assert (seen.conflicts, seen.missing_in_journal, seen.judgments) == (1, 2, 17)
        assert seen.states.loc[1].to_dict() == {"complete": 1, "open": 1}
        # Who was away for too long counts as dropped.
        later = study_overview(collected, storage, 1_800_000_000.0)
        assert later.states.loc[1].to_dict() == {"complete": 1, "dropped": 1}
    assert call("status", collected) == 0
    said = capsys.readouterr().out
    assert "1 records came under a key that had another one; they are kept aside" in said
    assert "2 records are in the database alone, and not in responses.jsonl" in said
    call("status", collected, "--json")
    told = json.loads(capsys.readouterr().out)
    assert (told["kept_aside"], told["missing_in_journal"]) == (1, 2)


@pytest.mark.parametrize(("form", "files"), [("csv", 2), ("psych-ds", 7)])
def test_what_was_written_is_told_with_what_is_in_it(collected, tmp_path, form, files):
    with study_storage(collected, None) as storage:
        written = write_data(tmp_path / "out", collected, storage, form)
        assert (written.participants, written.judgments) == (2, 17)
        assert len(written.paths) == files
        assert all(path.is_file() for path in written.paths)
        everybody = write_data(tmp_path / "all", collected, storage, form, preview=True)
        assert everybody.participants == 3


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1"])
def test_formulas_are_defused_and_numbers_left_alone(text):
    table = pd.DataFrame({"remarks": [text, "fine"], "number": [-1.0, 2.0]})
    safe = guarded(table)
    assert safe["remarks"].tolist() == [f"'{text}", "fine"]
    assert safe["number"].tolist() == [-1.0, 2.0]


@pytest.mark.parametrize("command", ["status", "data"])
def test_without_a_database_there_is_one_line(tmp_path, capsys, command):
    study = small_study(tmp_path)
    assert call(command, study) == 2
    assert "responses.sqlite: not there; nobody has taken part yet" in capsys.readouterr().err


def test_every_column_is_described():
    assert all(len(text) > 8 for text in {**TRIAL_COLUMNS, **PARTICIPANT_COLUMNS}.values())


@pytest.mark.parametrize(("other", "own"), [("water", "water-v0"), ("honey", "honey-exp1-v0")])
def test_answers_of_0_1_are_not_taken_for_those_to_todays_liquids(tmp_path, other, own):
    scenes = scenes_of("exp1", 3)
    write_text(tmp_path / "study.toml", 'experiment = "exp1-v0"\n')
    answers = pd.DataFrame(
        {"participant": "p", "scene": [one.id for one in scenes], "liquid": other, "response": 0.5}
    )
    path = tmp_path / "answers.csv"
    answers.to_csv(path, index=False)
    with pytest.raises(
        InputError, match=rf"answers\.csv: row 2, column liquid: '{other}' is not .*'{own}' was"
    ):
        study_responses(tmp_path, path, scenes)
    answers.assign(liquid=own).to_csv(path, index=False)
    assert set(study_responses(tmp_path, path, scenes)[0]["liquid"]) == {own}
    write_text(tmp_path / "study.toml", 'experiment = "exp1"\n')
    answers.to_csv(path, index=False)
    assert len(study_responses(tmp_path, path, scenes)[0]) == 3
