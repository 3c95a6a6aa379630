"""Records in the database: what a participant did in a step, kept once.

A record's key is its session and the number of its step. The same record may come twice, and is
kept once; another one under the same key is a conflict, and is kept in a table of its own.

The functions work in a transaction that `storage.Storage` opens.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import sqlalchemy as sa

from pourcast.experiment.storage.schema import CONFLICTS, RECORDS, SESSIONS, TOKENS
from pourcast.experiment.storage.sessions import DROPPED, token_digest

MAX_CONFLICTS = 20
"""Conflicting records kept, at most, under one key."""


@dataclass(frozen=True)
class Record:
    """What a participant did in a step: the body is JSON, in its canonical form.

    One that a browser sends has its tab, and the token that lets it write to the session.
    """

    session: int
    seq: int
    kind: str
    body: str
    received: float
    tab: str = ""
    token: str = ""


@dataclass(frozen=True)
class SaveResult:
    """What became of a record.

    Parameters
    ----------
    status
        `new`; `repeated`: was there; `conflict`: another was there, and this one is
        kept among the conflicts; `gone`: the session does not exist, or the token is none of it.
    superseded
        Another tab has the session now.
    kept
        Whether it was written now: new, or a conflict that had not come before.
    dropped
        The session was given up, and whoever has it goes on all the same.
    """

    status: Literal["new", "repeated", "conflict", "gone"]
    superseded: bool = False
    kept: bool = field(default=False, compare=False)
    dropped: bool = False


def save_records(connection: sa.Connection, records: Sequence[Record]) -> list[SaveResult]:
    """Save records, and note when their sessions were last heard of."""
    sessions = _sessions(connection, records)
    owners = _owners(connection, records)
    bodies = _bodies(connection, records)
    new, results = [], []
    for record in records:
        key = record.session, record.seq
        session = sessions.get(record.session)
        if session is None or (record.token and owners.get(record.token) != record.session):
            results.append(SaveResult("gone"))
            continue
        superseded = bool(record.tab) and session.tab != record.tab
        dropped = session.state == DROPPED and not superseded
        if key not in bodies:
            new.append(record)
            bodies[key] = record.body
            results.append(SaveResult("new", superseded, kept=True, dropped=dropped))
        elif bodies[key] == record.body:
            results.append(SaveResult("repeated", superseded, dropped=dropped))
        else:
            kept = _insert_conflict(connection, record)
            results.append(SaveResult("conflict", superseded, kept=kept, dropped=dropped))
    if new:
        connection.execute(RECORDS.insert(), [_row(record) for record in new])
    # Those of a batch came together. A clock that is set back makes no session older.
    latest = max(record.received for record in records)
    heard = {
        record.session
        for record, result in zip(records, results, strict=True)
        if result.status != "gone"
    }
    connection.execute(
        SESSIONS.update()
        .where(SESSIONS.c.id.in_(heard), SESSIONS.c.last_seen < latest)
        .values(last_seen=latest)
    )
    return results


def saved_steps(connection: sa.Connection, session: int) -> list[int]:
    """Numbers of the steps of a session that there are records of."""
    return list(
        connection.scalars(
            sa.select(RECORDS.c.seq).where(RECORDS.c.session == session).order_by(RECORDS.c.seq)
        )
    )


def all_records(connection: sa.Connection) -> list[Record]:
    """All records, by session and step."""
    rows = connection.execute(
        sa.select(RECORDS).order_by(RECORDS.c.session, RECORDS.c.seq)
    ).mappings()
    return [Record(**row) for row in rows]


def all_conflicts(connection: sa.Connection) -> list[Record]:
    """Records that came under a key that another one had, by session and step."""
    rows = connection.execute(
        sa.select(CONFLICTS, RECORDS.c.kind)
        .join(
            RECORDS,
            sa.and_(RECORDS.c.session == CONFLICTS.c.session, RECORDS.c.seq == CONFLICTS.c.seq),
        )
        .order_by(CONFLICTS.c.session, CONFLICTS.c.seq, CONFLICTS.c.received)
    ).mappings()
    return [
        Record(**{name: value for name, value in row.items() if name != "digest"}) for row in rows
    ]


def _sessions(connection: sa.Connection, records: Sequence[Record]) -> dict[int, Any]:
    """Tab and state of those sessions of the records that exist; nobody deletes them now."""
    numbers = {record.session for record in records}
    rows = connection.execute(
        sa.select(SESSIONS.c.id, SESSIONS.c.tab, SESSIONS.c.state)
        .where(SESSIONS.c.id.in_(numbers))
        .order_by(SESSIONS.c.id)
        .with_for_update()
    )
    return {row.id: row for row in rows}


def _owners(connection: sa.Connection, records: Sequence[Record]) -> dict[str, int]:
    """Sessions that the records' tokens belong to, of those tokens that are valid."""
    tokens = {token_digest(record.token): record.token for record in records if record.token}
    rows = connection.execute(
        sa.select(TOKENS.c.digest, TOKENS.c.session).where(TOKENS.c.digest.in_(tokens))
    )
    return {tokens[digest]: session for digest, session in rows}


def _bodies(connection: sa.Connection, records: Sequence[Record]) -> dict[tuple[int, int], str]:
    """Bodies that are saved under the keys of these records."""
    keys = [(record.session, record.seq) for record in records]
    rows = connection.execute(
        sa.select(RECORDS.c.session, RECORDS.c.seq, RECORDS.c.body).where(
            sa.tuple_(RECORDS.c.session, RECORDS.c.seq).in_(keys)
        )
    )
    return {(session, seq): body for session, seq, body in rows}


def _insert_conflict(connection: sa.Connection, record: Record) -> bool:
    """Keep a conflicting record aside, unless it is there already; returns whether it was kept."""
    digest = hashlib.sha256(record.body.encode()).hexdigest()
    digests = set(
        connection.scalars(
            sa.select(CONFLICTS.c.digest).where(
                CONFLICTS.c.session == record.session, CONFLICTS.c.seq == record.seq
            )
        )
    )
    if digest in digests or len(digests) >= MAX_CONFLICTS:
        return False
    row = _row(record)
    del row["kind"]
    connection.execute(CONFLICTS.insert().values(digest=digest, **row))
    return True


def _row(record: Record) -> dict[str, Any]:
    return {
        "session": record.session,
        "seq": record.seq,
        "kind": record.kind,
        "body": record.body,
        "received": record.received,
    }
