"""Where judgments are kept: SQLite in the study folder, or PostgreSQL by URL.

A record's key is its session and the number of its step. The same record may come twice, and is
kept once; another one under the same key is kept aside. A record is safe when `save` returns.
"""

import hashlib
import json
import secrets
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import sqlalchemy as sa

from pourcast.errors import StoreError
from pourcast.experiment.design.plan import Step
from pourcast.experiment.storage.database import (
    ASIDE,
    META,
    RECORDS,
    SESSIONS,
    TABLES,
    TOKENS,
    open_engine,
    reason,
)
from pourcast.study.folder import DATABASE

OPEN, COMPLETE, DROPPED = "open", "complete", "dropped"
"""States of a session, beside `screened_out` and `failed_check`; dropped if nobody came back."""

RECRUITED = ("lab", "prolific", "mturk")
"""Entries whose sessions are the study's; `preview` and `simulation` are not."""

MAX_CONFLICTS = 20
"""Records kept aside, at most, under one key."""


@dataclass(frozen=True)
class Session:
    """A participant's session.

    Parameters
    ----------
    number
        Its number in the database.
    participant
        Code of the participant, the same for the same platform id.
    entry
        How they came: one of `RECRUITED`, `preview` or `simulation`.
    identifiers
        The recruiting platform's ids.
    group, place
        Which liquids, and which order.
    state
        `open`, `complete`, `dropped`, `screened_out` or `failed_check`.
    tab
        Browser tab that has the session.
    code
        The session's own completion code.
    plan
        Its steps.
    started, last_seen
        Seconds since 1970.
    """

    number: int
    participant: str
    entry: str
    identifiers: Mapping[str, str]
    group: int
    place: int
    state: str
    tab: str
    code: str
    plan: tuple[Step, ...]
    started: float
    last_seen: float


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
class Saved:
    """What became of a record.

    Parameters
    ----------
    result
        `new`; `repeated`: was there; `conflict`: another was there, and this is kept
        aside; `gone`: the session does not exist.
    superseded
        Another tab has the session now.
    """

    result: Literal["new", "repeated", "conflict", "gone"]
    superseded: bool = False


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


class Storage:
    """Sessions and records in a database.

    Parameters
    ----------
    url
        SQLAlchemy's URL of the database.

    Raises
    ------
    InputError
        If the URL or the file system is not fit for it.
    StoreError
        If the database can't be reached.
    """

    def __init__(self, url: str) -> None:
        self.engine = open_engine(url)
        self.url = self.engine.url
        with self._transaction() as connection:
            TABLES.create_all(connection)
            self.secret = bytes.fromhex(self._own(connection, "secret"))
            self.admin_token = self._own(connection, "admin")

    @classmethod
    def of_study(cls, study: Path, url: str | None = None) -> "Storage":
        """The study's database: the one given, or SQLite in its folder."""
        return cls(url or f"sqlite:///{study / DATABASE}")

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()

    @contextmanager
    def _transaction(self) -> Iterator[sa.Connection]:
        """A transaction: all of it is done, or nothing, and then a `StoreError` says why."""
        try:
            with self.engine.begin() as connection:
                yield connection
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(f"{self.url.render_as_string()}: {reason(error)}") from None

    @staticmethod
    def _own(connection: sa.Connection, name: str) -> str:
        """A random word of this database, made once."""
        found = connection.scalar(sa.select(META.c.value).where(META.c.name == name))
        if found is not None:
            return str(found)
        word = secrets.token_hex(16)
        connection.execute(META.insert().values(name=name, value=word))
        return word

    # Sessions ------------------------------------------------------------------------

    def begin(
        self,
        arrival: Arrival,
        plan: Callable[[int, int], Sequence[Step]],
        *,
        groups: int,
        places: int | None,
        largest_gap: float,
        now: float,
    ) -> tuple[Session, str, bool]:
        """Begin a session, or go on with that of the same request or platform session.

        Parameters
        ----------
        arrival
            Who comes.
        plan
            From group and place to the steps.
        groups
            Number of groups; the emptiest takes the next participant.
        places
            How many a group takes; None: as many as come.
        largest_gap
            After so long without a word a session is dropped, its place free again [s].
        now
            Seconds since 1970.

        Returns
        -------
        Session, str, bool
            The session, a token that lets its holder write to it, and whether it is new.

        Raises
        ------
        Refusal
            If there is no place, or they have taken part before.
        """
        with self._transaction() as connection:
            self._drop_stale(connection, largest_gap, now)
            there = self._known(connection, arrival)
            fresh = there is None
            if there is None:
                there = self._new(connection, arrival, plan, groups, places, now)
            self._claim(connection, there, arrival.tab, now)
            token = secrets.token_urlsafe(32)
            connection.execute(TOKENS.insert().values(digest=_digest(token), session=there))
            session = self._session(connection, SESSIONS.c.id == there)
            assert session is not None
            return session, token, fresh

    def _known(self, connection: sa.Connection, arrival: Arrival) -> int | None:
        """Number of a session to go on with."""
        found = connection.execute(
            sa.select(SESSIONS.c.id).where(SESSIONS.c.request == arrival.request)
        ).scalar()
        if found is not None:
            return int(found)
        if arrival.entry not in RECRUITED or not arrival.participant:
            return None
        rows = connection.execute(
            sa.select(SESSIONS.c.id, SESSIONS.c.identifiers, SESSIONS.c.state).where(
                SESSIONS.c.participant == arrival.participant,
                SESSIONS.c.entry == arrival.entry,
            )
        ).all()
        for number, identifiers, state in rows:
            if json.loads(identifiers) != dict(arrival.identifiers):
                continue
            if state == DROPPED:
                raise Refusal("late")
            return int(number)
        if rows:
            raise Refusal("again")
        return None

    def _new(
        self,
        connection: sa.Connection,
        arrival: Arrival,
        plan: Callable[[int, int], Sequence[Step]],
        groups: int,
        places: int | None,
        now: float,
    ) -> int:
        counted = arrival.entry in RECRUITED
        entries = RECRUITED if counted else (arrival.entry,)
        states = (OPEN, COMPLETE)
        taken: dict[int, set[int]] = defaultdict(set)
        for group, place in connection.execute(
            sa.select(SESSIONS.c.group_number, SESSIONS.c.place).where(
                SESSIONS.c.entry.in_(entries), SESSIONS.c.state.in_(states)
            )
        ):
            taken[group].add(place)
        group = min(range(groups), key=lambda g: (len(taken[g]), g))
        if counted and places is not None and len(taken[group]) >= places:
            raise Refusal("full")
        place = next(k for k in range(len(taken[group]) + 1) if k not in taken[group])
        return self._insert(connection, arrival, group, place, plan(group, place), now)

    def insert(
        self,
        arrival: Arrival,
        group: int,
        place: int,
        plan: Sequence[Step],
        now: float,
    ) -> Session:
        """A session that was run elsewhere, in its group and place; the same request, the same."""
        with self._transaction() as connection:
            there = self._session(connection, SESSIONS.c.request == arrival.request)
            if there is not None:
                return there
            number = self._insert(connection, arrival, group, place, plan, now)
            session = self._session(connection, SESSIONS.c.id == number)
            assert session is not None
            return session

    @staticmethod
    def _insert(
        connection: sa.Connection,
        arrival: Arrival,
        group: int,
        place: int,
        plan: Sequence[Step],
        now: float,
    ) -> int:
        steps = [step.model_dump(exclude_defaults=True) | {"seq": step.seq} for step in plan]
        result = connection.execute(
            SESSIONS.insert().values(
                request=arrival.request,
                participant=arrival.participant or f"{arrival.entry}-{secrets.token_hex(4)}",
                entry=arrival.entry,
                identifiers=json.dumps(dict(arrival.identifiers), sort_keys=True),
                group_number=group,
                place=place,
                state=OPEN,
                tab=arrival.tab,
                code=secrets.token_hex(4).upper(),
                plan=json.dumps(steps, separators=(",", ":")),
                started=now,
                last_seen=now,
            )
        )
        key = result.inserted_primary_key
        assert key is not None
        return int(key[0])

    @staticmethod
    def _drop_stale(connection: sa.Connection, largest_gap: float, now: float) -> None:
        connection.execute(
            SESSIONS.update()
            .where(SESSIONS.c.state == OPEN, SESSIONS.c.last_seen < now - largest_gap)
            .values(state=DROPPED)
        )

    def _session(self, connection: sa.Connection, where: Any) -> Session | None:
        row = connection.execute(sa.select(SESSIONS).where(where)).mappings().first()
        return None if row is None else _session_of(row)

    def session_of(self, token: str) -> Session | None:
        """Session that a token belongs to, if any."""
        with self._transaction() as connection:
            number = connection.scalar(
                sa.select(TOKENS.c.session).where(TOKENS.c.digest == _digest(token))
            )
            return None if number is None else self._session(connection, SESSIONS.c.id == number)

    def claim(self, session: int, tab: str, now: float) -> None:
        """Give a session to a browser tab; any other is told so."""
        with self._transaction() as connection:
            self._claim(connection, session, tab, now)

    @staticmethod
    def _claim(connection: sa.Connection, session: int, tab: str, now: float) -> None:
        connection.execute(
            SESSIONS.update().where(SESSIONS.c.id == session).values(tab=tab, last_seen=now)
        )

    def end(self, session: int, state: str) -> None:
        """Say how a session ended. One that is complete stays so."""
        with self._transaction() as connection:
            connection.execute(
                SESSIONS.update()
                .where(SESSIONS.c.id == session, SESSIONS.c.state != COMPLETE)
                .values(state=state)
            )

    def drop_stale(self, largest_gap: float, now: float) -> None:
        """Call sessions dropped whose participants have not been heard of for too long."""
        with self._transaction() as connection:
            self._drop_stale(connection, largest_gap, now)

    # Records -------------------------------------------------------------------------

    def save(self, records: Sequence[Record]) -> list[Saved]:
        """Save records in one transaction; when this returns, they are on the disk.

        Raises
        ------
        StoreError
            If nothing of it could be saved.
        """
        with self._transaction() as connection:
            return self._save(connection, records)

    def _save(self, connection: sa.Connection, records: Sequence[Record]) -> list[Saved]:
        numbers = {record.session for record in records}
        rows = connection.execute(
            sa.select(SESSIONS.c.id, SESSIONS.c.tab).where(SESSIONS.c.id.in_(numbers))
        )
        tabs = {row.id: row.tab for row in rows}
        there = {
            (session, seq): body
            for session, seq, body in connection.execute(
                sa.select(RECORDS.c.session, RECORDS.c.seq, RECORDS.c.body).where(
                    sa.tuple_(RECORDS.c.session, RECORDS.c.seq).in_(
                        [(record.session, record.seq) for record in records]
                    )
                )
            )
        }
        new, results = [], []
        for record in records:
            if record.session not in tabs:
                results.append(Saved("gone"))
                continue
            superseded = bool(record.tab) and tabs[record.session] != record.tab
            body = there.get((record.session, record.seq))
            if body is None:
                new.append(record)
                there[record.session, record.seq] = record.body
                results.append(Saved("new", superseded))
            elif body == record.body:
                results.append(Saved("repeated", superseded))
            else:
                self._keep_aside(connection, record)
                results.append(Saved("conflict", superseded))
        if new:
            connection.execute(RECORDS.insert(), [_row(record) for record in new])
        # Those of a batch came together. A clock that is set back makes no session older.
        latest = max(record.received for record in records)
        connection.execute(
            SESSIONS.update()
            .where(SESSIONS.c.id.in_(numbers), SESSIONS.c.last_seen < latest)
            .values(last_seen=latest)
        )
        return results

    @staticmethod
    def _keep_aside(connection: sa.Connection, record: Record) -> None:
        digest = _digest(record.body)
        same = (ASIDE.c.session == record.session, ASIDE.c.seq == record.seq)
        digests = set(connection.scalars(sa.select(ASIDE.c.digest).where(*same)))
        if digest not in digests and len(digests) < MAX_CONFLICTS:
            row = _row(record)
            del row["kind"]
            connection.execute(ASIDE.insert().values(digest=digest, **row))

    def done(self, session: int) -> list[int]:
        """Numbers of the steps of a session that there are records of."""
        with self._transaction() as connection:
            return list(
                connection.scalars(
                    sa.select(RECORDS.c.seq)
                    .where(RECORDS.c.session == session)
                    .order_by(RECORDS.c.seq)
                )
            )

    # All of it -----------------------------------------------------------------------

    def sessions(self) -> list[Session]:
        """All sessions, in the order in which they began."""
        with self._transaction() as connection:
            rows = connection.execute(sa.select(SESSIONS).order_by(SESSIONS.c.id)).mappings()
            return [_session_of(row) for row in rows]

    def records(self) -> list[Record]:
        """All records, by session and step."""
        with self._transaction() as connection:
            rows = connection.execute(
                sa.select(RECORDS).order_by(RECORDS.c.session, RECORDS.c.seq)
            ).mappings()
            return [Record(**row) for row in rows]

    def kept_aside(self) -> list[Record]:
        """Records that came under a key that another one had, by session and step."""
        with self._transaction() as connection:
            rows = connection.execute(
                sa.select(ASIDE, RECORDS.c.kind)
                .join(
                    RECORDS,
                    sa.and_(RECORDS.c.session == ASIDE.c.session, RECORDS.c.seq == ASIDE.c.seq),
                )
                .order_by(ASIDE.c.session, ASIDE.c.seq, ASIDE.c.received)
            ).mappings()
            return [
                Record(**{name: value for name, value in row.items() if name != "digest"})
                for row in rows
            ]

    def delete(self, sessions: Iterable[int], *, vacuum: bool = True) -> dict[str, int]:
        """Delete sessions and all that belongs to them; returns the rows deleted by table.

        With `vacuum`, SQLite's file is written anew without them.
        """
        numbers = list(sessions)
        deleted = {}
        with self._transaction() as connection:
            for table, column in (
                (RECORDS, RECORDS.c.session),
                (ASIDE, ASIDE.c.session),
                (TOKENS, TOKENS.c.session),
                (SESSIONS, SESSIONS.c.id),
            ):
                result = connection.execute(table.delete().where(column.in_(numbers)))
                deleted[table.name] = result.rowcount
        if vacuum and self.url.get_backend_name() == "sqlite":
            # Nothing of it shall stay in free pages or in the log.
            with self.engine.connect().execution_options(
                isolation_level="AUTOCOMMIT"
            ) as connection:
                connection.exec_driver_sql("VACUUM")
                connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)")
        return deleted


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _row(record: Record) -> dict[str, Any]:
    return {
        "session": record.session,
        "seq": record.seq,
        "kind": record.kind,
        "body": record.body,
        "received": record.received,
    }


def _session_of(row: Mapping[Any, Any]) -> Session:
    return Session(
        number=row["id"],
        participant=row["participant"],
        entry=row["entry"],
        identifiers=json.loads(row["identifiers"]),
        group=row["group_number"],
        place=row["place"],
        state=row["state"],
        tab=row["tab"],
        code=row["code"],
        plan=tuple(Step.model_construct(**step) for step in json.loads(row["plan"])),
        started=row["started"],
        last_seen=row["last_seen"],
    )
