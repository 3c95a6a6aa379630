"""No number, key or token is ever two people's, and a dead token opens nothing: asked each time."""

import subprocess
import sys
import threading

import pytest

from pourcast.experiment.data.withdrawal import withdraw
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.records import SaveResult
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import api_of, fresh_database
from tests.experiment.make import answer, small_study
from tests.experiment.server_process import Asker, ServerProcess
from tests.experiment.test_storage import begin, record


def test_a_number_that_was_deleted_is_never_anothers(storage, database):
    numbers, keys, tokens = [], set(), set()
    for k in range(6):
        session, token, _ = begin(storage, f"request-{k}")
        numbers.append(session.number)
        keys.add(session.key)
        tokens.add(token)
        storage.delete([session.number])
    again = Storage(database)
    numbers.append(begin(again, "request-6")[0].number)
    again.close()
    assert numbers == sorted(set(numbers))
    assert len(keys) == len(tokens) == 6
    assert [storage.session_of(token) for token in tokens] == [None] * 6


def test_a_record_is_saved_only_if_its_token_is_the_sessions_at_that_moment(storage):
    (one, token, _), (other, others, _) = begin(storage, "request-1"), begin(storage, "request-2")
    assert storage.save(
        [
            record(one, 0, token=token),
            record(one, 1, token=others),
            record(other, 0, token=token),
            record(other, 1, token="x" * 43),
            record(other, 2, token=others),
        ]
    ) == [SaveResult(status) for status in ("new", "gone", "gone", "gone", "new")]
    assert [(r.session, r.seq) for r in storage.records()] == [(one.number, 0), (other.number, 2)]
    # What is refused is no sign of life of the session either.
    storage.save([record(one, 1, token=others, received=9000.0)])
    assert [one.last_seen for one in storage.sessions()] == [200.0, 200.0]
    storage.delete([one.number])
    saved = storage.save([record(one, 0, token=token), record(other, 3, token=others)])
    assert saved == [SaveResult("gone"), SaveResult("new")]


def test_who_is_deleted_while_records_come_is_gone_for_good(storage, database):
    """Ten people answer as fast as they can, and are deleted by another process's connection."""
    people = [begin(storage, f"request-{k}", now=float(k)) for k in range(10)]
    # Steps that there are not, and so enough of them; the database doesn't ask.
    done, errors = threading.Event(), []
    answered = {session.number: [] for session, _, _ in people}

    def answer_all():
        seq = 0
        try:
            while not done.is_set():
                batch = [record(one, seq, token=token) for one, token, _ in people]
                for one, result in zip(batch, storage.save(batch), strict=True):
                    answered[one.session].append(result.status)
                seq += 1
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=answer_all)
    thread.start()
    other = Storage(database)
    for session, _, _ in people[:9]:
        other.delete([session.number])
    other.close()
    done.set()
    thread.join()
    assert errors == []
    left = people[9][0].number
    assert {r.session for r in storage.records()} == {left}
    assert len(storage.records()) == len(answered[left])
    assert set(answered.pop(left)) == {"new"}
    for statuses in answered.values():
        assert statuses == sorted(statuses, reverse=True)  # new, and from some moment on gone


def test_who_withdraws_while_the_server_runs_is_gone_from_the_next_post_on(tmp_path):
    study = small_study(tmp_path)
    with api_of(study) as api:
        told = api.begin("request-1").json()
        for seq in range(3):  # the server knows the token well
            api.put(told, seq, answer(told["steps"][seq]["kind"]))
        storage = Storage.of_study(study)
        withdraw(study, storage, Journal.of_study(study), told["participant"])
        storage.close()
        other = api.begin("request-2").json()
        for said in (
            api.put(told, 3, answer("judgment")),
            api.put(told, 0, answer("consent")),
            api.post(told, "resume", tab="tab-00000001"),
            api.post(told, "finish", state="complete"),
            api.post(told, "finish", state="screened_out"),
        ):
            assert (said.status_code, said.json()["refused"]) == (401, "gone")
        assert api.post(told, "finish", state="declined").json()["missing"] == []
        assert api.storage.records() == []
        assert api.post(other, "resume", tab="tab-00000001").json()["done"] == []
        assert api.run(other)["missing"] == []
        (session,) = api.storage.sessions()
        assert (session.key, session.state) == (other["key"], "complete")
        assert told["key"] not in (study / "responses.jsonl").read_text()


def test_five_who_decline_and_five_who_complete(tmp_path):
    """As it was found: the old posts, repeated, deleted those who came later."""
    with api_of(small_study(tmp_path)) as api:
        declined = [api.begin(f"request-{k}").json() for k in range(5)]
        for told in declined:
            api.post(told, "finish", state="declined")
        complete = [api.begin(f"request-{k}").json() for k in range(5, 10)]
        for told in complete:
            assert api.run(told)["missing"] == []
        for told in declined:
            assert api.post(told, "finish", state="declined").status_code == 200
            assert api.put(told, 0, answer("consent")).status_code == 401
        assert [one.state for one in api.storage.sessions()] == ["complete"] * 5
        keys = {line.get("session") for line in api.experiment.journal.lines()} - {None}
        assert keys == {told["key"] for told in complete}
        numbers = [one.number for one in api.storage.sessions()]
        assert min(numbers) > 5


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_withdrawal_by_the_command_while_a_real_server_runs(tmp_path, request, kind):
    study = small_study(tmp_path)
    if kind == "sqlite":
        _withdraw_while_serving(study)
        return
    with fresh_database(request.getfixturevalue("postgresql")) as url:
        _withdraw_while_serving(study, "--database", url)


def _withdraw_while_serving(study, *options):
    with ServerProcess(study, *options) as server:
        page = Asker(server)
        told, other = page.begin("request-1"), page.begin("request-2")
        for someone in (told, other):
            assert page.put(someone, 0, answer("consent"))[0] == 200
        subprocess.run(
            [sys.executable, "-m", "pourcast", "experiment", "data", study,
             "--withdraw", told["participant"], *options],
            check=True, capture_output=True,
        )  # fmt: skip
        newer = page.begin("request-3")
        assert page.put(told, 1, answer("check"))[0] == 401
        assert page.resume(told)[0] == 401
        assert page.finish(told, "complete")[0] == 401
        assert page.resume(newer)[1]["done"] == []
        assert page.resume(other)[1]["done"] == [0]
        # And a server that starts again knows no more of it.
        server.kill()
        server.start()
        assert page.put(told, 1, answer("check"))[0] == 401
        assert page.put(newer, 0, answer("consent"))[1]["saved"] == "new"
