"""The API: what a participant's browser asks, and what it is told and refused."""

import json
import time

import pytest

from pourcast.errors import StoreError
from pourcast.experiment.data.withdrawal import withdraw
from pourcast.experiment.design.links import link_key
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage import journal as journal_module
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_bodies import MAX_BODY
from pourcast.experiment.storage.storage import Storage
from pourcast.stimuli.manifest import NAME
from tests.experiment.conftest import api_of
from tests.experiment.make import EXP1, EXP2, answer, judgment, small_study


def test_a_session_from_consent_to_the_end(api):
    told = api.begin().json()
    kinds = [step["kind"] for step in told["steps"]]
    assert kinds[:5] == ["consent", "check", "instructions", "judgment", "film"]
    assert kinds[5:] == [*["judgment"] * 2, "break", *["judgment"] * 2, "break",
                         *["judgment"] * 2, "debrief"]  # fmt: skip
    assert [step["seq"] for step in told["steps"]] == list(range(len(kinds)))
    ended = api.run(told)
    assert ended == {"missing": [], "code": "", "redirect": ""}
    assert api.storage.sessions()[0].state == "complete"
    records = api.storage.records()
    assert [record.seq for record in records] == list(range(len(kinds)))
    assert [json.loads(r.body)["response"] for r in records if r.kind == "judgment"] == [
        seq / 100 for seq, kind in enumerate(kinds) if kind == "judgment"
    ]


def test_an_answer_is_given_when_the_record_is_in_the_database(api):
    told = api.begin().json()
    assert api.put(told, 3, judgment()).json() == {"saved": "new", "superseded": False}
    assert [record.seq for record in api.storage.records()] == [3]
    assert lines(api) == [(1, -1), (1, 3)]


def test_the_same_post_twice_is_one_record_and_another_is_kept_aside(api):
    told = api.begin().json()
    said = [api.put(told, 3, judgment(r)).json()["saved"] for r in (0.5, 0.5, 0.6)]
    assert said == ["new", "repeated", "conflict"]
    assert len(api.storage.records()) == len(api.storage.conflicts()) == 1


def test_the_end_names_what_is_missing_and_takes_exactly_that(api):
    told = api.begin().json()
    for step in told["steps"]:
        if step["seq"] not in (4, 7):
            api.put(told, step["seq"], answer(step["kind"]))
    assert api.post(told, "finish", state="complete").json() == {"missing": [4, 7]}
    assert api.storage.sessions()[0].state == "open"
    for seq in (4, 7):
        api.put(told, seq, answer(told["steps"][seq]["kind"]))
    assert api.post(told, "finish", state="complete").json()["missing"] == []


def test_a_reload_goes_on_and_takes_the_session_from_the_other_tab(api):
    told = api.begin().json()
    api.put(told, 0, answer("consent"))
    again = api.post(told, "resume", tab="tab-00000002").json()
    assert again["done"] == [0]
    assert again["steps"] == told["steps"]
    assert api.put(told, 1, answer("check")).json() == {"saved": "new", "superseded": True}
    assert not api.put(told, 2, answer("instructions"), tab="tab-00000002").json()["superseded"]


def test_looking_takes_the_session_from_nobody_and_beginning_again_does(api):
    told = api.begin().json()
    assert api.post(told, "resume").json()["done"] == []
    assert not api.put(told, 0, answer("consent")).json()["superseded"]
    again = api.begin(tab="tab-00000002").json()
    assert again["done"] == [0]
    assert api.put(told, 1, answer("check")).json()["superseded"]
    assert not api.put(again, 2, answer("instructions"), tab="tab-00000002").json()["superseded"]


def test_who_was_away_for_too_long_goes_on_if_the_design_can_hold_it(api):
    told = api.begin().json()
    api.put(told, 0, answer("consent"))
    api.clock.now += 7201.0
    other = api.begin("request-2").json()
    states = {one.number: one.state for one in api.storage.sessions()}
    assert states == {1: "dropped", 2: "open"}
    assert api.storage.sessions()[0].place == api.storage.sessions()[1].place
    assert api.post(told, "resume", tab="tab-00000002").json()["done"] == [0]
    assert {one.state for one in api.storage.sessions()} == {"open"}
    assert api.run(told)["missing"] == api.run(other)["missing"] == []


def test_who_was_away_goes_on_without_a_reload(api):
    told = api.begin().json()
    api.clock.now += 7201.0
    api.begin("request-2")
    assert api.storage.sessions()[0].state == "dropped"
    # What another tab still had to send is no sign that somebody came back.
    api.put(told, 0, answer("consent"), tab="tab-00000002")
    assert api.storage.sessions()[0].state == "dropped"
    api.put(told, 1, answer("check"))
    assert api.storage.sessions()[0].state == "open"


def test_who_was_away_is_late_only_where_somebody_else_has_the_place(tmp_path):
    link = {"PROLIFIC_PID": "5f0", "STUDY_ID": "s", "SESSION_ID": "t"}
    with api_of(small_study(tmp_path, design=f"places = 1\n{EXP1}")) as api:
        told = api.begin(link=link).json()
        api.clock.now += 7201.0
        # Nobody else came.
        assert api.begin("request-2", link=link).json()["key"] == told["key"]
        api.clock.now += 7201.0
        other = api.begin("request-3").json()
        said = [
            api.post(told, "resume", tab="tab-00000002"),
            api.post(told, "resume"),
            api.begin(link=link),
            api.begin("request-4", link=link),
        ]
        assert [one.status_code for one in said] == [410] * 4
        assert {one.json()["refused"] for one in said} == {"late"}
        assert "too long" in said[0].json()["text"]
        # What the browser still had is taken all the same, and stays.
        assert api.put(told, 3, judgment()).json()["saved"] == "new"
        assert [one.state for one in api.storage.sessions()] == ["dropped", "open"]
        assert api.post(other, "resume").status_code == 200
        # The place is free again.
        api.post(other, "finish", state="screened_out")
        assert api.post(told, "resume", tab="tab-00000002").json()["done"] == [3]


def test_a_clock_set_back_by_a_day_changes_nothing(api):
    told = api.begin().json()
    api.clock.now -= 86400.0
    assert api.put(told, 0, answer("consent")).json()["saved"] == "new"
    assert api.post(told, "resume", tab="tab-00000002").status_code == 200
    assert api.run(told)["missing"] == []


def test_who_declines_leaves_nothing_behind(api):
    told = api.begin().json()
    assert api.post(told, "finish", state="declined").json()["missing"] == []
    assert api.storage.sessions() == api.storage.records() == []
    assert lines(api) == []


def test_who_declines_twice_as_the_first_answer_was_lost_is_told_the_same(api):
    told = api.begin().json()
    first, second = (api.post(told, "finish", state="declined") for _ in range(2))
    assert (first.status_code, first.json()) == (second.status_code, second.json())
    assert api.post(told, "finish", state="complete").status_code == 401


@pytest.mark.parametrize(
    ("link", "refused"),
    [
        ({}, "link"),
        ({"lab": "guess"}, "link"),
        ({"preview": ""}, "link"),
        ({"PROLIFIC_PID": ""}, "unfilled"),
        ({"workerId": "w", "assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"}, "unaccepted"),
    ],
)
def test_a_link_that_is_none_of_ours_is_refused(api, link, refused):
    said = api.begin(link=link)
    assert said.status_code == 403
    assert said.json()["refused"] == refused
    assert api.storage.sessions() == []


def test_nobody_is_simulated_where_nobody_rehearses(api):
    said = api.begin(link={"simulation": link_key(api.storage.secret, "simulation")})
    assert said.status_code == 403


def test_prolifics_participants_are_hashed_and_get_their_codes(tmp_path):
    codes = (
        '[recruiting]\ncomplete = "DONE1"\nfailed_check = "FAIL1"\n'
        'redirect = "https://app.example.org/?cc={code}"\n'
    )
    with api_of(small_study(tmp_path, design=EXP1 + codes)) as api:
        link = {"PROLIFIC_PID": "5f0", "STUDY_ID": "s", "SESSION_ID": "t"}
        told = api.begin(link=link).json()
        assert "5f0" not in told["participant"]
        assert api.run(told) == {
            "missing": [], "code": "DONE1", "redirect": "https://app.example.org/?cc=DONE1",
        }  # fmt: skip
        again = api.begin("request-2", link=link | {"SESSION_ID": "u"})
        assert (again.status_code, again.json()["refused"]) == (403, "again")
        other = api.begin("request-3", link=link | {"PROLIFIC_PID": "6a1"}).json()
        assert api.post(other, "finish", state="failed_check").json()["code"] == "FAIL1"


def test_experiment_2_shows_everybody_both_liquids_and_honey_in_a_mirror(tmp_path):
    with api_of(small_study(tmp_path, "exp2")) as api:
        told = api.begin().json()
        plan = api.storage.sessions()[0].steps
        test = [step for step in plan if step.phase == "test"]
        assert len(test) == 12
        assert {(s.liquid, s.mirrored) for s in test} == {("water", False), ("honey", True)}
        assert sorted(s.scene for s in test if s.liquid == "honey") == sorted(
            s.scene for s in test if s.liquid == "water"
        )
        # A browser is told neither the scene's name nor that it is mirrored.
        assert not {"scene", "mirrored"} & {name for step in told["steps"] for name in step}


def test_media_are_named_by_nothing_that_tells_and_test_films_are_not_served(api):
    told = api.begin().json()
    practice = [step for step in told["steps"] if step["kind"] == "film"]
    test = [step for step in told["steps"] if step.get("phase") == "test"]
    assert not any(step.get("film") for step in test)
    for name in (practice[0]["film"], practice[0]["still"], test[0]["still"]):
        got = api.client.get(f"/media/{name}")
        assert got.status_code == 200
        assert len(name.split(".")[0]) == 32
    stimuli = api.experiment.materials.stimuli
    assert practice[0]["film"] not in (stimuli.folder / NAME).read_text()
    films = [one.film for one in stimuli.manifest.stimuli if one.film]
    for name in [*films, "manifest.json", "..%2fmanifest.json", "../study.toml"]:
        assert api.client.get(f"/media/{name}").status_code == 404


def test_films_come_in_parts_as_browsers_want_them(api):
    film = next(step["film"] for step in api.begin().json()["steps"] if step["kind"] == "film")
    part = api.client.get(f"/media/{film}", headers={"Range": "bytes=0-99"})
    assert part.status_code == 206
    assert len(part.content) == 100


def test_one_participant_cannot_touch_another(api):
    one, other = api.begin("request-1").json(), api.begin("request-2").json()
    assert one["token"] != other["token"]
    for token in ("", "x" * 43, one["token"][:-1]):
        said = api.put({"token": token}, 0, answer("consent"))
        assert said.status_code == 401
    api.put(one, 0, answer("consent"))
    assert api.post(other, "resume", tab="tab-00000003").json()["done"] == []


@pytest.mark.parametrize(
    "body",
    [
        judgment(1.5),
        judgment(float("nan")),
        judgment(response="much"),
        judgment(rt=-1),
        judgment(extra=1),
        judgment(input="mind"),
        judgment(trajectory=[[0.0, 0.5]] * 2001),
        {},
    ],
)
def test_a_body_that_no_page_sends_is_refused_and_names_its_field(api, body):
    told = api.begin().json()
    text = json.dumps({"tab": "tab-00000001", "body": body})
    said = api.client.put(
        "/api/session/records/3", content=text, headers={"Authorization": f"Bearer {told['token']}"}
    )
    assert said.status_code == 422
    assert ": " in said.json()["error"]
    assert api.storage.records() == []


def test_a_step_that_is_not_in_the_plan_is_refused(api):
    told = api.begin().json()
    assert api.put(told, len(told["steps"]), {}).status_code == 404
    assert api.put(told, 10**12, {}).status_code == 404


def test_a_disk_cannot_be_filled_by_one_request_or_one_address(tmp_path):
    with api_of(small_study(tmp_path), sessions_per_address=3) as api:
        told = api.begin("request-1").json()
        long = {"rt": 1, "remarks": "x" * MAX_BODY}
        assert api.put(told, len(told["steps"]) - 1, long).status_code == 413
        said = [api.begin(f"request-{k}").status_code for k in (2, 3, 4)]
        assert said == [201, 201, 429]
        api.clock.now += 3601.0
        assert api.begin("request-5").status_code == 201


def test_what_cannot_be_saved_is_not_acknowledged(api, monkeypatch):
    told = api.begin().json()

    def full(records):
        raise StoreError("disk full")

    with monkeypatch.context() as patched:
        patched.setattr(api.storage, "save", full)
        said = api.put(told, 0, answer("consent"))
        assert (said.status_code, said.headers["retry-after"]) == (503, "2")
    assert api.put(told, 0, answer("consent")).json()["saved"] == "new"


def full(*_, **__):
    raise OSError(28, "No space left on device")


def lines(api):
    """Session's number and step of the journal's lines; -1 for a line that opens a session."""
    numbers = {one.key: one.number for one in api.storage.sessions()}
    return [
        (numbers[line["session"]], line.get("seq", -1))
        for line in api.experiment.journal.lines()
        if "session" in line and "token" not in line
    ]


def admin_page(api):
    return api.client.get(f"/admin?token={api.storage.admin_token}").text


def test_a_journal_that_cannot_be_written_is_told_of_and_catches_up(tmp_path, monkeypatch, caplog):
    # The promise of an answer is the database's; the researcher is told what has one copy alone.
    study = small_study(tmp_path)
    with api_of(study, journal_retry=0.05) as api:
        told = api.begin().json()
        assert "cannot be written" not in admin_page(api)
        with monkeypatch.context() as patched:
            patched.setattr(journal_module.os, "write", full)
            assert api.put(told, 0, answer("consent")).json()["saved"] == "new"
            assert [record.seq for record in api.storage.records()] == [0]
            assert lines(api) == [(1, -1)]
            assert caplog.text.count("responses.jsonl: cannot be written (No space left") == 1
            page = admin_page(api)
            assert "responses.jsonl: cannot be written (No space left on device)" in page
            assert "1 records are in the database alone, and not in responses.jsonl" in page
        # Nobody answers any more, and yet it is tried again.
        wait_until(lambda: lines(api) == [(1, -1), (1, 0)])
        assert "responses.jsonl" not in admin_page(api)
        assert "works again" in caplog.text


def test_what_the_journal_never_took_is_told_of_at_the_end_and_appended_at_the_next_start(
    tmp_path, monkeypatch, caplog
):
    study = small_study(tmp_path)
    with monkeypatch.context() as patched:
        patched.setattr(journal_module.os, "write", full)
        with api_of(study) as api:
            api.put(api.begin().json(), 0, answer("consent"))
        assert "3 records are in the database alone; the next start appends them" in caplog.text
    with api_of(study) as api:
        assert lines(api) == [(1, -1), (1, 0)]


def test_who_declines_while_the_journal_cannot_be_written_leaves_nothing_behind(
    tmp_path, monkeypatch
):
    with api_of(small_study(tmp_path)) as api:
        with monkeypatch.context() as patched:
            patched.setattr(journal_module.os, "write", full)
            told = api.begin().json()
            assert api.post(told, "finish", state="declined").json()["missing"] == []
        api.put(api.begin("request-2").json(), 0, answer("consent"))
        assert {session for session, _ in lines(api)} == {2}


def test_who_withdraws_while_the_journal_cannot_be_written_never_gets_into_it(
    tmp_path, monkeypatch
):
    study = small_study(tmp_path)
    with api_of(study) as api:
        with monkeypatch.context() as patched:
            patched.setattr(journal_module.os, "write", full)
            told = api.begin().json()
            # In a process of its own, as `pourcast experiment data --withdraw` is.
            storage = Storage.of_study(study)
            withdraw(study, storage, Journal.of_study(study), told["participant"])
            storage.close()
        api.put(api.begin("request-2").json(), 0, answer("consent"))
        assert {session for session, _ in lines(api)} == {2}


def test_declining_is_tried_again_until_the_journal_has_nothing_left(api, monkeypatch):
    told = api.begin().json()
    with monkeypatch.context() as patched:
        patched.setattr(journal_module, "replacing", full)
        said = api.post(told, "finish", state="declined")
        assert (said.status_code, said.headers["retry-after"]) == (503, "2")
        assert lines(api) == [(1, -1)]
        assert len(api.storage.sessions()) == 1
    assert api.post(told, "finish", state="declined").json()["missing"] == []
    assert lines(api) == api.storage.sessions() == []


def test_a_deleted_sessions_token_opens_nobody_elses(api):
    declined = api.begin().json()
    api.post(declined, "finish", state="declined")
    other = api.begin("request-2").json()
    assert api.put(declined, 1, answer("check")).status_code == 401
    assert api.post(other, "resume").json()["done"] == []
    assert [session.number for session in api.storage.sessions()] == [2]


def test_a_database_that_fails_is_told_of_once_and_on_the_admin_page(api, monkeypatch, caplog):
    told = api.begin().json()

    def locked(records):
        raise StoreError("responses.sqlite: database is locked")

    with monkeypatch.context() as patched:
        patched.setattr(api.storage, "save", locked)
        for _ in range(3):
            assert api.put(told, 0, answer("consent")).status_code == 503
        assert api.experiment.failures == ["responses.sqlite: database is locked"]
    assert caplog.text.count("database is locked; participants' browsers try again") == 1
    assert api.experiment.storage_failures.count == 3
    api.put(told, 0, answer("consent"))
    assert api.experiment.failures == []


def test_an_error_of_ours_is_no_step_that_is_missing(api, monkeypatch):
    told = api.begin().json()

    def broken(records):
        raise IndexError("list index out of range")

    monkeypatch.setattr(api.storage, "save", broken)
    assert api.put(told, 0, answer("consent")).status_code == 500


def test_saving_that_ended_is_told_of_and_acknowledges_nothing(tmp_path, monkeypatch, caplog):
    async def broken(*_):
        raise RuntimeError("a fault")

    monkeypatch.setattr(LiveExperiment, "_retry_journal", broken)
    with api_of(small_study(tmp_path)) as api:
        told = api.begin().json()
        assert api.put(told, 0, answer("consent")).status_code == 503
        assert "records are not saved any more; start the server again" in caplog.text


def wait_until(condition, seconds=30.0):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_an_unforeseen_error_says_nothing_of_its_cause(api, monkeypatch):
    told = api.begin().json()
    monkeypatch.setattr(api.storage, "save", lambda records: 1 / 0)
    said = api.put(told, 0, answer("consent"))
    assert (said.status_code, said.json()) == (500, {"error": "the server failed"})


def test_every_answer_has_the_headers_that_keep_strangers_out(api):
    for path in ("/", "/nothing", "/media/x.png", "/admin"):
        headers = api.client.get(path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "set-cookie" not in headers


def test_the_page_fetches_nothing_from_elsewhere(api):
    page = api.client.get("/").text
    assert "Where will the liquid go?" in page
    assert "@" not in page.replace("@context", "")
    assert "http" not in page


def test_admin_needs_its_token_and_shows_what_people_wrote_as_text(api):
    told = api.begin().json()
    api.run(told)
    assert api.client.get("/admin").status_code == 404
    assert api.client.get("/admin?token=guess").status_code == 404
    token = api.storage.admin_token
    page = api.client.get(f"/admin?token={token}").text
    assert "=1+1 &lt;b&gt;fine&lt;/b&gt;" in page
    assert "<b>fine" not in page
    assert page.count("<figure>") == 6
    table = api.client.get(f"/admin/participants.csv?token={token}").text
    assert "'=1+1 <b>fine</b>" in table
    assert len(api.client.get(f"/admin/trials.csv?token={token}").text.splitlines()) == 8


def test_admin_is_not_there_where_it_is_off(tmp_path):
    from starlette.testclient import TestClient

    from pourcast.experiment.server.app import create_app
    from pourcast.experiment.server.live_experiment import LiveExperiment
    from pourcast.experiment.storage.storage import Storage

    study = small_study(tmp_path)
    experiment = LiveExperiment(study, Storage.of_study(study))
    with TestClient(create_app(experiment)) as client:
        token = experiment.storage.admin_token
        assert client.get(f"/admin?token={token}").status_code == 404
    experiment.close()


def test_who_began_before_the_design_was_changed_gets_what_was_planned(tmp_path):
    study = small_study(tmp_path)
    with api_of(study) as api:
        told = api.begin().json()
    (study / "experiment.toml").write_text('groups = [["honey"]]\npractice = 0\n')
    with api_of(study) as api:
        names = {step[what] for step in told["steps"] for what in ("still", "film") if what in step}
        assert len(names) == 8
        assert {api.client.get(f"/media/{name}").status_code for name in names} == {200}
        assert api.run(told)["missing"] == []
        other = api.begin("request-2").json()
        assert {step["kind"] for step in other["steps"]}.isdisjoint({"film"})


def test_a_server_that_starts_again_knows_everybody(tmp_path):
    study = small_study(tmp_path, design=EXP2)
    with api_of(study) as api:
        told = api.begin().json()
        api.put(told, 0, answer("consent"))
    journal = study / "responses.jsonl"
    # A crash between the commit and the journal.
    journal.write_text(journal.read_text().splitlines(keepends=True)[0])
    with api_of(study) as api:
        assert lines(api) == [(1, -1), (1, 0)]
        assert api.post(told, "resume", tab="tab-00000002").json()["done"] == [0]
        assert api.run(told)["missing"] == []
