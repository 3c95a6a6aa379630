"""How the database of an experiment is opened, so that nothing is lost."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import sqlalchemy as sa

from pourcast.errors import InputError
from pourcast.files import create_private, keep_private

_NETWORK_FILE_SYSTEMS = frozenset(
    {
        "9p", "afs", "beegfs", "ceph", "cifs", "davfs", "fuse.ceph", "fuse.davfs2",
        "fuse.glusterfs", "fuse.sshfs", "glusterfs", "gpfs", "lustre", "ncpfs", "nfs", "nfs3",
        "nfs4", "smb", "smb2", "smb3", "smbfs",
    }
)  # fmt: skip
"""File systems on which SQLite's write-ahead log is not safe."""


def open_engine(url: str) -> sa.Engine:
    """Connect to a database.

    Parameters
    ----------
    url
        SQLAlchemy's URL, of SQLite or PostgreSQL.

    Raises
    ------
    InputError
        If the URL or the file system is not fit for it.
    """
    try:
        parsed = sa.make_url(url)
        if parsed.drivername == "postgresql":
            parsed = parsed.set(drivername="postgresql+psycopg")
        kind = parsed.get_backend_name()
        if kind not in ("sqlite", "postgresql"):
            raise InputError(f"database: expected sqlite or postgresql, found {kind}")
        # No participant's answer in what is logged of a failure.
        engine = sa.create_engine(parsed, hide_parameters=True)
    except (sa.exc.ArgumentError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        # What is wrong is not quoted: a password may stand in it.
        raise InputError(
            "database: expected a URL such as postgresql://user@host/name; in a password, write "
            "@ as %40, / as %2F, : as %3A"
        ) from None
    except ImportError:
        raise InputError(
            "database: PostgreSQL needs pourcast's extra: pip install 'pourcast[postgresql]'"
        ) from None
    if kind == "sqlite":
        _refuse_network_file_system(Path(parsed.database or ""))
        _keep_private(parsed)
        sa.event.listen(engine, "connect", _set_sqlite_pragmas)
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
    return " ".join(str(said).split())


def database_files(path: Path) -> list[Path]:
    """The files that SQLite keeps a database in: its own, the write-ahead log and its index."""
    return [path.with_name(path.name + end) for end in ("", "-wal", "-shm", "-journal")]


def _keep_private(url: sa.URL) -> None:
    """Let the owner alone read SQLite's files; the log gets the mode that the database has."""
    if url.database in (None, "", ":memory:"):
        return
    path = Path(str(url.database))
    if path.parent.is_dir() and not path.exists():
        with suppress(OSError):  # SQLite says itself what is wrong with the folder
            create_private(path)
    for file in database_files(path):
        keep_private(file)


def _set_sqlite_pragmas(connection: Any, _: Any) -> None:
    cursor = connection.cursor()
    for pragma in (
        "busy_timeout = 10000",
        "journal_mode = WAL",
        "synchronous = FULL",
        "foreign_keys = ON",
        "secure_delete = ON",
        # No copies of rows in the system's folder for temporary files.
        "temp_store = MEMORY",
    ):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _refuse_network_file_system(path: Path) -> None:
    """Refuse SQLite on a network's file system, where its write-ahead log loses data."""
    place = path.resolve()
    mounts = {Path(one.mountpoint): one.fstype for one in psutil.disk_partitions(all=True)}
    nearest = next((parent for parent in place.parents if parent in mounts), None)
    if nearest is not None and mounts[nearest].lower() in _NETWORK_FILE_SYSTEMS:
        raise InputError(
            f"{path}: lies on a network file system ({mounts[nearest]}), where SQLite can lose "
            "data; put the study on a local disk, or give a PostgreSQL server by --database"
        )
