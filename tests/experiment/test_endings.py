"""What a participant's page can end, and what it can't; who declines leaves nothing behind."""

import signal
import subprocess

import pytest

from pourcast import cli
from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage, study_storage
from tests.experiment.conftest import api_of
from tests.experiment.make import EXP1, answer, small_study
from tests.experiment.server_process import Asker, ServerProcess
from tests.experiment.test_storage import begin, record

ENDS = ("complete", "declined", "screened_out", "failed_check")
OTHER = "tab-00000002"
NAME = "5f0VERYSECRETNAME"
LINK = {"PROLIFIC_PID": NAME, "STUDY_ID": "s", "SESSION_ID": "t"}


def states(api):
    return [one.state for one in api.storage.sessions()]


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("tab", ["tab-00000001", OTHER])
def test_a_complete_session_stays_whatever_a_page_says(tmp_path, end, tab):
    codes = '[recruiting]\ncomplete = "DONE1"\nscreened_out = "OUT1"\nfailed_check = "FAIL1"\n'
    with api_of(small_study(tmp_path, design=EXP1 + codes)) as api:
        told = api.begin(link=LINK).json()
        first = api.run(told)
        records, lines = api.storage.records(), list(api.experiment.journal.lines())
        said = api.post(told, "finish", state=end, tab=tab)
        state = {} if end == "complete" else {"state": "complete"}
        assert (said.status_code, said.json()) == (200, first | state)
        assert said.json()["code"] == "DONE1"
        assert states(api) == ["complete"]
        assert api.storage.records() == records
        assert list(api.experiment.journal.lines()) == lines


@pytest.mark.parametrize("end", ENDS[1:])
def test_a_tab_that_has_not_the_session_ends_nothing_and_is_told(api, end):
    told = api.begin().json()
    said = api.post(told, "finish", state=end, tab=OTHER)
    assert said.json() == {"missing": [], "state": "open", "code": "", "redirect": ""}
    api.post(told, "resume", tab=OTHER)
    assert api.post(told, "finish", state=end).json()["state"] == "open"
    assert states(api) == ["open"]


def test_a_page_of_before_that_says_no_tab_can_only_be_complete(api):
    told = api.begin().json()
    for end in ENDS[1:]:
        said = api.client.post(
            "/api/session/finish",
            json={"state": end},
            headers={"Authorization": f"Bearer {told['token']}"},
        )
        assert said.json()["state"] == "open"
    assert states(api) == ["open"]


def test_a_session_is_complete_whichever_tab_says_so(api):
    told = api.begin().json()
    for step in told["steps"]:
        api.put(told, step["seq"], answer(step["kind"]))
    api.post(told, "resume", tab=OTHER)
    assert api.post(told, "finish", state="complete").json() == {
        "missing": [], "code": "", "redirect": "",
    }  # fmt: skip
    assert states(api) == ["complete"]


@pytest.mark.parametrize("end", ["screened_out", "failed_check"])
def test_the_same_end_again_is_answered_the_same_and_another_one_with_the_first(tmp_path, end):
    codes = '[recruiting]\nscreened_out = "OUT1"\nfailed_check = "FAIL1"\n'
    with api_of(small_study(tmp_path, design=EXP1 + codes)) as api:
        told = api.begin(link=LINK).json()
        first, again = (api.post(told, "finish", state=end).json() for _ in range(2))
        assert first == again == {"missing": [], "code": first["code"], "redirect": ""}
        assert first["code"] in ("OUT1", "FAIL1")
        for other in set(ENDS) - {end}:
            assert api.post(told, "finish", state=other).json() == first | {"state": end}
        assert states(api) == [end]


def test_who_declines_after_having_agreed_keeps_what_was_given_and_the_researcher_is_told(
    tmp_path, capsys
):
    study = small_study(tmp_path)
    with api_of(study) as api:
        told = api.begin(link=LINK).json()
        api.put(told, 0, answer("consent"))
        first, again = (api.post(told, "finish", state="declined").json() for _ in range(2))
        assert first == again == {
            "missing": [], "state": "declined_later", "code": "", "redirect": "",
        }  # fmt: skip
        assert states(api) == ["declined_later"]
        assert len(api.storage.records()) == 1
        _, *lines = api.experiment.journal.lines()
        assert [line.get("seq", line.get("state")) for line in lines] == [None, 0, "declined_later"]
        # The page has words for it.
        assert "is kept" in told["texts"]["stop"]["declined_later"]
        assert api.post(told, "resume").json()["state"] == "declined_later"
        warning = f"{told['participant']}: declined after they had agreed; what they gave before"
        assert warning in api.client.get(f"/admin?token={api.storage.admin_token}").text
    assert cli.run(["experiment", "status", str(study)]) == 0
    out = capsys.readouterr().out
    assert warning in out
    assert "declined_later" in out


def test_declined_sessions_give_their_places_back(api):
    place = api.begin().json()
    api.put(place, 0, answer("consent"))
    api.post(place, "finish", state="declined")
    api.begin("request-2")
    assert [one.place for one in api.storage.sessions()] == [0, 0]


def test_ends_are_the_same_in_both_databases(storage):
    session, token, _ = begin(storage, "r1")
    assert storage.finish("nonsense", "complete", session.tab) is None
    assert storage.finish(token, "complete", "").missing == (0, 1, 2, 3)
    assert storage.finish(token, "declined", OTHER).session.state == "open"
    storage.save([record(session)])
    assert storage.finish(token, "declined", session.tab).session.state == "declined_later"
    assert storage.finish(token, "complete", session.tab).session.state == "declined_later"
    other, second, _ = begin(storage, "r2")
    assert storage.finish(second, "declined", other.tab).session.state == "declined"
    third, token, _ = begin(storage, "r3")
    storage.save([record(third, k) for k in range(4)])
    assert storage.finish(token, "complete", "").session.state == "complete"
    assert storage.finish(token, "declined", third.tab).session.state == "complete"
    assert [one.state for one in storage.sessions()] == ["declined_later", "declined", "complete"]


def test_a_dropped_session_can_be_completed(api):
    told = api.begin().json()
    api.clock.now += 7201.0
    api.begin("request-2")
    assert states(api) == ["dropped", "open"]
    assert api.run(told)["missing"] == []
    assert states(api) == ["complete", "open"]


def left_of(study):
    """Files of a study in which somebody's name stands."""
    # In a process of its own: closing its file would take SQLite's locks off it.
    found = subprocess.run(
        ["grep", "-rlF", NAME, study], check=False, capture_output=True, text=True
    )
    return found.stdout.split()


def test_who_declines_is_nowhere_in_the_study_while_it_is_served(tmp_path):
    study = small_study(tmp_path)
    with api_of(study) as api:
        others = [api.begin(f"request-{k}").json() for k in range(3)]
        told = api.begin("request-9", link=LINK).json()
        assert len(left_of(study)) == 2
        api.put(others[0], 0, answer("consent"))
        api.post(told, "finish", state="declined")
        assert left_of(study) == []
        api.put(others[1], 0, answer("consent"))
        assert left_of(study) == []


KILLED = """
import os, signal, sys
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage
owner, _, method = sys.argv.pop(1).partition(".")
kind = {"Journal": Journal, "Storage": Storage}[owner]
at_start = iter([getattr(kind, method)] if method == "forget_log" else [])
kill = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
setattr(kind, method, lambda *arguments, **_: next(at_start, kill)(*arguments))
from pourcast.cli import main
main()
"""
"""The server, that is killed as it comes to a method."""


HALF_WAY = ["Journal.remove", "Storage.delete", "Storage.forget_log"]


@pytest.mark.parametrize("method", HALF_WAY)
def test_who_declined_leaves_nothing_behind_if_something_fails_half_way(
    tmp_path, method, monkeypatch
):
    study = small_study(tmp_path)
    owner, _, name = method.partition(".")
    with api_of(study) as api:
        other, told = api.begin("request-1").json(), api.begin("request-2", link=LINK).json()
        api.put(other, 0, answer("consent"))
        with monkeypatch.context() as patched:
            kind = {"Journal": Journal, "Storage": Storage}[owner]
            patched.setattr(kind, name, lambda *_, **__: 1 / 0)
            assert api.post(told, "finish", state="declined").status_code == 500
    with api_of(study) as api:
        assert left_of(study) == []
        assert api.post(told, "finish", state="declined").json() == {
            "missing": [], "code": "", "redirect": "",
        }  # fmt: skip
        assert api.put(told, 0, answer("consent")).status_code == 401
        assert api.put(other, 0, answer("consent")).json()["saved"] == "repeated"
        assert len(api.storage.sessions()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("method", HALF_WAY)
def test_who_declined_leaves_nothing_behind_if_the_server_is_killed_then(tmp_path, method):
    study = small_study(tmp_path)
    with ServerProcess(study, run=("-c", KILLED, method)) as server:
        page = Asker(server)
        told = page.begin("request-1", link=LINK)
        other = page.begin("request-2")
        page.put(other, 0, answer("consent"))
        with pytest.raises(OSError):  # noqa: PT011 - of whichever kind
            page.finish(told, "declined")
        assert server.process.wait(10) == -signal.SIGKILL
        server.process.stdout.close()
    with ServerProcess(study) as server:
        assert left_of(study) == []
        page = Asker(server)
        # As the page asks again that got no answer; what was someone else's is there.
        assert page.finish(told, "declined") == (
            200, {"missing": [], "code": "", "redirect": ""},
        )  # fmt: skip
        assert page.put(told, 0, answer("consent"))[0] == 401
        assert page.put(other, 0, answer("consent")) == (
            200, {"saved": "repeated", "superseded": False},
        )  # fmt: skip
    with study_storage(study, None) as storage:
        assert len(storage.sessions()) == 1
        assert study_overview(study, storage, 0.0).missing_in_journal == 0
