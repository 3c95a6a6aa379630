"""Sessions in the database: who takes part, in which group and place, and how it ended.

The functions work in a transaction that `storage.Storage` opens.
"""

import hashlib
import json
import secrets
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

from pourcast.experiment.design.steps import Schedule, Step
from pourcast.experiment.storage.schema import SESSIONS, TOKENS

OPEN, COMPLETE, DROPPED = "open", "complete", "dropped"
"""States of a session, beside `screened_out` and `failed_check`; dropped if nobody came back."""

DECLINED = "declined"
"""State of a session of somebody who did not agree to take part, until it is deleted."""

DECLINED_LATER = "declined_later"
"""State of a session of somebody who agreed first, and did not later: what was given is kept."""

RECRUITED = ("lab", "prolific", "mturk")
"""Entries whose sessions are the study's; `preview` and `simulation` are not."""

UNKNOWN = "unknown"
"""Entry of a session that was run elsewhere, and whose opening line was lost."""


@dataclass(frozen=True)
class Session:
    """A participant's session.

    Parameters
    ----------
    number
        Its number in the database.
    key
        Its name everywhere else, in the journal and in files: never another session's, even where
        numbers begin again in a new database.
    request
        Made up by the browser that began it: the same request gets the same session.
    participant
        Code of the participant, the same for the same platform id.
    entry
        How they came: one of `RECRUITED`, `preview`, `simulation`, `jatos`, `static` or `UNKNOWN`.
    identifiers
        The recruiting platform's ids.
    group, place
        Which liquids, and which order.
    state
        `open`, `complete`, `dropped`, `screened_out`, `failed_check`, `declined_later`; and
        `declined` until it is deleted.
    tab
        Browser tab that has the session.
    code
        The session's own completion code.
    steps
        What is to be done in it.
    started, last_seen
        Seconds since 1970.
    """

    number: int
    key: str
    request: str
    participant: str
    entry: str
    identifiers: Mapping[str, str]
    group: int
    place: int
    state: str
    tab: str
    code: str
    steps: tuple[Step, ...]
    started: float
    last_seen: float


@dataclass(frozen=True)
class Arrival:
    """Somebody who begins a session.

    Parameters
    ----------
    request
        Made up by the browser: the same request gets the same session.
    entry, identifiers, tab
        As in `Session`.
    participant
        Code of the participant; empty for a new one.
    """

    request: str
    entry: str
    identifiers: Mapping[str, str]
    tab: str
    participant: str = ""


class Refusal(Exception):  # noqa: N818 - nothing went wrong
    """Somebody can't go on: `reason` is a name among the texts of `stop`."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def token_digest(token: str) -> str:
    """What the database keeps of a token: whoever reads it can't take a session over."""
    return hashlib.sha256(token.encode()).hexdigest()


def add_token(connection: sa.Connection, session: int) -> str:
    """A new token that lets its holder write to a session."""
    token = secrets.token_urlsafe(32)
    connection.execute(TOKENS.insert().values(digest=token_digest(token), session=session))
    return token


def all_sessions(connection: sa.Connection) -> list[Session]:
    """All sessions, in the order in which they began."""
    rows = connection.execute(sa.select(SESSIONS).order_by(SESSIONS.c.id)).mappings()
    return [_session(row) for row in rows]


def session_by_number(connection: sa.Connection, number: int) -> Session | None:
    """The session with a number, if there is one."""
    return _first_session(connection, SESSIONS.c.id == number)


def session_by_key(connection: sa.Connection, key: str) -> Session | None:
    """The session with a key, if there is one."""
    return _first_session(connection, SESSIONS.c.key == key)


def session_by_request(connection: sa.Connection, request: str) -> Session | None:
    """The session that a browser's request began, if there is one."""
    return _first_session(connection, SESSIONS.c.request == request)


def session_by_token(
    connection: sa.Connection, token: str, *, for_update: bool = False
) -> Session | None:
    """The session that a token belongs to, if there is one.

    With `for_update` nobody else changes it until the transaction ends.
    """
    owner = sa.select(TOKENS.c.session).where(TOKENS.c.digest == token_digest(token))
    return _first_session(
        connection, SESSIONS.c.id == owner.scalar_subquery(), for_update=for_update
    )


def session_to_resume(connection: sa.Connection, arrival: Arrival) -> Session | None:
    """The session that somebody who comes goes on with; None for a new participant.

    Raises
    ------
    Refusal
        If they have taken part before (`again`).
    """
    same_request = session_by_request(connection, arrival.request)
    if same_request is not None:
        return same_request
    if arrival.entry not in RECRUITED or not arrival.participant:
        return None
    rows = connection.execute(
        sa.select(SESSIONS).where(
            SESSIONS.c.participant == arrival.participant,
            SESSIONS.c.entry == arrival.entry,
        )
    ).mappings()
    sessions = [_session(row) for row in rows]
    same = (one for one in sessions if one.identifiers == dict(arrival.identifiers))
    session = next(same, None)
    if sessions and session is None:
        raise Refusal("again")
    return session


def reopen_session(
    connection: sa.Connection, session: Session, places: int | None, now: float
) -> bool:
    """Let a dropped session go on, whose participant has come back.

    Returns
    -------
    bool
        Whether it could be: not if its place was given to somebody else, and the group is full.
    """
    taken = _taken_places(connection, session.entry)[session.group]
    limited = session.entry in RECRUITED and places is not None
    if limited and session.place in taken and len(taken) >= (places or 0):
        return False
    connection.execute(
        SESSIONS.update()
        .where(SESSIONS.c.id == session.number, SESSIONS.c.state == DROPPED)
        .values(state=OPEN, last_seen=now)
    )
    return True


def free_place(
    connection: sa.Connection, entry: str, groups: int, places: int | None
) -> tuple[int, int]:
    """Group and place for the next participant: the emptiest group's first free place.

    Raises
    ------
    Refusal
        If all places are taken (`full`).
    """
    taken = _taken_places(connection, entry)
    group = min(range(groups), key=lambda g: (len(taken[g]), g))
    if entry in RECRUITED and places is not None and len(taken[group]) >= places:
        raise Refusal("full")
    return group, next(k for k in range(len(taken[group]) + 1) if k not in taken[group])


def _taken_places(connection: sa.Connection, entry: str) -> dict[int, list[int]]:
    """Places that people have in each group; one twice if a drop-out came back to it."""
    taken: dict[int, list[int]] = defaultdict(list)
    for group, place in connection.execute(
        sa.select(SESSIONS.c.group_number, SESSIONS.c.place).where(
            SESSIONS.c.entry.in_(RECRUITED if entry in RECRUITED else (entry,)),
            SESSIONS.c.state.in_((OPEN, COMPLETE)),
        )
    ):
        taken[group].append(place)
    return taken


def begin_session(
    connection: sa.Connection,
    arrival: Arrival,
    schedule: Schedule,
    *,
    groups: int,
    places: int | None,
    now: float,
) -> int:
    """A new session in the next free place; returns its number.

    Raises
    ------
    Refusal
        If all places are taken (`full`).
    """
    group, place = free_place(connection, arrival.entry, groups, places)
    return insert_session(connection, arrival, group, place, schedule(group, place), now)


def insert_session(
    connection: sa.Connection,
    arrival: Arrival,
    group: int,
    place: int,
    steps: Sequence[Step],
    now: float,
) -> int:
    """A new session in a given group and place; returns its number."""
    result = connection.execute(
        SESSIONS.insert().values(
            key=secrets.token_hex(16),
            request=arrival.request,
            participant=arrival.participant
            or _unused(connection, SESSIONS.c.participant, lambda: _new_code(arrival.entry)),
            entry=arrival.entry,
            identifiers=json.dumps(dict(arrival.identifiers), sort_keys=True),
            group_number=group,
            place=place,
            state=OPEN,
            tab=arrival.tab,
            code=_unused(connection, SESSIONS.c.code, lambda: secrets.token_hex(4).upper()),
            plan=json.dumps(plan_content(steps), separators=(",", ":")),
            started=now,
            last_seen=now,
        )
    )
    key = result.inserted_primary_key
    assert key is not None
    return int(key[0])


def plan_content(steps: Sequence[Step]) -> list[dict[str, Any]]:
    """The steps of a session as JSON's types."""
    return [step.model_dump(exclude_defaults=True) | {"seq": step.seq} for step in steps]


def all_tokens(connection: sa.Connection) -> list[tuple[int, str]]:
    """Session and digest of all tokens."""
    rows = connection.execute(
        sa.select(TOKENS.c.session, TOKENS.c.digest).order_by(TOKENS.c.session)
    )
    return [(row.session, row.digest) for row in rows]


def claim_session(connection: sa.Connection, session: int, tab: str, now: float) -> None:
    """Give a session to a browser tab."""
    connection.execute(
        SESSIONS.update().where(SESSIONS.c.id == session).values(tab=tab, last_seen=now)
    )


def end_session(connection: sa.Connection, session: int, state: str) -> None:
    """Say how a session ended. One that is complete stays so."""
    connection.execute(
        SESSIONS.update()
        .where(SESSIONS.c.id == session, SESSIONS.c.state != COMPLETE)
        .values(state=state)
    )


def wait_anew(connection: sa.Connection, now: float) -> None:
    """Count from now on how long open sessions are away."""
    connection.execute(SESSIONS.update().where(SESSIONS.c.state == OPEN).values(last_seen=now))


def drop_stale_sessions(connection: sa.Connection, largest_gap: float, now: float) -> None:
    """Call open sessions dropped of which nothing was heard for `largest_gap` [s]."""
    connection.execute(
        SESSIONS.update()
        .where(SESSIONS.c.state == OPEN, SESSIONS.c.last_seen < now - largest_gap)
        .values(state=DROPPED)
    )


def _new_code(entry: str) -> str:
    """A participant's code, for one who has no platform's id."""
    return f"{entry}-{secrets.token_hex(4)}"


def _unused(connection: sa.Connection, column: sa.Column[str], make: Callable[[], str]) -> str:
    """A word that no other session has: short ones are drawn twice now and then."""
    words = iter(make, None)
    return next(
        word
        for word in words
        if connection.scalar(sa.select(sa.func.count()).where(column == word)) == 0
    )


def _first_session(
    connection: sa.Connection, where: sa.ColumnElement[bool], *, for_update: bool = False
) -> Session | None:
    query = sa.select(SESSIONS).where(where)
    row = connection.execute(query.with_for_update() if for_update else query).mappings().first()
    return None if row is None else _session(row)


def _session(row: Mapping[Any, Any]) -> Session:
    return Session(
        number=row["id"],
        key=row["key"],
        request=row["request"],
        participant=row["participant"],
        entry=row["entry"],
        identifiers=json.loads(row["identifiers"]),
        group=row["group_number"],
        place=row["place"],
        state=row["state"],
        tab=row["tab"],
        code=row["code"],
        steps=tuple(Step.model_construct(**step) for step in json.loads(row["plan"])),
        started=row["started"],
        last_seen=row["last_seen"],
    )
