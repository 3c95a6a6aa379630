"""Sessions put into a database as they were: run elsewhere, or in a database that was lost.

The functions work in a transaction that `storage.Storage` opens.
"""

import json
import secrets
from collections.abc import Iterable
from typing import Any

import sqlalchemy as sa

from pourcast.experiment.storage.schema import BROWSERS, SESSIONS, TOKENS
from pourcast.experiment.storage.sessions import Session, plan_content


def restore_session(
    connection: sa.Connection, session: Session, tokens: Iterable[str], browsers: Iterable[str]
) -> int:
    """Insert a session with the digests of its tokens, and its browsers; returns its number.

    What is empty in it is made up as for a new one. Its number is its old one if nobody has it.
    """
    values = _row(session)
    if _is_taken(connection, SESSIONS.c.request, session.request) or not session.request:
        values["request"] = f"import {session.key}"
    if session.number > 0 and not _is_taken(connection, SESSIONS.c.id, session.number):
        values["id"] = session.number
    result = connection.execute(SESSIONS.insert().values(values))
    key = result.inserted_primary_key
    assert key is not None
    if "id" in values:
        count_from(connection, session.number)
    restore_tokens(connection, int(key[0]), tokens)
    for browser in dict.fromkeys(browsers):
        connection.execute(BROWSERS.insert().values(session=int(key[0]), request=browser))
    return int(key[0])


def count_from(connection: sa.Connection, last: int) -> None:
    """Give new sessions numbers after `last`, and after all that were ever given out."""
    values = {"last": last}
    if connection.dialect.name == "postgresql":
        connection.execute(
            sa.text(
                "SELECT setval(pg_get_serial_sequence('sessions', 'id'), "
                "greatest(:last, (SELECT last_value FROM sessions_id_seq)))"
            ),
            values,
        )
        return
    raised = "UPDATE sqlite_sequence SET seq = max(seq, :last) WHERE name = 'sessions'"
    if not connection.execute(sa.text(raised), values).rowcount:
        begun = "INSERT INTO sqlite_sequence (name, seq) VALUES ('sessions', :last)"
        connection.execute(sa.text(begun), values)


def restore_tokens(connection: sa.Connection, session: int, digests: Iterable[str]) -> None:
    """Let the holders of tokens write to a session, unless they can, or could to another one."""
    for digest in dict.fromkeys(digests):
        if not _is_taken(connection, TOKENS.c.digest, digest):
            connection.execute(TOKENS.insert().values(digest=digest, session=session))


def identify_session(connection: sa.Connection, session: Session) -> None:
    """Set entry, identifiers and participant of the session with a key."""
    row = _row(session)
    known = {name: row[name] for name in ("entry", "identifiers", "participant")}
    connection.execute(SESSIONS.update().where(SESSIONS.c.key == session.key).values(known))


def _is_taken(connection: sa.Connection, column: sa.Column[Any], value: object) -> bool:
    return connection.scalar(sa.select(sa.literal(1)).where(column == value).limit(1)) is not None


def _row(session: Session) -> dict[str, Any]:
    return {
        "key": session.key,
        "request": session.request,
        "participant": session.participant or f"{session.entry}-{secrets.token_hex(4)}",
        "entry": session.entry,
        "identifiers": json.dumps(dict(session.identifiers), sort_keys=True),
        "group_number": session.group,
        "place": session.place,
        "state": session.state,
        "tab": session.tab,
        "code": session.code or secrets.token_hex(4).upper(),
        "plan": json.dumps(plan_content(session.steps), separators=(",", ":")),
        "started": session.started,
        "last_seen": session.last_seen,
    }
