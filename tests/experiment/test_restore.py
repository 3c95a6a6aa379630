"""The journal alone is enough: the database is deleted, and nothing is lost, doubled or mixed."""

import json
import random
import shutil
import subprocess
import sys
import threading
from contextlib import contextmanager, nullcontext

import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings, strategies
from starlette.testclient import TestClient

from pourcast import cli
from pourcast.experiment.data.old_journal import is_old_line
from pourcast.experiment.data.overview import study_overview
from pourcast.experiment.data.record_import import import_records, restore
from pourcast.experiment.data.responses import _collected as collected_responses
from pourcast.experiment.data.tables import participants_table, trials_table
from pourcast.experiment.data.withdrawal import withdraw
from pourcast.experiment.design.links import link_key
from pourcast.experiment.server.app import create_app
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import Api, Clock, fresh_database
from tests.experiment.make import EXP1, answer, judgment, small_study

TAB = "tab-00000001"


def call(*arguments):
    return cli.run(["experiment", *map(str, arguments)])


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    """A study to be copied."""
    return small_study(tmp_path_factory.mktemp("template"), design=EXP1 + "places = 100\n")


@pytest.fixture
def study(template, tmp_path):
    return shutil.copytree(template, tmp_path / "study")


@contextmanager
def server(study, url=None, clock=None):
    """A study's server, behind its API; the same people may come to it again later."""
    clock = clock or Clock()
    experiment = LiveExperiment(study, Storage.of_study(study, url), clock=clock)
    with TestClient(create_app(experiment), raise_server_exceptions=False) as client:
        yield Api(client, experiment, clock)
    experiment.close()


def delete_database(study):
    """What a wrong click deletes."""
    for path in study.glob("responses.sqlite*"):
        path.unlink()


def everything(study, url=None, now=1_700_000_500.0):
    """All that a researcher sees of a study, whoever reads it."""
    storage = Storage.of_study(study, url)
    try:
        shown = study_overview(study, storage, now)
        return {
            "trials": trials_table(storage).to_csv(),
            "people": participants_table(storage, identifiers=True, preview=True).to_csv(),
            "overview": shown.for_json(),
            "warnings": shown.warnings,
            "aside": [(one.session, one.seq, one.body) for one in storage.conflicts()],
            "words": storage.words,
            "sessions": storage.sessions(),
        }
    finally:
        storage.close()


def same(one, other):
    """Whether two looks at a study show the same; when open sessions were heard of may differ."""
    assert list(map(lasting, one["sessions"])) == list(map(lasting, other["sessions"]))
    rest = [
        {name: look for name, look in all_of.items() if name != "sessions"}
        for all_of in (one, other)
    ]
    assert rest[0] == rest[1]
    return True


def lasting(session):
    return {
        name: value for name, value in vars(session).items() if name not in ("last_seen", "tab")
    }


def collect(api):
    """People of all kinds; returns the open tab of one who is half-way."""
    api.run(api.begin("request-1", tab="tab-00000001").json())
    link = {"PROLIFIC_PID": "person-5f0", "STUDY_ID": "st", "SESSION_ID": "se"}
    half = api.begin("request-2", link=link).json()
    # Another browser with the same id, for a moment.
    api.begin("request-22", tab="tab-00000022", link=link)
    api.post(half, "resume", tab=TAB)
    for step in half["steps"][:8]:
        api.put(half, step["seq"], answer(step["kind"], 0.75))
    api.put(half, 3, judgment(0.1))
    api.put(half, 3, judgment(0.2))
    declined = api.begin("request-3").json()
    api.post(declined, "finish", state="declined", tab=TAB)
    small = api.begin("request-4").json()
    api.put(small, 0, answer("consent"))
    api.post(small, "finish", state="screened_out", tab=TAB)
    api.run(api.begin("request-5", link={"preview": key_of(api, "preview")}).json())
    return half


def key_of(api, entry):
    return link_key(api.storage.secret, entry)


# Restoring -------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["server", "command"])
def test_a_database_that_was_deleted_is_restored_from_the_journal(study, way, caplog, capsys):
    with server(study) as api:
        half = collect(api)
        links = (
            key_of(api, "lab"),
            api.storage.admin_token,
            sorted(api.experiment.materials.published),
        )
    before = everything(study)
    assert before["overview"]["missing_in_journal"] == 0
    journal = (study / "responses.jsonl").read_bytes()
    delete_database(study)
    if way == "server":
        with server(study) as api:
            pass
        assert (
            "responses.jsonl: had 4 sessions and 37 records that the database lacked; they are "
            "restored" in caplog.text
        )
    else:
        assert call("data", study, "--import", study / "responses.jsonl") == 0
        assert "4 sessions (4 of them new), 37 new records" in capsys.readouterr().out
        assert call("data", study, "--import", study / "responses.jsonl") == 0
        assert "nothing has changed" in capsys.readouterr().out
    assert same(everything(study), before)
    assert (study / "responses.jsonl").read_bytes() == journal
    with server(study) as api:
        # Links that were given away, names of media and the admin's word are the same ones.
        assert links == (
            key_of(api, "lab"), api.storage.admin_token, sorted(api.experiment.materials.published)
        )  # fmt: skip
        # The tab that is still open goes on, and no other is said to have the session.
        said = api.put(half, 8, judgment(0.3)).json()
        assert said == {"saved": "new", "superseded": False}
        assert api.put(half, 5, judgment(0.75)).json()["saved"] == "repeated"
        assert api.post(half, "resume").json()["code"] == half["code"]
        # A request that is made again gets the same session, and numbers go on.
        assert api.begin("request-1").json()["key"] == before_key(study, 1)
        assert api.begin("request-9").status_code == 201
        assert [one.number for one in api.storage.sessions()] == [1, 2, 4, 5, 6]


def before_key(study, number):
    storage = Storage.of_study(study)
    try:
        return next(one.key for one in storage.sessions() if one.number == number)
    finally:
        storage.close()


def test_postgresql_is_restored_from_sqlites_journal_and_numbers_go_on(study, postgresql):
    with server(study) as api:
        half = collect(api)
    before = everything(study)
    with fresh_database(postgresql) as url, server(study, url) as api:
        assert same(everything(study, url), before)
        assert api.put(half, 8, judgment(0.3)).json()["saved"] == "new"
        assert [api.begin(f"r-{k}-xxxx").status_code for k in range(3)] == [201] * 3
        assert [one.number for one in api.storage.sessions()] == [1, 2, 4, 5, 6, 7, 8]


def test_a_database_from_a_backup_gets_what_came_since(study, tmp_path):
    with server(study) as api:
        half = collect(api)
    shutil.copy(study / "responses.sqlite", tmp_path / "backup")
    with server(study) as api:
        for step in half["steps"][8:]:
            api.put(half, step["seq"], answer(step["kind"], 0.4))
        assert api.post(half, "finish", state="complete", tab=TAB).json()["missing"] == []
        api.run(api.begin("request-7").json())
        token = api.begin("request-8").json()
    before = everything(study)
    delete_database(study)
    shutil.copy(tmp_path / "backup", study / "responses.sqlite")
    with server(study) as api:
        assert same(everything(study), before)
        assert api.put(token, 0, answer("consent")).json() == {"saved": "new", "superseded": False}


def test_who_withdrew_does_not_come_back(study, capsys):
    with server(study) as api:
        collect(api)
    assert call("data", study, "--withdraw", "person-5f0") == 0
    before = everything(study)
    delete_database(study)
    with server(study):
        pass
    assert same(everything(study), before)
    assert "person-5f0" not in (study / "responses.jsonl").read_text()


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_number_of_who_withdrew_is_nobody_elses_in_a_new_database(study, kind, request):
    """Nor that of who withdrew, or declined, last."""
    with server(study) as api:
        collect(api)
        last = api.begin("request-last", link={"lab": link_key(api.storage.secret, "lab")}).json()
        declines = api.begin(
            "request-more", link={"lab": link_key(api.storage.secret, "lab")}
        ).json()
        numbers = [one.number for one in api.storage.sessions()]
        api.post(declines, "finish", state="declined")
    assert call("data", study, "--withdraw", last["participant"]) == 0
    with Storage.of_study(study).engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT max(id) FROM sessions").scalar() < numbers[-2]
    delete_database(study)
    new = None if kind == "sqlite" else fresh_database(request.getfixturevalue("postgresql"))
    with new or nullcontext() as url, server(study, url) as api:
        api.begin("request-new")
        assert max(one.number for one in api.storage.sessions()) == numbers[-1] + 1


@pytest.mark.parametrize("command", ["status", "data"])
def test_a_lost_database_is_told_of_with_the_command_that_restores_it(study, capsys, command):
    with server(study) as api:
        collect(api)
    delete_database(study)
    assert call(command, study) == 2
    said = capsys.readouterr().err
    journal = study / "responses.jsonl"
    assert f"responses.sqlite: not there; {journal} has its 4 sessions: restore them by" in said
    assert f"`pourcast experiment data {study} --import {journal}`" in said
    assert said.count("\n") == 1
    assert cli.run(["compare", str(study), "-m", "gravity"]) == 2
    assert f"{journal} has its 4 sessions: restore them by" in capsys.readouterr().err


def test_a_participants_file_finds_its_session_in_a_lost_database(study, tmp_path, capsys):
    with server(study) as api:
        half = collect(api)
    delete_database(study)
    path = tmp_path / "answers.jsonl"
    lines = [{"format": "pourcast-records", "session": half["key"]}]
    lines += [
        {"session": half["key"], "seq": step["seq"], "body": answer(step["kind"], 0.75)}
        for step in half["steps"]
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert call("data", study, "--import", path) == 0
    said = capsys.readouterr().out
    assert "responses.jsonl: 4 sessions are restored" in said
    assert "1 sessions (0 of them new), 6 new records, 8 that were there" in said


def test_the_studys_own_journal_is_not_doubled_while_the_server_runs(study):
    with server(study) as api:
        half = collect(api)
        before = (study / "responses.jsonl").read_bytes()
        storage = Storage.of_study(study)
        journal = Journal.of_study(study)
        summary = import_records(journal.path, storage, journal, None, 5.0)
        storage.close()
        assert not summary.changes
        assert summary.left_out == 0
        assert (study / "responses.jsonl").read_bytes() == before
        api.put(half, 8, judgment(0.3))
    assert everything(study)["overview"]["missing_in_journal"] == 0


# Several losses in one study's life ---------------------------------------------------------


class Life:
    """A study over weeks: people come, answer, leave, withdraw; the database gets lost.

    What each of them was told is saved is what must be in the tables, whoever reads them.
    """

    def __init__(self, study, seed):
        self.study, self.random, self.clock = study, random.Random(seed), Clock()
        self.people, self.told, self.answers = 0, {}, {}

    def week(self, comers, actions):
        with server(self.study, clock=self.clock) as api:
            for _ in range(comers):
                self.come(api)
            for _ in range(actions):
                self.clock.now += self.random.uniform(0.1, 5.0)
                self.random.choice((self.answer, self.answer, self.answer, self.repeat))(api)

    def come(self, api):
        self.people += 1
        link = {"PROLIFIC_PID": f"pid{self.people:04}x", "SESSION_ID": "s", "STUDY_ID": "t"}
        told = api.begin(f"request-{self.people}", tab=f"tab-of-{self.people:05}", link=link).json()
        self.told[link["PROLIFIC_PID"]] = told | {"tab": f"tab-of-{self.people:05}"}
        self.answers[link["PROLIFIC_PID"]] = {}

    def answer(self, api, who=None):
        open_ones = [one for one in self.told if len(self.answers[one]) < self.steps(one)]
        if not open_ones:
            return
        who = who or self.random.choice(open_ones)
        told, done = self.told[who], self.answers[who]
        step = told["steps"][len(done)]
        response = round(self.random.random(), 6)
        said = api.put(told, step["seq"], answer(step["kind"], response), tab=told["tab"])
        assert said.json() == {"saved": "new", "superseded": False}
        done[step["seq"]] = response
        if len(done) == self.steps(who):
            said = api.post(told, "finish", state="complete", tab=told["tab"])
            assert said.json()["missing"] == []

    def repeat(self, api):
        who = self.random.choice(list(self.told))
        told, done = self.told[who], self.answers[who]
        if done:
            seq = self.random.choice(list(done))
            body = answer(told["steps"][seq]["kind"], done[seq])
            assert api.put(told, seq, body, tab=told["tab"]).json()["saved"] == "repeated"

    def steps(self, who):
        return len(self.told[who]["steps"])

    def withdraw(self):
        who = self.random.choice(list(self.told))
        storage = Storage.of_study(self.study)
        withdraw(self.study, storage, Journal.of_study(self.study), who)
        storage.close()
        del self.told[who], self.answers[who]

    def lose(self):
        delete_database(self.study)

    def check(self):
        """Everybody's judgments are theirs, each once; nobody else's are there."""
        storage = Storage.of_study(self.study)
        try:
            trials = trials_table(storage)
            people = participants_table(storage, identifiers=True)
        finally:
            storage.close()
        found = people.filter(like="PROLIFIC_PID").iloc[:, 0]
        assert sorted(found) == sorted(self.told)
        numbers = dict(zip(found, people["session"], strict=True))
        judged = 0
        for who, done in self.answers.items():
            steps = [one for one in self.told[who]["steps"] if one["kind"] == "judgment"]
            expected = [done[one["seq"]] for one in steps if one["seq"] in done]
            own = trials[trials["session"] == numbers[who]]
            assert own["response"].tolist() == expected
            judged += len(expected)
        assert len(trials) == judged
        complete = {one for one in self.told if len(self.answers[one]) == self.steps(one)}
        assert set(found[people["state"] == "complete"]) == complete
        return judged


def test_several_losses_in_one_studys_life(study):
    life = Life(study, seed=3)
    for _ in range(3):
        life.week(comers=3, actions=40)
        before = everything(study)
        life.lose()
        with server(study, clock=life.clock):
            assert same(everything(study), before)
        life.check()
        life.withdraw()
        life.check()
    assert life.check() > 20


@pytest.mark.parametrize(
    ("losses", "actions", "least"),
    [
        pytest.param(3, 400, 300, marks=pytest.mark.slow),
        pytest.param(5, 1400, 1000, marks=pytest.mark.study),
    ],
)
def test_hundreds_of_records_of_twenty_people_survive_several_losses(
    tmp_path, losses, actions, least
):
    study = small_study(tmp_path / "s", scenes=40, design=EXP1 + "places = 100\n")
    life = Life(study, 0)
    records = 0
    for number in range(losses):
        life.week(comers=20 if number == 0 else 3, actions=actions if number == 0 else 250)
        records += sum(map(len, life.answers.values()))
        before = everything(study)
        life.lose()
        if number % 2:
            assert call("data", study, "--import", study / "responses.jsonl") == 0
        else:
            with server(study, clock=life.clock):
                pass
        assert same(everything(study), before)
        life.check()
        life.withdraw()
        life.lose()
        with server(study, clock=life.clock):
            life.check()
    assert records > least


# Journals of the older form ------------------------------------------------------------------


def old_lines(storage, numbers=None):
    """A journal as it was written before lines named sessions by key."""
    lines = []
    for session in storage.sessions():
        body = {
            "participant": session.participant, "entry": session.entry, "group": session.group,
            "place": session.place, "identifiers": dict(session.identifiers),
        }  # fmt: skip
        lines.append((session.number, -1, "session", body, session.started))
    lines += [
        (one.session, one.seq, one.kind, json.loads(one.body), one.received)
        for one in storage.records()
    ]
    names = ("session", "seq", "kind", "body", "received")
    return "".join(json.dumps(dict(zip(names, line, strict=True))) + "\n" for line in lines)


def test_a_journal_of_the_older_form_is_brought_to_the_new_one(study):
    with server(study) as api:
        collect(api)
    before = everything(study)
    storage = Storage.of_study(study)
    old = old_lines(storage)
    storage.close()
    journal = study / "responses.jsonl"
    journal.write_text(old[:100] + "\n" + old)
    with server(study):
        pass
    assert same(everything(study), before)
    texts = journal.read_text().split("\n")
    assert json.loads(texts[0])["format"] == "pourcast-journal"
    # What could not be read is still there; all else is of the new form, and enough.
    assert old[:100] in texts
    assert sum('"session":1,' in text or '"session": 1,' in text for text in texts) == 1
    delete_database(study)
    with server(study):
        pass
    assert same(everything(study), before)


def test_an_older_journal_of_two_databases_is_taken_in_with_both(study):
    """Numbers began again at 1 when the database was lost; a line that opens tells them apart."""
    with server(study) as api:
        collect(api)
        storage = api.storage
        first, trials = old_lines(storage), trials_table(storage)
    for path in (*study.glob("responses.sqlite*"), study / "responses.jsonl"):
        path.unlink()
    clock = Clock(1_700_009_000.0)
    with server(study, clock=clock) as api:
        api.run(api.begin("request-1").json(), lambda seq: 0.9)
        second, more = old_lines(api.storage), trials_table(api.storage)
    (study / "responses.jsonl").write_text(first + second)
    with server(study, clock=clock) as api:
        found = trials_table(api.storage)
        assert len(api.storage.sessions()) == 5
    columns = ["entry", "scene", "liquid", "mirrored", "response", "received"]
    expected = pd.concat([trials, more])[columns].sort_values(columns).reset_index(drop=True)
    pd.testing.assert_frame_equal(
        found[columns].sort_values(columns).reset_index(drop=True), expected
    )


# Damage ---------------------------------------------------------------------------------------


def test_a_line_that_is_damaged_stays_through_all_of_it(study, caplog):
    """Nobody knows yet whose it is, and what it may be good for."""
    with server(study) as api:
        collect(api)
        key = api.storage.sessions()[0].key
    journal = study / "responses.jsonl"
    lines = journal.read_bytes().split(b"\n")
    damaged = lines[3][: len(lines[3]) // 2]
    journal.write_bytes(b"\n".join([*lines[:3], damaged, b"\xff\x00 rubbish", *lines[4:]]))
    before = everything(study)
    assert before["overview"]["missing_in_journal"] == 1
    with server(study):
        assert "2 lines can't be read, such as one that a crash cut short; they stay" in caplog.text
    assert call("data", study, "--withdraw", "person-5f0") == 0
    left = journal.read_bytes().split(b"\n")
    assert damaged in left
    assert b"\xff\x00 rubbish" in left
    # Of one who withdraws even what can't be read goes.
    assert key.encode() in damaged
    storage = Storage.of_study(study)
    participant = storage.sessions()[0].participant
    storage.close()
    assert call("data", study, "--withdraw", participant) == 0
    assert key.encode() not in journal.read_bytes()
    assert b"\xff\x00 rubbish" in journal.read_bytes()


def test_a_line_that_fits_nothing_is_told_of_at_the_start_and_in_status(study, caplog, capsys):
    with server(study) as api:
        collect(api)
        key = api.storage.sessions()[0].key
    with (study / "responses.jsonl").open("a") as journal:
        for line in ({"session": "k" * 32}, {"session": key}):
            journal.write(json.dumps(line | {"seq": 99, "body": {"rt": 1.0}}) + "\n")
    with server(study):
        assert "responses.jsonl: 2 lines could not be taken in, and stay as they are" in caplog.text
    capsys.readouterr()
    assert call("status", study) == 0
    said = capsys.readouterr().out
    assert (
        "2 records are in responses.jsonl alone, and not in the database; the server takes in"
        in said
    )
    assert call("data", study, "--import", study / "responses.jsonl") == 1
    assert "left out: seq: expected below" in capsys.readouterr().err


def test_without_its_opening_line_a_session_is_restored_from_its_records(study):
    with server(study) as api:
        collect(api)
        first = api.storage.sessions()[0]
        trials = trials_table(api.storage)
    journal = study / "responses.jsonl"
    lines = journal.read_text().split("\n")
    cut = [text for text in lines if f'"session":"{first.key}","number"' not in text]
    assert len(cut) == len(lines) - 1
    journal.write_text("\n".join(cut))
    delete_database(study)
    with server(study) as api:
        found = trials_table(api.storage)
        session = api.storage.session_with_key(first.key)
    assert (session.entry, session.group, session.place) == ("unknown", first.group, first.place)
    assert session.state == "complete"
    columns = ["phase", "block", "trial", "scene", "liquid", "mirrored", "response", "received"]
    pd.testing.assert_frame_equal(
        found[found["session"] == session.number][columns].reset_index(drop=True),
        trials[trials["session"] == first.number][columns].reset_index(drop=True),
    )


NAMES = [
    "format", "session", "seq", "kind", "body", "tokens", "token", "tab", "state", "browser", "steps",
    "secret", "aside", "received", "number", "group", "place", "identifiers", "x",
]  # fmt: skip

JSON = strategies.recursive(
    strategies.none() | strategies.booleans() | strategies.integers() | strategies.text(max_size=9),
    lambda inner: (
        strategies.lists(inner, max_size=3)
        | strategies.dictionaries(
            strategies.sampled_from(NAMES),
            inner | strategies.sampled_from(["pourcast-records", "pourcast-journal", "0123456789"]),
        )
    ),
    max_leaves=12,
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(lines=strategies.lists(JSON, min_size=1, max_size=8))
def test_no_line_whatever_it_says_stops_the_server_or_is_thrown_away(collected, lines):
    texts = [json.dumps(line) for line in lines]
    journal = collected / "responses.jsonl"
    whole = (collected / "whole").read_text()
    journal.write_text(whole + "\n".join(texts) + "\n")
    before = everything(collected)["trials"]
    storage = Storage.of_study(collected)
    try:
        restore(storage, Journal.of_study(collected), no_schedule, 5.0)
        storage.journal_lines()
    finally:
        storage.close()
    left = journal.read_text()
    lasting = [one for one in texts if not is_old_line(json.loads(one))]
    assert all(text in left for text in lasting)
    assert everything(collected)["trials"].startswith(before.rstrip("\n"))


def no_schedule(group, place):
    raise IndexError


@pytest.fixture(scope="module")
def collected(template, tmp_path_factory):
    """A study with answers, and a copy of its journal."""
    study = shutil.copytree(template, tmp_path_factory.mktemp("collected") / "study")
    with server(study) as api:
        collect(api)
    shutil.copy(study / "responses.jsonl", study / "whole")
    return study


def test_a_database_that_lacks_what_the_journal_has_is_told_of(study, tmp_path, capsys):
    with server(study) as api:
        collect(api)
    delete_database(study)
    # Something made a new one, which nobody has come to.
    Storage.of_study(study).close()
    assert call("status", study) == 0
    said = capsys.readouterr().out
    assert "records are in responses.jsonl alone, and not in the database; the server takes" in said
    with server(study):
        assert everything(study)["overview"]["missing_in_database"] == 0


# Others at the same time, odd folders, odd files ------------------------------------------


def test_who_withdraws_while_the_journal_is_read_is_not_restored(study, monkeypatch):
    with server(study) as api:
        api.run(api.begin(link={"PROLIFIC_PID": "person-5f0a", "STUDY_ID": "st"}).json())
        api.run(api.begin("request-2").json())
    storage = Storage.of_study(study)
    journal = Journal.of_study(study, storage.states)
    threads = []

    def meanwhile(texts):
        """The journal was read just now; another process takes somebody out of the study."""
        thread = threading.Thread(target=withdraw_in_another_process, args=(study, "person-5f0a"))
        threads.append(thread)
        thread.start()
        thread.join(6.0)
        return texts

    read = journal.read
    monkeypatch.setattr(
        journal, "read", lambda: read() if threads else meanwhile(read()), raising=True
    )
    restore(storage, journal, lambda *_: (), 5.0)
    threads[0].join()
    assert len(storage.sessions()) == 1
    storage.close()
    assert b"person-5f0a" not in (study / "responses.jsonl").read_bytes()


def withdraw_in_another_process(study, who):
    command = [sys.executable, "-m", "pourcast", "experiment", "data", str(study)]
    for _ in range(5):  # "lines cannot be taken out", while the others take long
        if not subprocess.run(
            [*command, "--withdraw", who], check=False, capture_output=True
        ).returncode:
            return


def test_a_session_that_another_command_restored_meanwhile_is_left_as_it_is(study, monkeypatch):
    with server(study) as api:
        api.run(api.begin().json())
    before = everything(study)
    delete_database(study)
    one, other = Storage.of_study(study), Storage.of_study(study)
    journal = Journal.of_study(study)
    # Both look for the session before either has it.
    look = Storage.session_with_key
    monkeypatch.setattr(
        Storage, "session_with_key",
        lambda storage, key: None if storage is other else look(storage, key),
    )  # fmt: skip
    for storage in (one, other):
        import_records(study / "responses.jsonl", storage, journal, lambda *_: (), 5.0)
        storage.close()
    monkeypatch.undo()
    same(before, everything(study))


@pytest.mark.parametrize("name", ["what?study", "50%20off", "a#b&c=d"])
def test_a_database_lies_in_its_folder_whatever_that_is_called(template, tmp_path, name):
    study = shutil.copytree(template, tmp_path / name)
    with server(study) as api:
        api.run(api.begin().json())
    assert (study / "responses.sqlite").is_file()
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert call("status", study) == 0
    assert len(collected_responses(study / "responses.sqlite")) == 6


@pytest.mark.parametrize("number", [2**31, 2**63 - 1, 2**63, 10**30, -1])
def test_a_number_that_no_database_has_stops_nobody(study, number, caplog):
    with server(study) as api:
        api.run(api.begin().json())
    journal = study / "responses.jsonl"
    journal.write_text(journal.read_text().replace('"number":1,', f'"number":{number},'))
    delete_database(study)
    with server(study) as api:
        assert api.begin("request-2").status_code == 201
        assert len(api.storage.records()) == 14
    assert "number: Input should be" in caplog.text


@pytest.mark.parametrize("lost", [False, True])
def test_another_studys_people_do_not_come_in_with_its_lines(
    study, template, tmp_path, caplog, lost
):
    other = shutil.copytree(template, tmp_path / "other")
    for one in (study, other):
        with server(one) as api:
            link = {"lab": key_of(api, "lab"), "participant": "1"}
            api.run(api.begin(f"request-{one.name}", link=link).json())
    with (study / "responses.jsonl").open("ab") as stream:
        stream.write((other / "responses.jsonl").read_bytes())
    if lost:
        delete_database(study)
    with server(study) as api:
        (own,) = api.storage.sessions()
        assert own.request == "request-study"
        api.run(api.begin("request-more", link={"lab": key_of(api, "lab")}).json())
    assert "a session of another study's database" in caplog.text
    # Who came after those lines is restored as all of ours are.
    delete_database(study)
    with server(study) as api:
        requests = [one.request for one in api.storage.sessions()]
        assert requests == ["request-study", "request-more"]
    # From a file beside, who saw the same scenes is taken in when it is wished.
    assert call("data", study, "--import", other / "responses.jsonl") == 1
    with Storage.of_study(study).engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT count(*) FROM sessions").scalar() == 3


def test_a_study_of_other_scenes_is_not_taken_in_from_its_journal(study, tmp_path, capsys):
    other = small_study(tmp_path / "other", scenes=9, design=EXP1)
    for one in (study, other):
        with server(one) as api:
            api.run(api.begin(f"request-{one.name}").json())
    before = everything(study)
    assert call("data", study, "--import", other / "responses.jsonl") == 1
    assert "another study's: this one has no scene" in capsys.readouterr().err
    assert same(everything(study), before)


def test_a_journal_saved_in_another_coding_is_read_as_far_as_it_can_be(study):
    with server(study) as api:
        api.run(api.begin().json())
    journal = study / "responses.jsonl"
    journal.write_bytes(journal.read_text().encode("utf-16"))
    delete_database(study)
    with server(study) as api:
        api.run(api.begin("request-2").json())
    before = everything(study)
    delete_database(study)
    with server(study):
        pass
    same(before | {"words": None}, everything(study) | {"words": None})


@pytest.mark.parametrize(
    "link", [{"PROLIFIC_PID": "person-5f0a", "STUDY_ID": "st"}, {"participant": "anna"}]
)
def test_a_journal_without_its_first_line_restores_people_and_open_tabs(study, link):
    def link_of(api):
        return link if "PROLIFIC_PID" in link else link | {"lab": key_of(api, "lab")}

    with server(study) as api:
        told = api.begin(link=link_of(api)).json()
        for seq in range(4):
            api.put(told, seq, answer(told["steps"][seq]["kind"]))
    journal = study / "responses.jsonl"
    journal.write_bytes(journal.read_bytes().split(b"\n", 1)[1])
    codes = set()
    for loss in range(3):
        delete_database(study)
        with server(study) as api:
            # The tab that is still open, and the same person by a link of now.
            assert (
                api.put(told, 4 + loss, answer(told["steps"][4 + loss]["kind"])).status_code == 200
            )
            assert api.begin(f"request-{loss}", link=link_of(api)).json()["done"][:4] == [
                0,
                1,
                2,
                3,
            ]
            codes |= {one.participant for one in api.storage.sessions()}
            assert len(api.storage.sessions()) == 1
    assert len(codes) == 1
