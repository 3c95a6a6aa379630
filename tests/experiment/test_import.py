"""Answers from files: what is good is taken in, what isn't is named by file and line."""

import gzip
import json
import shutil
import zipfile
from pathlib import Path

import pandas as pd
import pytest

from pourcast import cli
from pourcast.experiment.data.record_import import import_records
from pourcast.experiment.data.tables import participants_table, trials_table
from pourcast.experiment.design.materials import prepare_materials
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_bodies import canonical
from pourcast.experiment.storage.records import MAX_CONFLICTS
from pourcast.experiment.storage.storage import Storage
from tests.experiment.make import EXP2, answer, judgment, small_study

ANSWERS = Path(__file__).parent / "answers"

KEY = "8bf91e8e66aa7932b3bc307ff37fc0e7"

OWN_ORDERS = 'order = "own"\n'


def call(*arguments):
    return cli.run(["experiment", *map(str, arguments)])


class Study:
    """A study that files are taken into."""

    def __init__(self, folder, url=None):
        self.folder = folder
        self.storage = Storage.of_study(self.folder, url)
        self.journal = Journal.of_study(self.folder)
        self.materials = prepare_materials(self.folder, self.storage.secret)

    def take(self, content, name="answers.jsonl"):
        """Import a file, and again: the second time nothing may change."""
        path = self.folder / name
        if content is not None:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        summary = self.import_once(path)
        before = self.journal.read(), trials_table(self.storage).to_csv()
        again = self.import_once(path)
        assert not again.changes
        assert (self.journal.read(), trials_table(self.storage).to_csv()) == before
        assert again.left_out == summary.left_out
        return summary

    def import_once(self, path):
        return import_records(
            path, self.storage, self.journal, self.materials.steps, 1_700_000_000.0
        )

    def steps(self, group=0, place=0):
        return self.materials.steps(group, place)

    def records(self):
        return [(record.seq, json.loads(record.body)) for record in self.storage.records()]

    def remarks(self):
        return participants_table(self.storage)["remarks"].tolist()


@pytest.fixture(scope="module")
def templates(tmp_path_factory):
    """Studies to be copied: of Experiment 1, and of Experiment 2 with an order for everybody."""
    folder = tmp_path_factory.mktemp("templates")
    small_study(folder / "exp1")
    small_study(folder / "exp2", "exp2", design=EXP2 + OWN_ORDERS)
    return folder


@pytest.fixture
def study(templates, tmp_path):
    opened = Study(shutil.copytree(templates / "exp1", tmp_path / "study"))
    yield opened
    opened.storage.close()


@pytest.fixture
def other_orders(templates, tmp_path):
    """A study in which every place has an order of its own."""
    opened = Study(shutil.copytree(templates / "exp2", tmp_path / "study"))
    yield opened
    opened.storage.close()


@pytest.fixture
def either(templates, tmp_path, database):
    """A study with a database of each kind."""
    opened = Study(shutil.copytree(templates / "exp1", tmp_path / "study"), database)
    yield opened
    opened.storage.close()


def opening(key=KEY, **more):
    return {"format": "pourcast-records", "schema_version": 2, "session": key} | more


def run_of(steps, key=KEY, **more):
    """Records of a session as an exported page writes them."""
    return [
        {"session": key, "seq": step.seq, "kind": step.kind, "trial_type": "pourcast"}
        | {"body": answer(step.kind, round(0.01 * step.seq, 2))}
        | more
        for step in steps
    ]


def text_of(*lines):
    return "".join(json.dumps(line) + "\n" for line in lines)


# Odd lines -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "records", "message"),
    [
        ("u2028-answers.jsonl", 14, None),
        ("datapipe-payload.jsonl", 14, None),
        ("import-truncated.jsonl", 9, "line 11: left out: cut short, or not JSON"),
        ("jatos-two-components.txt", 14, "line 1, item 1: left out: no line of pourcast-records"),
    ],
)
def test_what_people_really_bring_is_taken_in(study, name, records, message):
    summary = study.take((ANSWERS / name).read_bytes(), name)
    assert (summary.sessions, summary.opened, summary.new) == (1, 1, records)
    assert summary.left_out == (message is not None)
    expected = [] if message is None else [f"{study.folder / name}: {message}"]
    assert list(summary.messages) == expected
    assert study.storage.sessions()[0].state == ("complete" if records == 14 else "open")


@pytest.mark.parametrize("odd", ["\u2028", "\u2029", "\u0085", "\x1e", "\x0b", "\x0c", "\x1c"])
@pytest.mark.parametrize("escaped", [False, True])
def test_only_a_line_feed_ends_a_line(study, odd, escaped):
    if not escaped and odd < " ":
        pytest.skip("JSON has no such character but escaped")
    lines = [opening(group=0, place=0), *run_of(study.steps())]
    lines[-1]["body"] = {"rt": 1.0, "remarks": f"one{odd}two"}
    text = "".join(json.dumps(line, ensure_ascii=escaped) + "\r\n" for line in lines)
    assert study.take(text).messages == ()
    assert study.records()[-1][1]["remarks"] == f"one{odd}two"


@pytest.mark.parametrize(
    "coding",
    ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"],
)
def test_texts_of_any_coding_are_read(study, coding):
    lines = [opening(group=0, place=0), *run_of(study.steps())]
    lines[-1]["body"] = {"rt": 1.0, "remarks": "für 水"}
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    assert study.take(text.encode(coding)).messages == ()
    assert study.remarks() == ["für 水"]


def test_a_byte_that_is_no_character_costs_that_character_alone(study):
    lines = [opening(group=0, place=0), *run_of(study.steps())]
    lines[-1]["body"] = {"rt": 1.0, "remarks": "f\u00fcr"}
    text = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines)
    summary = study.take(text.encode("latin-1"))
    assert summary.new == 14
    assert summary.messages == (
        f"{study.folder}/answers.jsonl: line 15: not UTF-8; what can't be read became \ufffd",
    )
    assert study.remarks() == ["f\ufffdr"]


@pytest.mark.parametrize("written", [r"\ud83d", r"\ude00", r"\u0000", r"a\udfffb"])
def test_what_no_database_can_store_is_replaced(either, tmp_path, written):
    lines = [
        opening(group=0, place=0, identifiers={"PROLIFIC_PID": "ODD"}),
        *run_of(either.steps()),
    ]
    lines[-1]["body"] = {"rt": 1.0, "remarks": "ODD"}
    summary = either.take(text_of(*lines).replace("ODD", f"x{written}y"))
    assert (summary.new, summary.left_out) == (14, 0)
    assert either.remarks() == ["x" + json.loads(f'"{written}"').translate(_REPLACED) + "y"]
    # And so it can be written as a table, and read again.
    path = tmp_path / "people.csv"
    participants_table(either.storage, identifiers=True).to_csv(path)
    assert "\ufffd" in pd.read_csv(path)["remarks"][0]


_REPLACED = dict.fromkeys((0, *range(55296, 57344)), "�")


def test_a_remark_that_ends_in_half_a_character_is_kept_by_the_server_too(study):
    assert json.loads(canonical("debrief", {"rt": 1.0, "remarks": "x\ud83d\x00"})) == {
        "rt": 1.0, "remarks": "x\ufffd\ufffd", "dropped_frames": 0, "focus_losses": 0,
        "window_height": 0.0, "window_width": 0.0,
    }  # fmt: skip


def test_values_one_after_another_are_read_without_line_feeds(study):
    lines = [opening(group=0, place=0), *run_of(study.steps())]
    assert study.take("".join(map(json.dumps, lines))).new == 14


def test_what_is_cut_in_the_middle_of_a_line_costs_that_value_alone(study):
    texts = list(map(json.dumps, [opening(group=0, place=0), *run_of(study.steps())]))
    texts[5] = texts[5][:70]
    summary = study.take("".join(texts))
    assert summary.new == 13
    assert summary.messages == (
        f"{study.folder}/answers.jsonl: line 1: left out: cut short, or not JSON",
    )


@pytest.mark.parametrize("indent", [None, 2])
def test_an_array_is_read_as_datapipe_keeps_it(study, indent):
    lines = [opening(group=0, place=0, trial_type="pourcast"), *run_of(study.steps())]
    assert study.take(json.dumps(lines, indent=indent), f"{KEY}.json").new == 14


def test_of_an_array_that_was_cut_what_is_whole_is_taken(study):
    lines = [opening(group=0, place=0, trial_type="pourcast"), *run_of(study.steps())]
    summary = study.take(json.dumps(lines)[:-40], f"{KEY}.json")
    assert (summary.new, summary.left_out) == (13, 1)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("no json", "left out: cut short, or not JSON"),
        ("7", "left out: no line of pourcast-records"),
        ('{"rt": 5}', "left out: no line of pourcast-records"),
        ('{"format": "other", "session": "KEY"}', "left out: no line of pourcast-records"),
        ("[" * 100_000, "left out: cut short, or not JSON"),
        ('{"session": "KEY", "seq": 99, "body": {}}', "left out: seq: expected below 14, found 99"),
        ('{"session": "KEY", "seq": -2, "body": {}}', "left out: seq: Input should be"),
        ('{"session": "KEY", "seq": 3, "body": {"rt": 1}}', "left out: stimulus: Field required"),
        ('{"session": "KEY", "seq": 3, "body": 7}', "left out: body: Input should be"),
        (
            '{"session": "KEY", "seq": 3, "kind": "film", "body": {}}',
            "left out: kind: step 3 is 'judgment', found 'film'",
        ),
        (
            '{"format": "pourcast-records", "session": "0123456789", "group": 9, "place": 0}',
            "left out: group: this study has no group 9",
        ),
        (
            '{"format": "pourcast-records", "session": "0123456789"}',
            "left out: session: not one of this study's",
        ),
        (
            '{"format": "pourcast-records", "session": "0123456789", "schema_version": 3}',
            "left out: schema_version: Input should be less than or equal to 2, found 3",
        ),
        ('{"session": "0123456789", "seq": 0, "body": {}}', "left out: no line opens its session"),
    ],
)
def test_a_line_that_is_wrong_is_told_of_and_the_others_are_taken(study, line, message):
    first, *rest = [opening(group=0, place=0), *run_of(study.steps())]
    text = text_of(first) + line.replace("KEY", KEY) + "\n" + text_of(*rest)
    summary = study.take(text)
    assert (summary.new, summary.left_out, len(summary.messages)) == (14, 1, 1)
    assert summary.messages[0].startswith(f"{study.folder}/answers.jsonl: line 2: {message}")


def test_many_lines_of_another_component_are_one_message(study):
    others = [{"trial_type": "html-keyboard-response", "rt": k} for k in range(300)]
    lines = [opening(group=0, place=0), *run_of(study.steps())]
    text = text_of(*others) + json.dumps(others) + text_of(*lines) + "not\nJSON\n"
    summary = study.take(text)
    assert (summary.new, summary.left_out) == (14, 602)
    assert [message.partition("jsonl: ")[2] for message in summary.messages] == [
        "line 1 to 300: left out: no line of pourcast-records",
        "line 301, item 1 to 300: left out: no line of pourcast-records",
        "line 316 to 317: left out: cut short, or not JSON",
    ]


def test_the_command_says_what_it_left_out_and_exits_with_1(study, capsys):
    path = study.folder / "answers.jsonl"
    path.write_text(text_of(opening(group=0, place=0), *run_of(study.steps())) + "{cut")
    assert call("data", study.folder, "--import", path, "-o", study.folder / "out") == 1
    said = capsys.readouterr()
    assert f"{path}: line 16: left out: cut short, or not JSON\n" in said.err
    assert "1 lines were left out, as said above; the others are taken in" in said.err
    assert "1 sessions (1 of them new), 14 new records" in said.out
    assert len(pd.read_csv(study.folder / "out" / "trials.csv")) == 7
    path.write_text(text_of(opening(group=0, place=0), *run_of(study.steps())))
    assert call("data", study.folder, "--import", path) == 0
    assert "14 that were there, 0 kept aside; nothing has changed" in capsys.readouterr().out


@pytest.mark.parametrize("state", ["failed_check", "screened_out", "declined_later"])
def test_a_file_undoes_no_end(study, state):
    records = run_of(study.steps())
    study.take(text_of(opening(group=0, place=0), *records[:-1]).encode(), "first.jsonl")
    study.storage.end(study.storage.sessions()[0].number, state)
    study.take(text_of(opening(group=0, place=0), *records).encode(), "all.jsonl")
    assert [one.state for one in study.storage.sessions()] == [state]
    assert len(study.storage.records()) == 14


def test_a_file_that_cannot_be_read_is_told_of(study, capsys):
    assert call("data", study.folder, "--import", study.folder / "nothing.jsonl") == 2
    assert "nothing.jsonl: cannot be read (No such file" in capsys.readouterr().err


# Archives and folders --------------------------------------------------------------------


def jatos_archive(path, texts, component="comp-result_{}"):
    """Results as JATOS exports them: a folder a run, in it one a component."""
    with zipfile.ZipFile(path, "w") as archive:
        for number, text in enumerate(texts, start=1):
            folder = f"study_result_{number}/{component.format(7 * number)}"
            archive.writestr(f"{folder}/data.txt", text)
            archive.writestr(f"{folder}/files/", "")
        archive.writestr("metadata.json", json.dumps({"apiVersion": "1.0.1", "data": []}, indent=1))
    return path


def texts_of(study, count):
    return [
        text_of(opening(f"session-{k}", group=0, place=k), *run_of(study.steps(), f"session-{k}"))
        for k in range(count)
    ]


@pytest.mark.parametrize("name", ["results.jrzip", "results.zip"])
@pytest.mark.parametrize("component", ["comp-result_{}", "comp_result_{}"])
def test_a_results_archive_is_read_as_jatos_writes_it(study, name, component):
    jatos_archive(study.folder / name, texts_of(study, 3), component)
    summary = study.take(None, name)
    assert (summary.sessions, summary.new, summary.messages) == (3, 42, ())


def test_what_is_wrong_in_an_archive_is_named_with_its_member(study):
    path = jatos_archive(
        study.folder / "r.jrzip", [*texts_of(study, 1), "{cut", b"\x89PNG\r\n\x00"]
    )
    assert study.take(None, "r.jrzip").messages == (
        f"{path}: study_result_2/comp-result_14/data.txt: line 1: left out: cut short, or not JSON",
        f"{path}: study_result_3/comp-result_21/data.txt: left out: not a text file",
    )


def test_a_folder_is_read_with_all_that_is_in_it(study):
    folder = study.folder / "osf"
    (folder / "more").mkdir(parents=True)
    texts = texts_of(study, 4)
    (folder / "session-0.json").write_text(texts[0])
    (folder / "more" / "session-1.jsonl.gz").write_bytes(gzip.compress(texts[1].encode()))
    jatos_archive(folder / "r.zip", texts[2:])
    (folder / ".DS_Store").write_bytes(b"\x00\x01")
    (folder / "__MACOSX").mkdir()
    (folder / "__MACOSX" / "session-0.json").write_bytes(b"\x00\x05")
    summary = study.take(None, "osf")
    assert (summary.sessions, summary.new, summary.messages) == (4, 56, ())


def test_of_an_archive_that_is_cut_what_can_be_read_is_taken(study):
    packed = gzip.compress(texts_of(study, 1)[0].encode(), 0)
    summary = study.take(packed[:-400], "a.jsonl.gz")
    assert 0 < summary.new < 14
    assert summary.messages[0].startswith(f"{study.folder}/a.jsonl.gz: cut short, or damaged (")
    whole = jatos_archive(study.folder / "r.zip", texts_of(study, 1)).read_bytes()
    summary = study.take(whole[:-30], "cut.zip")
    assert summary.messages[0].startswith(f"{study.folder}/cut.zip: left out: not a whole archive")


# Runs and their openings ------------------------------------------------------------------


def test_an_opening_line_may_come_again_and_anywhere(study):
    first = opening(group=0, place=2, entry="jatos", identifiers={"PROLIFIC_PID": "p"})
    records = run_of(study.steps(0, 2))
    summary = study.take(text_of(*records[:5], first, *records[5:], first, first))
    assert (summary.opened, summary.new, summary.messages) == (1, 14, ())
    session = study.storage.sessions()[0]
    assert (session.entry, session.place, session.state) == ("jatos", 2, "complete")
    # The code is the one that the page has shown.
    assert session.code == KEY[:8].upper()


def test_a_run_without_an_opening_is_taken_in_by_group_and_place_and_marked(other_orders):
    study = other_orders
    steps = study.steps(0, 5)
    summary = study.take(text_of(*run_of(steps, group=0, place=5)))
    assert summary.left_out == 0
    assert "no line opens session" in summary.messages[0]
    assert "as one of group 1, order 5, with the entry 'unknown'" in summary.messages[0]
    trials = trials_table(study.storage)
    assert trials["scene"].tolist() == [one.scene for one in steps if one.kind == "judgment"]
    assert set(trials["entry"]) == {"unknown"}
    # The line that was lost turns up.
    found = opening(group=0, place=5, entry="jatos", identifiers={"PROLIFIC_PID": "p"})
    assert study.import_once(_written(study, text_of(found))).opened == 0
    session = study.storage.sessions()[0]
    assert (session.entry, session.identifiers) == ("jatos", {"PROLIFIC_PID": "p"})


def _written(study, text):
    path = study.folder / "more.jsonl"
    path.write_text(text)
    return path


def test_a_run_of_an_older_page_without_an_opening_is_known_by_its_pictures(other_orders):
    study = other_orders
    steps = study.steps(0, 7)
    lines = [
        {"session": KEY, "seq": step.seq, "body": answer(step.kind) | _stimulus(step)}
        for step in steps
    ]
    assert study.take(text_of(*lines)).opened == 1
    trials = trials_table(study.storage)
    assert trials["scene"].tolist() == [one.scene for one in steps if one.kind == "judgment"]
    assert study.storage.sessions()[0].place == 7


def _stimulus(step):
    names = {"judgment": step.still, "film": step.film}
    return {"stimulus": names[step.kind]} if step.kind in names else {}


def test_a_file_of_another_study_is_said_to_be_perhaps_one(study):
    first = {"format": "pourcast-records", "session": KEY}
    lines = [{"session": KEY, "seq": step.seq, "body": answer(step.kind)} for step in study.steps()]
    summary = study.take(json.dumps([first, *lines]))
    assert (summary.opened, summary.left_out, len(summary.messages)) == (0, 15, 2)
    assert "item 1: left out: session: not one of this study's" in summary.messages[0]
    assert "item 2 to 15: left out: its session is left out" in summary.messages[1]
    assert "perhaps they are another study's" in summary.messages[1]


def test_a_run_that_nobody_can_place_says_how_to_place_it(study):
    lines = [{"session": KEY, "seq": step.seq, "body": answer(step.kind)} for step in study.steps()]
    summary = study.take(text_of(*lines))
    assert (summary.opened, summary.left_out, len(summary.messages)) == (0, 14, 1)
    line = summary.messages[0].partition("put ")[2].partition(" (both")[0]
    line = line.replace("GROUP", "0").replace("PLACE", "3")
    assert study.take(line + "\n" + text_of(*lines)).new == 14


def test_lines_that_say_what_was_shown_are_believed_where_the_design_was_changed(study):
    records = run_of(study.steps(), group=0, place=0)
    records[3] |= {"scene": "gone-1", "liquid": "honey", "phase": "practice", "trial": 1}
    records[5] |= {"scene": "gone-2", "liquid": "honey", "mirrored": True, "phase": "test"}
    study.take(text_of(*records))
    trials = trials_table(study.storage)
    assert trials["scene"].tolist()[:2] == ["gone-1", "gone-2"]
    assert trials["mirrored"].tolist()[:3] == [False, True, False]


# Conflicts --------------------------------------------------------------------------------


def test_a_conflict_is_told_by_line_and_kept_aside(study):
    study.take(text_of(opening(group=0, place=0), *run_of(study.steps())))
    other = {"session": KEY, "seq": 3, "body": judgment(0.77)}
    summary = study.take(text_of(other), "other.jsonl")
    assert (summary.conflicts, summary.left_out) == (1, 0)
    assert summary.messages == (
        f"{study.folder}/other.jsonl: line 1: step 3 has another answer already; this one is kept "
        "aside",
    )
    assert [json.loads(one.body)["response"] for one in study.storage.conflicts()] == [0.77]


def test_more_conflicts_than_are_kept_are_named(study):
    study.take(text_of(opening(group=0, place=0), *run_of(study.steps())))
    others = [
        {"session": KEY, "seq": 3, "body": judgment(0.5 + k / 100)}
        for k in range(MAX_CONFLICTS + 2)
    ]
    summary = study.take(text_of(*others), "others.jsonl")
    assert (summary.conflicts, summary.left_out) == (MAX_CONFLICTS, 2)
    assert "line 21 to 22: left out: too many other answers are kept" in summary.messages[-1]


def test_what_a_page_cannot_know_is_not_believed_of_a_page(study):
    """Only a journal, which has the database's secrets, says who has which code and token."""
    claimed = opening(
        group=0, place=0, code="PAID", participant="somebody", tokens=["0" * 64], number=9,
        request="request-of-another", started=1.0,
    )  # fmt: skip
    record = run_of(study.steps())[0] | {"received": 2.0}
    study.take(text_of(claimed, record, {"session": KEY, "state": "complete"}))
    session = study.storage.sessions()[0]
    assert (session.code, session.number, session.state) == (KEY[:8].upper(), 1, "open")
    assert session.participant.startswith("static-")
    assert (session.started, study.storage.records()[0].received) == (1.7e9, 1.7e9)


def test_a_journal_of_another_study_does_not_change_this_ones_links(study, templates, tmp_path):
    other = Study(shutil.copytree(templates / "exp1", tmp_path / "other"))
    other.take(text_of(opening(group=0, place=0), *run_of(other.steps())))
    study.take(text_of(opening("own-session", group=0, place=0)))
    secret = study.storage.secret
    shutil.copy(other.journal.path, study.folder / "theirs.jsonl")
    summary = study.take(None, "theirs.jsonl")
    assert (summary.new, summary.left_out) == (14, 1)
    assert "line 1: left out: the secrets of another database" in summary.messages[0]
    assert study.storage.secret == secret
    other.storage.close()
