"""A database that an older pourcast made is brought to the tables of this one, or refused."""

import json
import secrets
import sqlite3
from contextlib import closing

import pytest
import sqlalchemy as sa

from pourcast import cli
from pourcast.errors import InputError, StoreError
from pourcast.experiment.storage.schema import SCHEMA
from pourcast.experiment.storage.sessions import token_digest
from pourcast.experiment.storage.storage import Storage
from tests.experiment.conftest import fresh_database
from tests.experiment.make import small_study
from tests.experiment.test_storage import STEPS, begin, record

TOKEN = "a-token-of-before-000000000000000000000000"

TABLES = """
CREATE TABLE meta (name TEXT NOT NULL, value TEXT NOT NULL, PRIMARY KEY (name));
CREATE TABLE sessions (
    id {number}, request TEXT NOT NULL, participant TEXT NOT NULL, entry TEXT NOT NULL,
    identifiers TEXT NOT NULL, group_number INTEGER NOT NULL, place INTEGER NOT NULL,
    state TEXT NOT NULL, tab TEXT NOT NULL, code TEXT NOT NULL, plan TEXT NOT NULL,
    started {float} NOT NULL, last_seen {float} NOT NULL, {key} UNIQUE (request)
);
CREATE INDEX ix_sessions_participant ON sessions (participant);
CREATE TABLE tokens (
    digest TEXT NOT NULL, session INTEGER NOT NULL, PRIMARY KEY (digest),
    FOREIGN KEY(session) REFERENCES sessions (id)
);
CREATE INDEX ix_tokens_session ON tokens (session);
CREATE TABLE records (
    session INTEGER NOT NULL, seq INTEGER NOT NULL, kind TEXT NOT NULL, body TEXT NOT NULL,
    received {float} NOT NULL, PRIMARY KEY (session, seq),
    FOREIGN KEY(session) REFERENCES sessions (id)
);
CREATE TABLE aside (
    session INTEGER NOT NULL, seq INTEGER NOT NULL, digest TEXT NOT NULL, body TEXT NOT NULL,
    received {float} NOT NULL, PRIMARY KEY (session, seq, digest),
    FOREIGN KEY(session) REFERENCES sessions (id)
);
INSERT INTO meta VALUES ('secret', '{secret}'), ('admin', 'an admin token of before');
"""
"""What earlier versions made, told by their tables of sessions."""

KINDS = {
    "first": {"number": "INTEGER NOT NULL PRIMARY KEY"},
    "counting": {"number": "INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL"},
    "keys": {
        "number": "INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL",
        "key": "key TEXT NOT NULL, UNIQUE (key),",
    },
}
POSTGRESQL = {"number": "SERIAL NOT NULL PRIMARY KEY", "float": "DOUBLE PRECISION"}


def tables(kind, **changes):
    return TABLES.format(**{"float": "FLOAT", "key": "", "secret": "ab" * 16} | kind | changes)


def rows(kind):
    """Sessions 1 and 2 of three; the third was deleted. Each has a record, the first a token."""
    plan = json.dumps(
        [step.model_dump(exclude_defaults=True) | {"seq": step.seq} for step in STEPS]
    )
    for number in (1, 2, 3):
        names = ["request", "participant", "entry", "identifiers", "group_number", "place",
                 "state", "tab", "code", "plan", "started", "last_seen"]  # fmt: skip
        values = [f"request-{number}", f"lab-{number}", "lab", f'{{"participant": "Person number {number}"}}', 0, number,
                  "open", "tab-00000001", f"CODE{number}", plan, 50.0, 60.0]  # fmt: skip
        if "key" in kind:
            names, values = [*names, "key"], [*values, f"key-{number}"]
        yield "sessions", names, values
    for number in (1, 2):
        yield "records", ["session", "seq", "kind", "body", "received"], [
            number, 0, "judgment", f'{{"response":0.{number}}}', 55.0,
        ]  # fmt: skip
    yield "aside", ["session", "seq", "digest", "body", "received"], [1, 0, "d", "{}", 56.0]
    yield "tokens", ["digest", "session"], [token_digest(TOKEN), 1]


@pytest.fixture(params=list(KINDS))
def old_file(request, tmp_path):
    return make_old(tmp_path / "responses.sqlite", KINDS[request.param])


def make_old(path, kind):
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode = WAL")
    connection.executescript(tables(kind))
    for table, names, values in rows(kind):
        marks = ", ".join("?" * len(names))
        connection.execute(f"INSERT INTO {table} ({', '.join(names)}) VALUES ({marks})", values)
    connection.execute("DELETE FROM sessions WHERE id = 3")
    connection.commit()
    connection.close()
    path.chmod(0o600)  # what others may read is told of, too
    return path


def sessions_in(path):
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute("SELECT * FROM sessions").fetchall()


def check_content(storage):
    """All that was there is there, by the same token and under the same numbers."""
    assert [one.number for one in storage.sessions()] == [1, 2]
    first, second = storage.sessions()
    assert len({first.key, second.key} - {""}) == 2
    assert storage.session_of(TOKEN) == storage.session_with_key(first.key) == first
    assert first.participant == "lab-1"
    assert first.steps == tuple(STEPS)
    assert [(r.session, r.body, r.received) for r in storage.records()] == [
        (1, '{"response":0.1}', 55.0), (2, '{"response":0.2}', 55.0),
    ]  # fmt: skip
    assert [(r.session, r.body) for r in storage.conflicts()] == [(1, "{}")]
    assert storage.secret == bytes.fromhex("ab" * 16)
    assert storage.admin_token == "an admin token of before"


def shape(engine):
    """Tables, columns, keys and indexes, whatever they are called."""
    found = sa.inspect(engine)
    return {
        table: (
            sorted((c["name"], str(c["type"]), c["nullable"]) for c in found.get_columns(table)),
            found.get_pk_constraint(table)["constrained_columns"],
            sorted(one["column_names"] for one in found.get_unique_constraints(table)),
            sorted(one["column_names"] for one in found.get_indexes(table)
                   if not one.get("duplicates_constraint")),
            [(one["constrained_columns"], one["referred_table"], one["referred_columns"])
             for one in found.get_foreign_keys(table)],
        )
        for table in sorted(found.get_table_names())
    }  # fmt: skip


def test_an_older_file_is_migrated_when_it_is_opened(old_file, tmp_path, caplog):
    storage = Storage(f"sqlite:///{old_file}")
    check_content(storage)
    fresh = Storage(f"sqlite:///{tmp_path / 'fresh.sqlite'}")
    assert shape(storage.engine) == shape(fresh.engine)
    fresh.close()
    # No number twice, where the file knew the last one.
    new, _, _ = begin(storage, "request-4")
    assert new.number >= 3
    storage.save([record(new, seq=0)])
    storage.delete([new.number])
    assert begin(storage, "request-5")[0].number == new.number + 1
    storage.close()
    assert [r.message for r in caplog.records if "brought" in r.message] == [
        f"{old_file}: brought from schema 1 to {SCHEMA}; as it was, it is kept as "
        "responses-schema-1.sqlite"
    ]
    # And never again.
    caplog.clear()
    again = Storage(f"sqlite:///{old_file}")
    again.close()
    assert not caplog.records


def test_a_number_that_was_deleted_before_is_not_given_out_after(tmp_path):
    storage = Storage(f"sqlite:///{make_old(tmp_path / 'x.sqlite', KINDS['counting'])}")
    assert begin(storage, "request-4")[0].number == 4
    storage.close()


def test_the_file_as_it_was_is_kept_and_overwrites_nothing(old_file):
    first = old_file.with_name("responses-schema-1.sqlite")
    first.write_text("somebody's")
    before = sessions_in(old_file)
    Storage(f"sqlite:///{old_file}").close()
    assert first.read_text() == "somebody's"
    kept = old_file.with_name("responses-schema-1-2.sqlite")
    assert sessions_in(kept) == before
    assert kept.stat().st_mode & 0o077 == 0


def test_who_withdraws_is_taken_out_of_the_copy_that_was_kept_too(tmp_path, capsys):
    study = small_study(tmp_path)
    make_old(study / "responses.sqlite", KINDS["counting"])
    kept = study / "responses-schema-1.sqlite"
    Storage.of_study(study).close()
    assert [row[2] for row in sessions_in(kept)] == ["lab-1", "lab-2"]
    status = cli.run(["experiment", "data", str(study), "--withdraw", "lab-1"])
    assert status == 0, capsys.readouterr()
    for path in (kept, study / "responses.sqlite"):
        assert len(sessions_in(path)) == 1
        assert b"lab-1" not in path.read_bytes()


def test_a_migration_that_fails_changes_nothing_and_is_done_the_next_time(old_file, monkeypatch):
    before = sessions_in(old_file)
    really = sa.Connection.execute

    def full(connection, statement, *arguments, **options):
        if "DELETE FROM meta" in str(statement):  # the last but one
            raise sa.exc.OperationalError(str(statement), None, Exception("disk is full"))
        return really(connection, statement, *arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(sa.Connection, "execute", full)
        with pytest.raises(StoreError, match=r"schema 1\), and it can't be .*disk is full"):
            Storage(f"sqlite:///{old_file}")
    assert sessions_in(old_file) == before
    storage = Storage(f"sqlite:///{old_file}")
    check_content(storage)
    storage.close()


def test_a_file_that_an_older_server_has_open_is_left_alone(old_file):
    server = sqlite3.connect(old_file)
    server.execute("SELECT * FROM sessions").fetchall()
    with pytest.raises(StoreError, match=r"database is locked\); end what has it open"):
        Storage(f"sqlite:///{old_file}")
    server.execute("UPDATE sessions SET state = 'complete'")
    server.commit()
    server.close()
    storage = Storage(f"sqlite:///{old_file}")
    assert {one.state for one in storage.sessions()} == {"complete"}
    storage.close()


def test_an_older_postgresql_is_migrated_too(postgresql, caplog):
    with fresh_database(postgresql) as url:
        engine = sa.create_engine(sa.make_url(url).set(drivername="postgresql+psycopg"))
        with engine.begin() as connection:
            connection.exec_driver_sql(tables(POSTGRESQL))
            for table, names, values in rows(POSTGRESQL):
                marks = ", ".join(["%s"] * len(names))
                connection.exec_driver_sql(
                    f"INSERT INTO {table} ({', '.join(names)}) VALUES ({marks})", tuple(values)
                )
            connection.exec_driver_sql("DELETE FROM sessions WHERE id = 3")
        engine.dispose()
        storage = Storage(url)
        check_content(storage)
        assert begin(storage, "request-4")[0].number == 4
        with fresh_database(postgresql) as other:
            fresh = Storage(other)
            assert shape(storage.engine) == shape(fresh.engine)
            fresh.close()
        storage.close()
        assert f"brought from schema 1 to {SCHEMA}" in caplog.text


def test_a_newer_schema_is_refused_in_a_line(storage, database):
    with storage.engine.begin() as connection:
        connection.exec_driver_sql(f"UPDATE meta SET value = '{SCHEMA + 1}' WHERE name = 'schema'")
    with pytest.raises(
        InputError, match=rf"newer pourcast made it \(schema {SCHEMA + 1}.*update pourcast"
    ):
        Storage(database)


def test_the_commands_refuse_a_newer_schema_in_a_line(tmp_path, capsys):
    study = small_study(tmp_path)
    storage = Storage.of_study(study)
    with storage.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE meta SET value = '99' WHERE name = 'schema'")
    storage.close()
    for command in ("status", "data", "serve"):
        assert cli.run(["experiment", command, str(study)]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "responses.sqlite: a newer pourcast made it" in said


def test_no_code_is_two_peoples(storage, monkeypatch):
    """Short words are drawn twice now and then: each is drawn again until nobody has it."""
    drawn = iter(["aa", "bb", "aa", "cc", "bb", "dd"])
    really = secrets.token_hex

    def token_hex(size):
        return next(drawn) if size == 4 else really(size)

    monkeypatch.setattr("pourcast.experiment.storage.sessions.secrets.token_hex", token_hex)
    people = [begin(storage, f"request-{k}")[0] for k in range(2)]
    assert [one.participant for one in people] == ["lab-aa", "lab-cc"]
    assert [one.code for one in people] == ["BB", "DD"]
