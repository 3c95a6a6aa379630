"""Where judgments are kept: SQLite in the study folder, or PostgreSQL by URL.

Every method is one transaction. A record is safe when `save` returns.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import sqlalchemy as sa

from pourcast.errors import InputError, StoreError
from pourcast.experiment.design.steps import Schedule, Step
from pourcast.experiment.storage.database import error_text, open_engine, shown_url
from pourcast.experiment.storage.journal import NAME as JOURNAL
from pourcast.experiment.storage.journal import journal_words
from pourcast.experiment.storage.record_lines import (
    Line,
    head_line,
    opening_line,
    record_line,
    state_line,
    token_line,
)
from pourcast.experiment.storage.records import (
    Record,
    SaveResult,
    all_conflicts,
    all_records,
    save_records,
    saved_steps,
)
from pourcast.experiment.storage.schema import CONFLICTS, RECORDS, SESSIONS, TABLES, TOKENS
from pourcast.experiment.storage.sessions import (
    DROPPED,
    OPEN,
    Arrival,
    Session,
    add_token,
    all_sessions,
    all_tokens,
    begin_session,
    claim_session,
    drop_stale_sessions,
    end_session,
    insert_session,
    session_by_key,
    session_by_number,
    session_by_request,
    session_by_token,
    session_to_resume,
)
from pourcast.experiment.storage.words import secret_words
from pourcast.study.folder import DATABASE, study_scenes


class Storage:
    """Sessions and records in a database.

    Parameters
    ----------
    url
        SQLAlchemy's URL of the database.
    words
        Called for the secrets of a new database, if it had any before; those that are not there
        are made up.

    Raises
    ------
    InputError
        If the URL or the file system is not fit for it.
    StoreError
        If the database can't be reached.
    """

    def __init__(self, url: str, words: Callable[[], Mapping[str, str]] = dict) -> None:
        self.engine = open_engine(url)
        self.url = self.engine.url
        self.shown_url = shown_url(self.url)
        with self._transaction() as connection:
            TABLES.create_all(connection)
            self.words = secret_words(connection, words)
            """The database's secrets: what links, codes and names of media are made with."""

    @classmethod
    def of_study(cls, study: Path, url: str | None = None) -> "Storage":
        """The study's database: the one given, or SQLite in its folder."""
        return cls(url or f"sqlite:///{study / DATABASE}", partial(journal_words, study / JOURNAL))

    @property
    def secret(self) -> bytes:
        """What links, participants' codes and names of media are made with."""
        return bytes.fromhex(self.words["secret"])

    @property
    def admin_token(self) -> str:
        """The word that opens the admin page."""
        return self.words["admin"]

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
            raise StoreError(f"{self.shown_url}: {error_text(error)}") from None

    # Sessions ------------------------------------------------------------------------

    def begin(
        self,
        arrival: Arrival,
        schedule: Schedule,
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
        schedule
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
            drop_stale_sessions(connection, largest_gap, now)
            number = session_to_resume(connection, arrival)
            is_new = number is None
            if number is None:
                number = begin_session(
                    connection, arrival, schedule, groups=groups, places=places, now=now
                )
            claim_session(connection, number, arrival.tab, now)
            token = add_token(connection, number)
            session = session_by_number(connection, number)
            assert session is not None
            return session, token, is_new

    def insert(
        self,
        arrival: Arrival,
        group: int,
        place: int,
        steps: Sequence[Step],
        now: float,
    ) -> Session:
        """A session that was run elsewhere, in its group and place; the same request, the same."""
        with self._transaction() as connection:
            session = session_by_request(connection, arrival.request)
            if session is None:
                number = insert_session(connection, arrival, group, place, steps, now)
                session = session_by_number(connection, number)
            assert session is not None
            return session

    def session_of(self, token: str) -> Session | None:
        """Session that a token belongs to, if any."""
        with self._transaction() as connection:
            return session_by_token(connection, token)

    def session_with_key(self, key: str) -> Session | None:
        """Session with a key, if any."""
        with self._transaction() as connection:
            return session_by_key(connection, key)

    def claim(self, session: int, tab: str, now: float) -> None:
        """Give a session to a browser tab; any other is told so."""
        with self._transaction() as connection:
            claim_session(connection, session, tab, now)

    def end(self, session: int, state: str) -> None:
        """Say how a session ended. One that is complete stays so."""
        with self._transaction() as connection:
            end_session(connection, session, state)

    def drop_stale(self, largest_gap: float, now: float) -> None:
        """Call sessions dropped whose participants have not been heard of for too long."""
        with self._transaction() as connection:
            drop_stale_sessions(connection, largest_gap, now)

    def sessions(self) -> list[Session]:
        """All sessions, in the order in which they began."""
        with self._transaction() as connection:
            return all_sessions(connection)

    def session_keys(self) -> set[str]:
        """Keys of all sessions."""
        with self._transaction() as connection:
            return set(connection.scalars(sa.select(SESSIONS.c.key)))

    # Records -------------------------------------------------------------------------

    def save(self, records: Sequence[Record]) -> list[SaveResult]:
        """Save records in one transaction; when this returns, they are on the disk.

        Raises
        ------
        StoreError
            If nothing of it could be saved.
        """
        with self._transaction() as connection:
            return save_records(connection, records)

    def saved_steps(self, session: int) -> list[int]:
        """Numbers of the steps of a session that there are records of."""
        with self._transaction() as connection:
            return saved_steps(connection, session)

    def records(self) -> list[Record]:
        """All records, by session and step."""
        with self._transaction() as connection:
            return all_records(connection)

    def conflicts(self) -> list[Record]:
        """Records that came under a key that another one had, by session and step."""
        with self._transaction() as connection:
            return all_conflicts(connection)

    def journal_lines(self) -> list[Line]:
        """All that the journal should have of this database."""
        with self._transaction() as connection:
            sessions = {one.number: one for one in all_sessions(connection)}
            records, conflicts = all_records(connection), all_conflicts(connection)
            tokens = all_tokens(connection)
        return [
            head_line(self.words),
            *(opening_line(one) for one in sessions.values()),
            *(token_line(sessions[number].key, digest) for number, digest in tokens),
            *(record_line(sessions[one.session], one) for one in records),
            *(record_line(sessions[one.session], one, aside=True) for one in conflicts),
            # Who was dropped is told by when they were last heard of.
            *(
                state_line(one.key, one.state)
                for one in sessions.values()
                if one.state not in (OPEN, DROPPED)
            ),
        ]

    # All of it -----------------------------------------------------------------------

    def delete(self, sessions: Iterable[int], *, vacuum: bool = True) -> dict[str, int]:
        """Delete sessions and all that belongs to them; returns the rows deleted by table.

        With `vacuum`, SQLite's file is written anew without them.

        Raises
        ------
        StoreError
            If they could not be deleted, or the file not be written anew.
        """
        numbers = list(sessions)
        deleted = {}
        with self._transaction() as connection:
            for table, column in (
                (RECORDS, RECORDS.c.session),
                (CONFLICTS, CONFLICTS.c.session),
                (TOKENS, TOKENS.c.session),
                (SESSIONS, SESSIONS.c.id),
            ):
                result = connection.execute(table.delete().where(column.in_(numbers)))
                deleted[table.name] = result.rowcount
        if vacuum and self.url.get_backend_name() == "sqlite":
            self._vacuum()
        return deleted

    def _vacuum(self) -> None:
        """Write SQLite's file anew, so that nothing deleted stays in free pages or in the log."""
        try:
            with self.engine.connect().execution_options(
                isolation_level="AUTOCOMMIT"
            ) as connection:
                connection.exec_driver_sql("VACUUM")
                connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)")
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(
                f"{self.shown_url}: rows were deleted, but the file could not be "
                f"written anew without them ({error_text(error)})"
            ) from None


@contextmanager
def study_storage(study: Path, url: str | None, *, must_exist: bool = True) -> Iterator[Storage]:
    """A study's database, closed at the end.

    Parameters
    ----------
    study
        The study folder.
    url
        SQLAlchemy's URL of the database; None for SQLite in the study folder.
    must_exist
        Refuse a study that nobody has taken part in yet, instead of making its database.

    Raises
    ------
    InputError
        If it is no study folder, or nobody has taken part though somebody must have.
    StoreError
        If the database can't be reached.
    """
    study_scenes(study)
    if must_exist and url is None and not (study / DATABASE).is_file():
        raise InputError(f"{study / DATABASE}: not there; nobody has taken part yet")
    storage = Storage.of_study(study, url)
    try:
        yield storage
    finally:
        storage.close()
