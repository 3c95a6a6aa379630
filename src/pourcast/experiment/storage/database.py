"""How the database of an experiment is opened, so that nothing is lost."""

import sqlite3
from pathlib import Path
from typing import Any

import psutil
import sqlalchemy as sa

from pourcast.errors import InputError, StoreError
from pourcast.experiment.storage.database_file import DatabaseFile
from pourcast.experiment.storage.schema import TABLES

_NETWORK_FILE_SYSTEMS = frozenset(
    {
        "9p", "afs", "beegfs", "ceph", "cifs", "davfs", "fuse.ceph", "fuse.davfs2",
        "fuse.glusterfs", "fuse.sshfs", "glusterfs", "gpfs", "lustre", "ncpfs", "nfs", "nfs3",
        "nfs4", "smb", "smb2", "smb3", "smbfs",
    }
)  # fmt: skip
"""File systems on which SQLite's write-ahead log is not safe."""

_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
_HOW_TO_REPLACE = (
    "; the file is damaged: end the server, move it away together with those of its name that end "
    "in -wal and -shm, and start the server: it makes the database again from responses.jsonl"
)

BUSY_TIMEOUT = 10_000
"""So long SQLite waits for others who use the database [ms]."""


def file_url(path: Path) -> sa.URL:
    """URL of SQLite's file, whatever is in its name."""
    return sa.URL.create("sqlite", database=str(path))


def database_url(text: str | sa.URL) -> sa.URL:
    """A database's URL, checked.

    Raises
    ------
    InputError
        If it is none of SQLite or PostgreSQL.
    """
    try:
        url = sa.make_url(text)
        if url.drivername == "postgresql":
            url = url.set(drivername="postgresql+psycopg")
        kind = url.get_backend_name()
    except (sa.exc.ArgumentError, ValueError):
        # What is wrong is not quoted: a password may stand in it.
        raise InputError(
            "database: expected a URL such as postgresql://user@host/name; in a password, write "
            "@ as %40, / as %2F, : as %3A"
        ) from None
    if kind not in ("sqlite", "postgresql"):
        raise InputError(f"database: expected sqlite or postgresql, found {kind}")
    return url


def server_engine(url: sa.URL) -> sa.Engine:
    """Connect to a PostgreSQL server.

    Raises
    ------
    InputError
        If what speaks to it isn't installed.
    """
    try:
        # No participant's answer in what is logged of a failure.
        return sa.create_engine(url, hide_parameters=True)
    except ImportError:
        raise InputError(
            "database: PostgreSQL needs pourcast's extra: pip install 'pourcast[postgresql]'"
        ) from None


def file_engine(file: DatabaseFile) -> sa.Engine:
    """Connect to SQLite's file, so that nothing is lost."""
    engine = sa.create_engine(file_url(file.path), hide_parameters=True)

    def connect(_: Any, __: Any, arguments: list[Any], options: dict[str, Any]) -> None:
        arguments[:] = [file.uri]
        options["uri"] = True

    def opened(connection: Any, _: Any) -> None:
        # Not another file, that was put there after the first connection.
        file.check()
        _set_sqlite_pragmas(connection)
        # A file system without shared memory has none.
        file.has_log = connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)

    sa.event.listen(engine, "do_connect", connect)
    sa.event.listen(engine, "connect", opened)
    sa.event.listen(engine, "begin", _begin)
    return engine


def connection_engine(connection: sqlite3.Connection) -> sa.Engine:
    """An engine over one connection to SQLite that is open already."""
    engine = sa.create_engine(
        "sqlite://", creator=lambda: connection, poolclass=sa.StaticPool, hide_parameters=True
    )
    sa.event.listen(engine, "begin", _begin)
    return engine


def shown_url(url: sa.URL) -> str:
    """A database's URL as it may be printed and logged: without passwords."""
    hidden = {name: "hidden" for name in url.query if "password" in name.lower()}
    return url.update_query_dict(hidden).render_as_string(hide_password=True)


def has_password(url: str) -> bool:
    """Whether a password stands in a database's URL."""
    try:
        parsed = sa.make_url(url)
    except (sa.exc.ArgumentError, ValueError):
        return False
    return parsed.password is not None or any("password" in name.lower() for name in parsed.query)


def error_text(error: BaseException) -> str:
    """What the database said, in one line; not the values that it quotes, which are people's."""
    cause = getattr(error, "orig", None) or error
    said = getattr(getattr(cause, "diag", None), "message_primary", None) or cause
    is_damaged = getattr(cause, "sqlite_errorcode", 0) & 0xFF in _DAMAGED
    return " ".join(str(said).split()) + (_HOW_TO_REPLACE if is_damaged else "")


def write_anew(connection: sa.Connection) -> None:
    """Write all tables anew, so that nothing deleted stays in free pages or in SQLite's log.

    Raises
    ------
    StoreError
        If a program that reads the database holds SQLite's log up, for longer than `busy_timeout`.
    sqlalchemy.exc.SQLAlchemyError
        If the database can't be had alone for a moment.
    """
    if connection.dialect.name == "postgresql":
        connection.exec_driver_sql("SET lock_timeout = '10s'")
        for table in TABLES.sorted_tables:
            connection.exec_driver_sql(f"VACUUM (FULL) {table.name}")
        return
    connection.exec_driver_sql("VACUUM")
    if connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)").one()[0]:
        raise StoreError("its write-ahead log is being read by another program")


def database_files(path: Path) -> list[Path]:
    """The files that SQLite keeps a database in: its own, the write-ahead log and its index."""
    return [path.with_name(path.name + end) for end in ("", "-wal", "-shm", "-journal")]


def _begin(connection: sa.Connection) -> None:
    """Begin what Python would begin at the first change only: what was read is what is changed.

    One that writes waits for the others first; it would fail if they had written in the meantime.
    """
    options = connection.get_execution_options()
    if options.get("isolation_level") != "AUTOCOMMIT":
        driver: Any = connection.connection.dbapi_connection
        driver.execute("BEGIN IMMEDIATE" if options.get("writes") else "BEGIN")


def _set_sqlite_pragmas(connection: Any) -> None:
    connection.isolation_level = None  # transactions begin by `_begin`
    cursor = connection.cursor()
    for pragma in (
        f"busy_timeout = {BUSY_TIMEOUT}",
        "journal_mode = WAL",
        "synchronous = FULL",
        "foreign_keys = ON",
        "secure_delete = ON",
        # No copies of rows in the system's folder for temporary files.
        "temp_store = MEMORY",
    ):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def refuse_network_file_system(path: Path) -> None:
    """Refuse SQLite on a network's file system, where its write-ahead log loses data."""
    place = path.resolve()
    mounts = {Path(one.mountpoint): one.fstype for one in psutil.disk_partitions(all=True)}
    nearest = next((parent for parent in place.parents if parent in mounts), None)
    if nearest is not None and mounts[nearest].lower() in _NETWORK_FILE_SYSTEMS:
        raise InputError(
            f"{path}: lies on a network file system ({mounts[nearest]}), where SQLite can lose "
            "data; put the study on a local disk, or give a PostgreSQL server by --database"
        )
