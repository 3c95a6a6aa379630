"""What is saved is saved once, in SQLite and in PostgreSQL, whatever comes twice."""

import sqlite3

import pytest
import sqlalchemy as sa

from pourcast.errors import InputError, StoreError
from pourcast.experiment.design.steps import Step
from pourcast.experiment.storage import database as database_module
from pourcast.experiment.storage.records import MAX_CONFLICTS, Record, SaveResult
from pourcast.experiment.storage.sessions import Arrival, Refusal
from pourcast.experiment.storage.storage import Storage, study_storage
from tests.experiment.make import arrival, small_study

STEPS = [Step(seq=k, kind="judgment", phase="test", trial=k + 1) for k in range(4)]


def begin(storage, request, now=100.0, groups=1, places=None, gap=1000.0, **who):
    someone = arrival(request, **who)
    return storage.begin(
        someone, lambda group, place: STEPS, groups=groups, places=places, largest_gap=gap, now=now
    )


def record(session, seq=0, body='{"response":0.5}', received=200.0, **changes):
    return Record(session.number, seq, "judgment", body, received, **changes)


def test_a_record_is_new_once_and_repeated_ever_after(storage):
    session, _, fresh = begin(storage, "request-a")
    assert fresh
    assert storage.save([record(session)]) == [SaveResult("new")]
    assert storage.save([record(session, received=300.0)]) == [SaveResult("repeated")]
    assert [(r.seq, r.body, r.received) for r in storage.records()] == [
        (0, '{"response":0.5}', 200.0)
    ]


def test_twins_in_one_batch_are_saved_once(storage):
    session, _, _ = begin(storage, "request-a")
    twins = [record(session), record(session), record(session, body='{"response":0.6}')]
    assert [one.status for one in storage.save(twins)] == ["new", "repeated", "conflict"]
    assert len(storage.records()) == 1


def test_another_body_under_one_key_is_kept_aside_and_the_first_stays(storage):
    session, _, _ = begin(storage, "request-a")
    storage.save([record(session)])
    for k in range(MAX_CONFLICTS + 5):
        saved = storage.save([record(session, body=f'{{"response":0.{k}1}}')])
        assert saved[0].status == "conflict"
    assert [r.body for r in storage.records()] == ['{"response":0.5}']
    assert len(storage.conflicts()) == MAX_CONFLICTS
    # The same one again is not a second one.
    storage.save([record(session, body='{"response":0.01}')] * 2)
    assert len(storage.conflicts()) == MAX_CONFLICTS


def test_records_of_a_session_that_is_gone_are_refused(storage):
    session, _, _ = begin(storage, "request-a")
    storage.delete([session.number])
    assert storage.save([record(session)]) == [SaveResult("gone")]
    assert storage.sessions() == []


def test_the_same_request_gets_the_same_session(storage):
    first, token, _ = begin(storage, "request-a")
    second, other, fresh = begin(storage, "request-a")
    assert first.number == second.number
    assert not fresh
    # Both tokens open it: a browser that never got the answer to its first request loses nothing.
    assert storage.session_of(token).number == storage.session_of(other).number == first.number
    assert storage.session_of("nonsense") is None


def test_groups_are_balanced_and_a_drop_outs_place_is_given_back(storage):
    places = [
        (s.group, s.place) for s, _, _ in (begin(storage, f"r{k}", groups=2) for k in range(4))
    ]
    assert places == [(0, 0), (1, 0), (0, 1), (1, 1)]
    storage.end(2, "complete")
    late, _, _ = begin(storage, "r4", groups=2, now=5000.0)
    states = [one.state for one in storage.sessions()]
    assert states == ["dropped", "complete", "dropped", "dropped", "open"]
    assert (late.group, late.place) == (0, 0)


def test_a_study_that_is_full_says_so_and_previews_take_no_place(storage):
    begin(storage, "r1", places=1)
    with pytest.raises(Refusal, match="full"):
        begin(storage, "r2", places=1)
    preview, _, _ = begin(storage, "r3", places=1, entry="preview")
    assert preview.place == 0


def test_a_platform_session_goes_on_and_a_second_one_is_refused(storage):
    first, _, _ = begin(storage, "r1", entry="prolific", PID="p1", SESSION="s1")
    again, _, _ = begin(storage, "r2", entry="prolific", PID="p1", SESSION="s1")
    assert again.number == first.number
    other = Arrival("r3", "prolific", {"PID": "p1", "SESSION": "s2"}, "tab-00000000", "p1-s1")
    with pytest.raises(Refusal, match="again"):
        storage.begin(other, lambda *_: STEPS, groups=1, places=None, largest_gap=1e9, now=100.0)


def test_a_tab_that_lost_the_session_is_told_and_its_record_saved(storage):
    session, token, _ = begin(storage, "r1")
    storage.resume(token, "tab-new", places=None, largest_gap=1e9, now=150.0)
    old = record(session, tab="tab-00000000")
    assert storage.save([old]) == [SaveResult("new", superseded=True)]
    assert storage.save([record(session, 1, tab="tab-new")]) == [
        SaveResult("new", superseded=False)
    ]


def test_a_clock_set_back_never_drops_anybody(storage):
    session, _, _ = begin(storage, "r1", now=5000.0)
    storage.save([record(session, received=10.0)])
    storage.drop_stale(1000.0, 20.0)
    assert storage.sessions()[0].state == "open"
    assert storage.sessions()[0].last_seen == 5000.0
    assert storage.records()[0].received == 10.0


def test_who_is_complete_stays_so(storage):
    session, _, _ = begin(storage, "r1")
    storage.end(session.number, "complete")
    storage.end(session.number, "failed_check")
    storage.drop_stale(1.0, 1e9)
    assert storage.sessions()[0].state == "complete"


def test_all_is_there_when_it_is_opened_again(storage, database):
    session, token, _ = begin(storage, "r1", entry="prolific", PID="p1")
    storage.save([record(session, k) for k in (2, 0)])
    again = Storage(database)
    assert again.sessions() == storage.sessions()
    assert again.saved_steps(session.number) == [0, 2]
    assert again.session_of(token).steps == tuple(STEPS)
    assert (again.secret, again.admin_token) == (storage.secret, storage.admin_token)
    again.close()


def test_nothing_of_who_withdrew_is_left_in_the_file(tmp_path):
    path = tmp_path / "responses.sqlite"
    storage = Storage(f"sqlite:///{path}")
    session, _, _ = begin(storage, "r1", entry="prolific", PID="VERYSECRETNAME")
    storage.save([record(session, body='{"remarks":"VERYSECRETNAME"}')])
    assert b"VERYSECRETNAME" in path.read_bytes() + path.with_name(path.name + "-wal").read_bytes()
    assert storage.delete([session.number])["records"] == 1
    storage.close()
    rest = b"".join(file.read_bytes() for file in tmp_path.iterdir())
    assert b"VERYSECRETNAME" not in rest


def test_sqlite_is_opened_so_that_a_commit_is_on_the_disk(tmp_path):
    storage = Storage(f"sqlite:///{tmp_path / 'x.sqlite'}")
    with storage.engine.connect() as connection:
        found = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("journal_mode", "synchronous", "foreign_keys")
        }
    storage.close()
    assert found == {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1}


def test_a_network_file_system_is_refused(tmp_path, monkeypatch):
    class Mount:
        mountpoint, fstype = str(tmp_path), "nfs4"

    monkeypatch.setattr(database_module.psutil, "disk_partitions", lambda all: [Mount])
    with pytest.raises(InputError, match=r"network file system \(nfs4\)"):
        Storage(f"sqlite:///{tmp_path / 'x.sqlite'}")


@pytest.mark.parametrize("url", ["mysql://x/y", "nonsense", "oracle://x"])
def test_other_databases_are_refused(url):
    with pytest.raises(InputError, match="database: "):
        Storage(url)


def test_a_server_that_is_not_there_is_told_of():
    with pytest.raises(StoreError, match="postgresql"):
        Storage("postgresql://tester@/postgres?host=/nonexistent-folder")


def test_a_database_that_is_damaged_is_told_of(tmp_path):
    path = tmp_path / "responses.sqlite"
    path.write_bytes(b"this is no database, and longer than a header" * 50)
    with pytest.raises(StoreError, match=r"responses.sqlite: .*not a database"):
        Storage(f"sqlite:///{path}")


def test_a_disk_that_is_full_saves_nothing_and_says_so_then_all_goes_on(tmp_path):
    storage = Storage(f"sqlite:///{tmp_path / 'x.sqlite'}")
    session, _, _ = begin(storage, "r1")
    with storage.engine.connect() as connection:
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar()

    def limit(pages):
        def set_limit(connection, _):
            connection.execute(f"PRAGMA max_page_count = {pages}")

        return set_limit

    full = limit(pages)
    sa.event.listen(storage.engine, "connect", full)
    storage.engine.dispose()
    big = [record(session, k, body='"' + "x" * 5000 + '"') for k in range(4)]
    with pytest.raises(StoreError, match="full"):
        storage.save(big)
    sa.event.remove(storage.engine, "connect", full)
    storage.engine.dispose()
    assert storage.records() == []
    assert {one.status for one in storage.save(big)} == {"new"}
    storage.close()
    assert sqlite3.connect(tmp_path / "x.sqlite").execute("PRAGMA integrity_check").fetchone() == (
        "ok",
    )


def test_a_studys_database_is_made_only_where_somebody_may_take_part(tmp_path):
    study = small_study(tmp_path / "s")
    with (
        pytest.raises(InputError, match="not there; nobody has taken part yet"),
        study_storage(study, None),
    ):
        pass
    assert not (study / "responses.sqlite").exists()
    with study_storage(study, None, must_exist=False) as storage:
        secret = storage.secret
    with study_storage(study, None) as storage:
        assert storage.secret == secret
    with (
        pytest.raises(InputError, match="expected a study folder"),
        study_storage(tmp_path / "nothing", None, must_exist=False),
    ):
        pass


def test_a_file_that_cannot_be_written_anew_after_a_deletion_is_told_of(tmp_path, monkeypatch):
    storage = Storage(f"sqlite:///{tmp_path / 'x.sqlite'}")
    session, _, _ = begin(storage, "r1")

    def full(connection, statement):
        raise sa.exc.OperationalError(statement, None, Exception("disk is full"))

    storage.delete([session.number])
    monkeypatch.setattr(sa.Connection, "exec_driver_sql", full)
    with pytest.raises(StoreError, match=r"rows were deleted, but .* anew .*\(disk is full\)"):
        storage.write_anew()
    assert storage.sessions() == []
    storage.close()
