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

from pourcast.experiment.storage.schema import CONFLICTS, RECORDS, SESSIONS

MAX_CONFLICTS = 20
"""Conflicting records kept, at most, under one key."""


@dataclass(frozen=True)
class Record:
    """What a participant did in a step: the body is JSON, in its canonical form."""

    session: int
    seq: int
    kind: str
    body: str
    received: float
    tab: str = ""


@dataclass(frozen=True)
class SaveResult:
    """What became of a record.

    Parameters
    ----------
    status
        `new`; `repeated`: was there; `conflict`: another was there, and this one is
        kept among the conflicts; `gone`: the session does not exist.
    superseded
        Another tab has the session now.
    kept
        Whether it was written now: new, or a conflict that had not come before.
    """

    status: Literal["new", "repeated", "conflict", "gone"]
    superseded: bool = False
    kept: bool = field(default=False, compare=False)


def save_records(connection: sa.Connection, records: Sequence[Record]) -> list[SaveResult]:
    """Save records, and note when their sessions were last heard of."""
    tabs = _tabs(connection, records)
    bodies = _bodies(connection, records)
    new, results = [], []
    for record in records:
        key = record.session, record.seq
        if record.session not in tabs:
            results.append(SaveResult("gone"))
            continue
        superseded = bool(record.tab) and tabs[record.session] != record.tab
        if key not in bodies:
            new.append(record)
            bodies[key] = record.body
            results.append(SaveResult("new", superseded, kept=True))
        elif bodies[key] == record.body:
            results.append(SaveResult("repeated", superseded))
        else:
            kept = _insert_conflict(connection, record)
            results.append(SaveResult("conflict", superseded, kept=kept))
    if new:
        connection.execute(RECORDS.insert(), [_row(record) for record in new])
    # Those of a batch came together. A clock that is set back makes no session older.
    latest = max(record.received for record in records)
    connection.execute(
        SESSIONS.update()
        .where(SESSIONS.c.id.in_(list(tabs)), SESSIONS.c.last_seen < latest)
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


def _tabs(connection: sa.Connection, records: Sequence[Record]) -> dict[int, str]:
    """The tab that has each session, of those sessions of the records that exist."""
    rows = connection.execute(
        sa.select(SESSIONS.c.id, SESSIONS.c.tab).where(
            SESSIONS.c.id.in_({record.session for record in records})
        )
    )
    return {row.id: row.tab for row in rows}


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
