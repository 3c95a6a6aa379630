"""SQLite's file of an experiment: made for its owner alone, watched while it is served, copied."""

import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from pourcast.errors import StoreError
from pourcast.files import create_private, replacing

_PUT_BACK = (
    "nothing is saved until the file is put back; if it is lost, end the server (Ctrl-C) and start "
    "it again: it makes the database again from responses.jsonl"
)


class TakenAwayError(StoreError):
    """The database is not where it was; all is well again once it is back."""


class DatabaseFile:
    """A database's file, and whether its name still leads to the file that was opened.

    SQLite goes on writing to a file that was deleted or moved, and nobody would find again what it
    wrote.

    Parameters
    ----------
    path
        The file; an empty one is made if it isn't there.

    Raises
    ------
    StoreError
        If it can't be made.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            # One that is there is not opened: to close it would take SQLite's locks off it.
            create_private(path)
            self._identity = _identity(os.stat(path))
        except OSError as error:
            raise StoreError(f"{path}: cannot be opened ({error.strerror or error})") from None
        self._lost_log = False
        self.has_log = False
        """Whether SQLite keeps a write-ahead log beside it while a connection is open."""

    @property
    def uri(self) -> str:
        """For SQLite: the file if it is there, and never a new one."""
        return f"{self.path.absolute().as_uri()}?mode=rw"

    def check(self, *, is_open: bool = False) -> None:
        """See that what is written gets into the file that everybody sees.

        Parameters
        ----------
        is_open
            Whether a connection is open, so that SQLite's write-ahead log has to be there, too.

        Raises
        ------
        TakenAwayError
            If it doesn't; says why, and what to do.
        """
        try:
            found = os.stat(self.path)
        except OSError as error:
            raise TakenAwayError(
                f"{self.path}: was deleted or moved while it was open "
                f"({error.strerror or error}); {_PUT_BACK}"
            ) from None
        if _identity(found) != self._identity:
            raise TakenAwayError(
                f"{self.path}: was replaced by another file while it was open; {_PUT_BACK}"
            )
        if not os.access(self.path, os.W_OK):
            raise TakenAwayError(
                f"{self.path}: was made read-only while it was open; nothing is saved until it can "
                "be written"
            )
        # Once it was away, one of its name may be another program's: only a new start can tell.
        self._lost_log |= is_open and self.has_log and not Path(f"{self.path}-wal").exists()
        if self._lost_log:
            raise TakenAwayError(
                f"{self.path}: its write-ahead log {self.path.name}-wal was deleted while it was "
                "open; nothing is saved until the server is ended (Ctrl-C: it writes what the log "
                "held) and started again"
            )


def remedy(path: Path, error: sqlite3.Error) -> str:
    """What to do where SQLite's own words don't tell; empty where they do."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    log, index = (Path(f"{path}{end}") for end in ("-wal", "-shm"))
    # SQLite has just made an empty one, if there was none.
    has_log = log.exists() and log.stat().st_size > 0
    if code == sqlite3.SQLITE_IOERR and index.exists() and not has_log:
        return (
            f"; its write-ahead log {log.name} was deleted: end the server that has it open "
            "(Ctrl-C: it writes what the log held) and start it again"
        )
    return ""


def can_be_written(path: Path) -> bool:
    """Whether a database can be used where it lies; one that isn't there is made."""
    return not path.exists() or (os.access(path, os.W_OK) and os.access(path.parent, os.W_OK))


def in_memory(path: Path) -> sqlite3.Connection:
    """A copy of a database that can't be written, in memory: nothing of it gets elsewhere.

    Raises
    ------
    StoreError
        If it can't be read.
    """
    copy = sqlite3.connect(":memory:", check_same_thread=False, isolation_level=None)
    try:
        try:
            _copy_content(path, copy)
        except sqlite3.OperationalError:
            # A write-ahead log without its index, which can't be made here. Nobody has the file
            # open then: they would have made one.
            with TemporaryDirectory() as folder:
                for name in (path.name, f"{path.name}-wal"):
                    if (path.parent / name).exists():
                        shutil.copyfile(path.parent / name, Path(folder, name))
                _copy_content(Path(folder, path.name), copy, mode="rw")
    except (OSError, sqlite3.Error) as error:
        raise StoreError(f"{path}: cannot be read ({error})") from None
    return copy


def keep_copy(connection: sqlite3.Connection, path: Path, version: int) -> Path:
    """A copy of a database beside it, under a name that nothing has yet."""
    names = (
        path.with_name(f"{path.stem}-schema-{version}{number}{path.suffix}")
        for number in ("", *(f"-{k}" for k in range(2, 1000)))
    )
    copy = next(name for name in names if not name.exists())
    with replacing(copy, private=True) as temporary, closing(sqlite3.connect(temporary)) as target:
        connection.backup(target)
    return copy


def _copy_content(path: Path, copy: sqlite3.Connection, mode: str = "ro") -> None:
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode={mode}", uri=True)) as source:
        source.backup(copy)


def _identity(found: os.stat_result) -> tuple[int, int]:
    return found.st_dev, found.st_ino
