"""How the database of an experiment is opened, so that nothing is lost."""

from pathlib import Path
from typing import Any

import psutil
import sqlalchemy as sa

from pourcast.errors import InputError

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
        engine = sa.create_engine(parsed)
    except sa.exc.ArgumentError as error:
        raise InputError(
            f"database: expected a URL such as postgresql://user@host/name ({error})"
        ) from None
    except ImportError:
        raise InputError(
            "database: PostgreSQL needs pourcast's extra: pip install 'pourcast[postgresql]'"
        ) from None
    if kind == "sqlite":
        _refuse_network_file_system(Path(parsed.database or ""))
        sa.event.listen(engine, "connect", _set_sqlite_pragmas)
    return engine


def error_text(error: BaseException) -> str:
    """What the database said, in one line."""
    cause = getattr(error, "orig", None) or error
    return " ".join(str(cause).split())


def _set_sqlite_pragmas(connection: Any, _: Any) -> None:
    cursor = connection.cursor()
    for pragma in (
        "busy_timeout = 10000",
        "journal_mode = WAL",
        "synchronous = FULL",
        "foreign_keys = ON",
        "secure_delete = ON",
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
