"""Where judgments are kept: SQLite in the study folder, or PostgreSQL by URL.

Every method is one transaction. A record is safe when `save` returns.
"""

import hashlib
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from pourcast.errors import InputError, StoreError
from pourcast.experiment.design.steps import Schedule
from pourcast.experiment.storage.database import (
    BUSY_TIMEOUT,
    connection_engine,
    database_files,
    database_url,
    error_text,
    file_engine,
    file_url,
    refuse_network_file_system,
    server_engine,
    shown_url,
    write_anew,
)
from pourcast.experiment.storage.database_file import (
    DatabaseFile,
    can_be_written,
    in_memory,
    keep_copy,
    remedy,
)
from pourcast.experiment.storage.endings import Ending, finish_session
from pourcast.experiment.storage.failures import LOGGER
from pourcast.experiment.storage.journal import NAME as JOURNAL
from pourcast.experiment.storage.journal import how_to_restore, journal_words
from pourcast.experiment.storage.migrations import make_tables, migrate, schema_version
from pourcast.experiment.storage.record_lines import (
    Line,
    browser_line,
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
from pourcast.experiment.storage.restoration import (
    count_from,
    identify_session,
    restore_session,
    restore_tokens,
)
from pourcast.experiment.storage.schema import (
    BROWSERS,
    CONFLICTS,
    META,
    RECORDS,
    SCHEMA,
    SESSIONS,
    TOKENS,
)
from pourcast.experiment.storage.sessions import (
    DROPPED,
    OPEN,
    Arrival,
    Refusal,
    Session,
    add_token,
    all_sessions,
    all_tokens,
    begin_session,
    claim_session,
    drop_stale_sessions,
    end_session,
    reopen_session,
    session_by_key,
    session_by_number,
    session_by_token,
    session_to_resume,
    wait_anew,
)
from pourcast.experiment.storage.visits import (
    all_browsers,
    browsers_at_once,
    count_refusal,
    note_browser,
    refusals,
)
from pourcast.experiment.storage.words import NAMES, kept_words, made_words, set_words
from pourcast.files import keep_private
from pourcast.study.folder import DATABASE, study_scenes


class Storage:
    """Sessions and records in a database.

    A database of SQLite that can't be written is read into memory, and only looked at. Tables that
    an older pourcast made are brought to ours; a copy of SQLite's file is kept beside it first.

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
        If the URL or the file system is not fit for it, or a newer pourcast made it.
    StoreError
        If the database can't be reached.
    """

    def __init__(self, url: str | sa.URL, words: Callable[[], Mapping[str, str]] = dict) -> None:
        self.url = database_url(url)
        self.shown_url = shown_url(self.url)
        self._file: DatabaseFile | None = None
        self._is_copy = False
        if self.url.get_backend_name() == "postgresql":
            self.engine = server_engine(self.url)
        else:
            self._open_file(Path(self.url.database or ""))
        try:
            self._prepare_tables()
            self.words = self._secret_words(words)
            """The database's secrets: what links, codes and names of media are made with."""
        except BaseException:
            self.close()
            raise

    @classmethod
    def of_study(cls, study: Path, url: str | None = None) -> "Storage":
        """The study's database: the one given, or SQLite in its folder."""
        return cls(url or file_url(study / DATABASE), partial(journal_words, study / JOURNAL))

    @property
    def secret(self) -> bytes:
        """What links, participants' codes and names of media are made with."""
        return bytes.fromhex(self.words["secret"])

    @property
    def name(self) -> str:
        """What tells the database from others, the same after a restore; gives no secret away."""
        return hashlib.sha256(self.secret).hexdigest()[:12]

    @property
    def admin_token(self) -> str:
        """The word that opens the admin page."""
        return self.words["admin"]

    def close(self) -> None:
        """Close all connections; they are opened again when something is asked."""
        self.engine.dispose()
        if self._file is not None:
            self._file.close()

    def check(self) -> None:
        """See that the database is the one that was opened.

        Raises
        ------
        StoreError
            If it is not there any more, or another one stands in its place.
        """
        with self._reading() as connection:
            secret = connection.scalar(sa.select(META.c.value).where(META.c.name == "secret"))
        if secret != self.secret.hex():
            raise StoreError(
                f"{self.shown_url}: was replaced by another database while it was "
                "open; end the server and start it again"
            )

    # Opening -------------------------------------------------------------------------

    def _open_file(self, path: Path) -> None:
        if can_be_written(path):
            refuse_network_file_system(path)
            for file in database_files(path):
                keep_private(file)
            self._file = DatabaseFile(path)
            self.engine = file_engine(self._file)
        else:
            self._is_copy = True
            self.engine = connection_engine(in_memory(path))

    def _prepare_tables(self) -> None:
        """Make tables where there are none, and bring older ones to ours."""
        with self._transaction() as connection:
            version = schema_version(connection, self.shown_url)
        if version is None:
            with self._transaction(writes=True) as connection:
                make_tables(connection)
        elif version < SCHEMA and self._file is not None:
            self.close()
            self._migrate_file(self._file, version)
        elif version < SCHEMA:
            with self._transaction(writes=True) as connection:
                migrate(connection, version)
            if not self._is_copy:
                LOGGER.warning("%s: brought from schema %s to %s", self.shown_url, version, SCHEMA)

    def _migrate_file(self, file: DatabaseFile, version: int) -> None:
        """Migrate SQLite's file, which nobody else may have open."""
        try:
            with closing(
                sqlite3.connect(file.uri, uri=True, timeout=1.0, isolation_level=None)
            ) as connection:
                for statement in (
                    "PRAGMA locking_mode = EXCLUSIVE", "BEGIN EXCLUSIVE", "COMMIT",
                    "PRAGMA secure_delete = ON", "PRAGMA synchronous = FULL",
                ):  # fmt: skip
                    connection.execute(statement)
                kept = keep_copy(connection, file.path, version)
                engine = connection_engine(connection).execution_options(writes=True)
                with engine.begin() as transaction:
                    migrate(transaction, version)
        except (sqlite3.Error, sa.exc.SQLAlchemyError) as error:
            raise StoreError(
                f"{file.path}: an older pourcast made it (schema {version}), and it can't be "
                f"brought to schema {SCHEMA} ({error_text(error)}); end what has it open, such as "
                "a server, and try again"
            ) from None
        LOGGER.warning(
            "%s: brought from schema %s to %s; as it was, it is kept as %s",
            file.path, version, SCHEMA, kept.name,
        )  # fmt: skip

    def _secret_words(self, former: Callable[[], Mapping[str, str]]) -> dict[str, str]:
        with self._reading() as connection:
            words = kept_words(connection)
        if len(words) == len(NAMES):
            return words
        with self._transaction(writes=True) as connection:
            return made_words(connection, former())

    # Transactions --------------------------------------------------------------------

    @contextmanager
    def _transaction(self, *, writes: bool = False) -> Iterator[sa.Connection]:
        """A transaction: all of it is done, or nothing, and then a `StoreError` says why.

        What went into a file that nobody will find again is not done either.
        """
        if self._file is not None:
            self._file.check()
        try:
            with self.engine.execution_options(writes=writes).begin() as connection:
                yield connection
                # While this connection is open, its log is there.
                if self._file is not None:
                    self._file.check(is_open=True)
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(
                f"{self.shown_url}: {error_text(error)}{self._remedy(error)}"
            ) from None
        if self._file is not None:
            self._file.check()

    def _remedy(self, error: sa.exc.SQLAlchemyError) -> str:
        cause = getattr(error, "orig", None)
        if self._file is None or not isinstance(cause, sqlite3.Error):
            return ""
        return remedy(self._file.path, cause)

    def _reading(self) -> AbstractContextManager[sa.Connection]:
        return self._transaction()

    def _writing(self) -> AbstractContextManager[sa.Connection]:
        if self._is_copy:
            raise StoreError(
                f"{self.url.database}: cannot be written, or its folder can't; it can only be "
                "looked at here"
            )
        return self._transaction(writes=True)

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
            If there is no place, or they have taken part before, or were away for too long and
            have lost their place to somebody else.
        """
        with self._writing() as connection:
            drop_stale_sessions(connection, largest_gap, now)
            known = session_to_resume(connection, arrival)
            is_new = known is None
            if known is None:
                number = begin_session(
                    connection, arrival, schedule, groups=groups, places=places, now=now
                )
            else:
                number = known.number
                note_browser(connection, known, arrival.request, now)
                _go_on(connection, known, places, now)
            claim_session(connection, number, arrival.tab, now)
            token = add_token(connection, number)
            session = session_by_number(connection, number)
            assert session is not None
            return session, token, is_new

    def restore(
        self, session: Session, tokens: Iterable[str] = (), browsers: Iterable[str] = ()
    ) -> Session:
        """A session that was run elsewhere, or that a lost database had, with its tokens' digests.

        It keeps its number if nobody has it. `browsers` are those that took turns with it. One that
        another command has restored meanwhile is left as it is.
        """
        with self._writing() as connection:
            known = session_by_key(connection, session.key)
            if known is not None:
                return known
            number = restore_session(connection, session, tokens, browsers)
            restored = session_by_number(connection, number)
            assert restored is not None
            return restored

    def identify(self, session: Session) -> None:
        """Say who a session is that was restored when nobody could tell: its key tells which."""
        with self._writing() as connection:
            identify_session(connection, session)

    def add_tokens(self, session: int, digests: Iterable[str]) -> None:
        """Let the holders of tokens write to a session, if they can't yet."""
        with self._writing() as connection:
            restore_tokens(connection, session, digests)

    def take_words(self, words: Mapping[str, Any]) -> None:
        """Take over the secrets of a database that was lost, if nobody has begun in this one."""
        with self._writing() as connection:
            if connection.scalar(sa.select(SESSIONS.c.id).limit(1)) is None:
                set_words(connection, words)
                self.words = kept_words(connection)

    def count_from(self, last: int) -> None:
        """Give new sessions numbers after one that a lost database gave out last."""
        with self._writing() as connection:
            count_from(connection, last)

    def session_of(self, token: str) -> Session | None:
        """Session that a token belongs to, if any."""
        with self._reading() as connection:
            return session_by_token(connection, token)

    def session_with_key(self, key: str) -> Session | None:
        """Session with a key, if any."""
        with self._reading() as connection:
            return session_by_key(connection, key)

    def resume(
        self, token: str, tab: str | None, *, places: int | None, largest_gap: float, now: float
    ) -> Session | None:
        """Look a session up, and give it to a tab if there is one; None if there is no session.

        Parameters are those of `begin`.

        Raises
        ------
        Refusal
            If it was left for too long, and its place is somebody else's (`late`).
        """
        with self._writing() as connection:
            drop_stale_sessions(connection, largest_gap, now)
            session = session_by_token(connection, token, for_update=True)
            if session is None:
                return None
            _go_on(connection, session, places, now)
            if tab is not None and session.state in (OPEN, DROPPED):
                claim_session(connection, session.number, tab, now)
            return session_by_number(connection, session.number)

    def reopen(self, session: int, places: int | None, now: float) -> bool:
        """Let a session go on whose participant has come back; see `reopen_session`."""
        with self._writing() as connection:
            known = session_by_number(connection, session)
            return known is not None and reopen_session(connection, known, places, now)

    def end(self, session: int, state: str) -> None:
        """Say how a session ended. One that is complete stays so."""
        with self._writing() as connection:
            end_session(connection, session, state)

    def finish(self, token: str, state: str, tab: str) -> Ending | None:
        """End a session as a participant's page wishes, if it can; None if there is none."""
        with self._writing() as connection:
            return finish_session(connection, token, state, tab)

    def wait_anew(self, now: float) -> None:
        """Count from now on how long open sessions are away: nobody could answer before."""
        with self._writing() as connection:
            wait_anew(connection, now)

    def drop_stale(self, largest_gap: float, now: float) -> None:
        """Call sessions dropped whose participants have not been heard of for too long."""
        with self._writing() as connection:
            drop_stale_sessions(connection, largest_gap, now)

    def sessions(self) -> list[Session]:
        """All sessions, in the order in which they began."""
        with self._reading() as connection:
            return all_sessions(connection)

    def browsers(self) -> list[tuple[int, str]]:
        """Sessions and the further browsers that took turns with them."""
        with self._reading() as connection:
            return all_browsers(connection)

    def states(self) -> dict[str, str]:
        """The states of all sessions, by key."""
        with self._reading() as connection:
            rows = connection.execute(sa.select(SESSIONS.c.key, SESSIONS.c.state))
            return {row.key: row.state for row in rows}

    # Records -------------------------------------------------------------------------

    def save(self, records: Sequence[Record]) -> list[SaveResult]:
        """Save records in one transaction; when this returns, they are on the disk.

        Raises
        ------
        StoreError
            If nothing of it could be saved.
        """
        with self._writing() as connection:
            return save_records(connection, records)

    def saved_steps(self, session: int) -> list[int]:
        """Numbers of the steps of a session that there are records of."""
        with self._reading() as connection:
            return saved_steps(connection, session)

    def records(self) -> list[Record]:
        """All records, by session and step."""
        with self._reading() as connection:
            return all_records(connection)

    def conflicts(self) -> list[Record]:
        """Records that came under a key that another one had, by session and step."""
        with self._reading() as connection:
            return all_conflicts(connection)

    def journal_lines(self) -> list[Line]:
        """All that the journal should have of this database."""
        with self._reading() as connection:
            sessions = {one.number: one for one in all_sessions(connection)}
            records, conflicts = all_records(connection), all_conflicts(connection)
            tokens, browsers = all_tokens(connection), all_browsers(connection)
        return [
            head_line(self.words),
            *(opening_line(one, self.name) for one in sessions.values()),
            *(token_line(sessions[number].key, digest) for number, digest in tokens),
            *(record_line(sessions[one.session], one) for one in records),
            *(record_line(sessions[one.session], one, aside=True) for one in conflicts),
            *(browser_line(sessions[number].key, browser) for number, browser in browsers),
            *(
                state_line(one.key, one.state)
                for one in sessions.values()
                if one.state != OPEN  # as its opening line has it
            ),
        ]

    # Visits ----------------------------------------------------------------------------

    def browsers_at_once(self) -> dict[int, int]:
        """How many browsers took turns with a session, by number; only where several did."""
        with self._reading() as connection:
            return browsers_at_once(connection)

    def count_refusal(self, reason: str) -> None:
        """Count a visit that was refused."""
        with self._writing() as connection:
            count_refusal(connection, reason)

    def refusals(self) -> dict[str, int]:
        """How many visits were refused, by reason, of those reasons that are counted."""
        with self._reading() as connection:
            return refusals(connection)

    # All of it -----------------------------------------------------------------------

    def delete(self, sessions: Iterable[int]) -> dict[str, int]:
        """Delete sessions and all that belongs to them; returns the rows deleted by table.

        SQLite overwrites them with zeros (`secure_delete`), but for its write-ahead log; see
        `write_anew`.

        Raises
        ------
        StoreError
            If they could not be deleted.
        """
        numbers = list(sessions)
        deleted = {}
        with self._writing() as connection:
            # Whoever saves a record of one now is waited for; those who come later find none.
            rows = sa.select(SESSIONS.c.id).where(SESSIONS.c.id.in_(numbers))
            connection.execute(rows.order_by(SESSIONS.c.id).with_for_update())
            for table, column in (
                (RECORDS, RECORDS.c.session),
                (CONFLICTS, CONFLICTS.c.session),
                (TOKENS, TOKENS.c.session),
                (BROWSERS, BROWSERS.c.session),
                (SESSIONS, SESSIONS.c.id),
            ):
                result = connection.execute(table.delete().where(column.in_(numbers)))
                deleted[table.name] = result.rowcount
        return deleted

    def forget_log(self) -> bool:
        """Take out of SQLite's write-ahead log what was deleted; whether it could be done.

        It is not waited for whoever reads at the moment.
        """
        if self._file is None:
            return True
        with self._alone() as connection:
            connection.exec_driver_sql("PRAGMA busy_timeout = 0")
            try:
                busy = connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)").one()[0]
            finally:
                connection.exec_driver_sql(f"PRAGMA busy_timeout = {BUSY_TIMEOUT}")
            return not busy

    def write_anew(self) -> None:
        """Write the database's files anew, so that nothing deleted stays in them.

        SQLite's write-ahead log is emptied; PostgreSQL's is its server's.

        Raises
        ------
        StoreError
            If another program that uses the database holds it up for too long.
        """
        try:
            with self._alone() as connection:
                write_anew(connection)
        except StoreError as error:
            raise StoreError(
                f"{self.shown_url}: rows were deleted, but the files could not be written anew "
                f"without them ({error}); say it again when no other program has the database "
                "open for long"
            ) from None

    @contextmanager
    def _alone(self) -> Iterator[sa.Connection]:
        """A connection for what can be done in no transaction."""
        try:
            with self.engine.connect().execution_options(
                isolation_level="AUTOCOMMIT"
            ) as connection:
                yield connection
        except sa.exc.SQLAlchemyError as error:
            raise StoreError(error_text(error)) from None


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
        todo = how_to_restore(study) or "nobody has taken part yet"
        raise InputError(f"{study / DATABASE}: not there; {todo}")
    storage = Storage.of_study(study, url)
    try:
        yield storage
    finally:
        storage.close()


def _go_on(connection: sa.Connection, session: Session, places: int | None, now: float) -> None:
    """Open a session again if it was dropped.

    Raises
    ------
    Refusal
        If its place is somebody else's (`late`).
    """
    if session.state == DROPPED and not reopen_session(connection, session, places, now):
        raise Refusal("late")
