"""Links: who comes by them, who is nobody, and whose id two browsers have."""

import json
from urllib.parse import parse_qsl, quote, urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pourcast import cli
from pourcast.errors import InputError
from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.data.tables import participants_table
from pourcast.experiment.design.links import (
    filled,
    link_key,
    participant_links,
    read_ids,
    visitor,
)
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import api_of
from tests.experiment.make import answer, small_study

SECRET = b"s" * 16

PLACEHOLDERS = [
    "{{%PROLIFIC_PID%}}", "{%PROLIFIC_PID%}", "%PROLIFIC_PID%", "PROLIFIC_PID", "{{%PROLIFIC_PID",
    "PROLIFIC_PID%}}", "${e://Field/PROLIFIC_PID}", "${workerId}", "[ID]", "[[ID]]", "<id>", "{id}",
    "%SURVEY_CODE%", "$ID", "@ID@", "undefined", "null", "NULL", "None", "NaN", "n/a", "-", "...",
    "", " ", "\t", "\u00a0", "\u200b", "ASSIGNMENT_ID_NOT_AVAILABLE", "[object Object]",
]  # fmt: skip

PEOPLE = [
    "5f0c1d2e3b4a5968778695a4", "A1B2C3D4E5F6G7", "test", "12", "Nan", "Ada [pilot]", "50%",
    "participant_id_3", "Müller-Lüdenscheidt", "日本", "null7",
]  # fmt: skip


def links_with(value):
    """A link of each platform with this in place of the identifier."""
    return [
        {"PROLIFIC_PID": value, "STUDY_ID": "s", "SESSION_ID": "t"},
        {"workerId": value, "assignmentId": "a", "hitId": "h"},
        {"lab": link_key(SECRET, "lab"), "participant": value},
    ]


def encodings(value):
    return [value, f"  {value}\n", quote(value, safe=""), quote(quote(value, safe=""), safe="")]


@pytest.mark.parametrize("placeholder", PLACEHOLDERS)
def test_a_placeholder_is_nobody_on_any_platform_however_it_is_encoded(placeholder):
    for value in encodings(placeholder):
        assert [visitor(link, SECRET) for link in links_with(value)] == [None] * 3


@pytest.mark.parametrize("person", PEOPLE)
def test_who_is_somebody_is_let_in_the_same_with_blanks_around(person):
    for link, spaced in zip(links_with(person), links_with(f" {person}\u200b\n"), strict=True):
        found = visitor(link, SECRET)
        assert person in found.identifiers.values()
        assert visitor(spaced, SECRET) == found


@given(st.from_regex("[0-9a-f]{24}|A[A-Z0-9]{12,13}|[A-Za-z]{2,8}[0-9]{1,6}", fullmatch=True))
def test_no_platforms_id_is_taken_for_a_placeholder(identifier):
    assert filled(identifier) == identifier


@given(st.text(max_size=40))
def test_whatever_stands_in_a_link_is_a_person_or_nobody(text):
    found = filled(text)
    assert found in text
    assert filled(found) == found


def test_the_links_that_are_given_away_are_nobodys_until_they_are_filled_in():
    given = participant_links("http://x", SECRET)["prolific"]
    link = dict(parse_qsl(urlsplit(given).query, keep_blank_values=True))
    assert list(link) == ["PROLIFIC_PID", "STUDY_ID", "SESSION_ID"]
    assert visitor(link, SECRET) is None


def test_of_a_person_what_is_not_filled_in_is_left_out():
    link = {"PROLIFIC_PID": "5f0", "STUDY_ID": "{{%STUDY_ID%}}", "SESSION_ID": " t "}
    assert visitor(link, SECRET).identifiers == {"PROLIFIC_PID": "5f0", "SESSION_ID": "t"}


@pytest.mark.parametrize("number", range(3))
def test_an_unfilled_link_is_refused_kindly_and_the_researcher_is_told(
    tmp_path, number, caplog, capsys
):
    study = small_study(tmp_path)
    with api_of(study) as api:
        for k, placeholder in enumerate(PLACEHOLDERS[:3]):
            link = links_with(placeholder)[number]
            if "lab" in link:
                link["lab"] = link_key(api.storage.secret, "lab")
            said = api.begin(f"request-{k}", link=link)
            assert (said.status_code, said.json()["refused"]) == (403, "unfilled")
            assert "was never filled in. Please open the study once more" in said.json()["text"]
        assert api.storage.sessions() == []
        told = [line for line in caplog.text.splitlines() if "a visitor was refused" in line]
        assert len(told) == 1
        assert "nobody had filled in the link" in told[0]
        assert "{{%PROLIFIC_PID%}}" in told[0]
        page = api.client.get(f"/admin?token={api.storage.admin_token}").text
        assert "visits that were refused: 3, as nobody had filled in the link" in page
    assert cli.run(["experiment", "status", str(study)]) == 0
    assert (
        "visits that were refused: 3, as nobody had filled in the link" in capsys.readouterr().out
    )


def test_who_looks_at_a_task_without_accepting_it_is_told_to_and_nobody_is_alarmed(api, caplog):
    link = {"assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE", "hitId": "h"}
    said = api.begin(link=link)
    assert (said.status_code, said.json()["refused"]) == (403, "unaccepted")
    assert "Please accept the task first" in said.json()["text"]
    assert caplog.text == ""
    assert api.storage.refusals() == {}


def test_refusals_fill_no_disk_and_too_many_visits_are_told_of(tmp_path, caplog):
    with api_of(small_study(tmp_path), sessions_per_address=3) as api:
        said = [api.begin(f"request-{k}", link={"PROLIFIC_PID": ""}).status_code for k in range(5)]
        assert said == [403, 403, 403, 429, 429]
        assert api.storage.refusals() == {"unfilled": 3}
        assert api.begin("request-9").json()["refused"] == "busy"
        told = "more than 3 visits came from one address within an hour; if they are your partici"
        assert caplog.text.count(told) == 1


# Files from elsewhere --------------------------------------------------------------------


@pytest.mark.parametrize("entry", ["static", "jatos"])
def test_an_unfilled_link_in_a_file_is_an_anonymous_participant_of_their_own(
    tmp_path, entry, capsys
):
    study = small_study(tmp_path / "s")
    identifiers = {"PROLIFIC_PID": "{{%PROLIFIC_PID%}}", "STUDY_ID": "{{%STUDY_ID%}}"}
    path = tmp_path / "answers.jsonl"
    lines = []
    for session, ids in (("a" * 32, identifiers), ("b" * 32, identifiers),
                         ("c" * 32, {"PROLIFIC_PID": " 5f0 "})):  # fmt: skip
        lines += [
            {"format": "pourcast-records", "schema_version": 1, "session": session, "entry": entry,
             "identifiers": ids, "group": 0, "place": 0},
            {"session": session, "seq": 0, "body": answer("consent")},
        ]  # fmt: skip
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    assert cli.run(["experiment", "data", str(study), "--import", str(path)]) == 0
    said = capsys.readouterr().out
    assert said.count("came by a link in which nobody had filled in PROLIFIC_PID STUDY_ID") == 2
    storage = Storage.of_study(study)
    sessions = storage.sessions()
    assert len(storage.records()) == 3
    storage.close()
    assert len({session.participant for session in sessions}) == 3
    assert [dict(session.identifiers) for session in sessions] == [
        {"unfilled": "PROLIFIC_PID STUDY_ID"}, {"unfilled": "PROLIFIC_PID STUDY_ID"},
        {"PROLIFIC_PID": "5f0"},
    ]  # fmt: skip
    assert cli.run(["experiment", "status", str(study)]) == 0
    codes = ", ".join(session.participant for session in sessions[:2])
    assert f"{codes}: came by a link that nobody had filled in" in capsys.readouterr().out
    assert cli.run(["experiment", "data", str(study), "--withdraw", "{{%PROLIFIC_PID%}}"]) == 2


# One id, two browsers --------------------------------------------------------------------


def warnings_of(api):
    seen = study_overview(api.experiment.study, api.storage, api.clock())
    return [line for line in seen.warnings if "took turns" in line]


LINK = {"PROLIFIC_PID": "5f0", "STUDY_ID": "s", "SESSION_ID": "t"}


def test_two_browsers_with_one_id_at_the_same_time_are_told_of(api):
    told = api.begin("request-1", tab="tab-00000001", link=LINK).json()
    api.put(told, 0, answer("consent"))
    api.clock.now += 8.0
    other = api.begin("request-2", tab="tab-00000002", link=LINK).json()
    assert other["key"] == told["key"]
    assert api.put(told, 1, answer("check")).json()["superseded"]
    api.begin("request-2", tab="tab-00000002", link=LINK)
    api.begin("request-3", tab="tab-00000003", link=LINK)
    assert warnings_of(api) == [
        f"{told['participant']}: 3 browsers took turns with one id within a minute; the answers "
        "may be of more than one person"
    ]
    assert "3 browsers took turns" in api.client.get(
        f"/admin?token={api.storage.admin_token}"
    ).text  # fmt: skip
    assert participants_table(api.storage)["browsers"].tolist() == [3]
    api.storage.delete([session.number for session in api.storage.sessions()])
    assert api.storage.browsers_at_once() == {}


def test_who_changes_computers_or_reloads_is_one_browser(api):
    told = api.begin("request-1", tab="tab-00000001", link=LINK).json()
    api.put(told, 0, answer("consent"))
    api.clock.now += 5.0
    api.begin("request-1", tab="tab-00000002", link=LINK)  # a reload
    api.clock.now += 300.0
    other = api.begin("request-2", tab="tab-00000003", link=LINK).json()  # another computer
    api.put(other, 1, answer("check"), tab="tab-00000003")
    assert warnings_of(api) == []
    assert participants_table(api.storage)["browsers"].tolist() == [1]


def test_who_comes_again_when_all_is_done_takes_no_turns(api):
    api.run(api.begin("request-1", link=LINK).json())
    api.begin("request-2", link=LINK)
    assert warnings_of(api) == []


# A list of ids ---------------------------------------------------------------------------


def test_with_a_list_only_its_ids_are_let_in_and_the_lab_is(tmp_path, caplog):
    path = tmp_path / "ids.txt"
    path.write_text("\ufeff5f0\n\n 6a1 \r\n")
    with api_of(small_study(tmp_path / "s"), allowed_ids=read_ids(path)) as api:

        def begin(number, **link):
            return api.begin(f"request-{number}", link=link)

        assert begin(1, PROLIFIC_PID="5f0", SESSION_ID="t").status_code == 201
        assert begin(2, PROLIFIC_PID=" 6a1").status_code == 201
        refused = [begin(3, PROLIFIC_PID="7b2", SESSION_ID="5f0"), begin(4, workerId="x")]
        assert {(one.status_code, one.json()["refused"]) for one in refused} == {(403, "unlisted")}
        assert "on its list only" in refused[0].json()["text"]
        assert api.begin("request-5").status_code == 201
        assert api.storage.refusals() == {"unlisted": 2}
        assert caplog.text.count("as the id is not in your list") == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "ids.txt: expected an id on each line, found none"),
        (
            b"5f0\n{{%PROLIFIC_PID%}}\n",
            "ids.txt: line 2: expected one id, found '{{%PROLIFIC_PID%}}'",
        ),
        (b"5f0,6a1\n", "ids.txt: line 1: expected one id, found '5f0,6a1'"),
        (b"\xff\xfe\x00", "ids.txt: not a text file"),
    ],
)
def test_a_list_that_is_none_is_told_of(tmp_path, content, message, capsys):
    path = tmp_path / "ids.txt"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message.replace("{", r"\{")):
        read_ids(path)
    study = small_study(tmp_path / "s")
    assert cli.run(["experiment", "serve", str(study), "--check", "--allowed-ids", str(path)]) == 2
    assert message in capsys.readouterr().err
