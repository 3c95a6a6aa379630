"""Writing files so that a crash never leaves half of one behind, and some for their owner alone."""

import logging
import os
import re
import secrets
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pourcast.errors import InputError

PRIVATE = 0o600
"""Mode of a file that its owner alone reads and writes."""

PRIVATE_FOLDER = 0o700
"""Mode of a folder that its owner alone enters."""

_LOGGER = logging.getLogger("pourcast.files")


@contextmanager
def replacing(
    path: Path, name: Callable[[Path], str] | None = None, *, private: bool = False
) -> Iterator[Path]:
    """Hand out a temporary name beside `path`, and rename it to `path` at the end.

    Nobody may read it who could not read what stood at `path`.

    Parameters
    ----------
    path
        The file to write. Missing parent folders are made.
    name
        Gives the file its final name, in place of the last part of `path`, once
        all is written; called with the temporary file.
    private
        The file is for its owner alone, from its first byte on; so are folders that are made.

    Yields
    ------
    Path
        Where to write, with the same extension. If the body raises, it is
        removed, and whatever stood at `path` stays as it was.

    Raises
    ------
    InputError
        If the folder can't be made or written.
    """
    try:
        if private:
            make_private_folder(path.parent)
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError("it is a folder")
        temporary = path.with_name(f".{path.stem}-{secrets.token_hex(8)}{path.suffix}")
        # The system takes the umask off. Asking for it would mean to set it, for all threads.
        mode = PRIVATE if private else _mode_of(path) | PRIVATE
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error
    try:
        yield temporary
        with temporary.open("rb+") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path if name is None else path.with_name(name(temporary)))
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


def _mode_of(path: Path) -> int:
    """Who may read and write a file; anybody, as far as the umask lets them, before it is there."""
    try:
        return stat.S_IMODE(path.stat().st_mode) & 0o666
    except OSError:
        return 0o666


def left_behind(path: Path) -> list[Path]:
    """Temporary files of `replacing` that a process which was killed left beside `path`."""
    name = re.compile(rf"\.{re.escape(path.stem)}-[0-9a-f]{{16}}{re.escape(path.suffix)}")
    try:
        return sorted(one for one in path.parent.iterdir() if name.fullmatch(one.name))
    except FileNotFoundError:
        return []


def is_temporary(path: Path) -> bool:
    """Whether a file bears a temporary name of `replacing`."""
    return re.fullmatch(r"\..+-[0-9a-f]{16}(\.[^.]*)?", path.name) is not None


def make_private_folder(folder: Path) -> None:
    """Make a folder that its owner alone enters; one that is there stays as it is."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with suppress(FileExistsError):
        folder.mkdir(mode=PRIVATE_FOLDER)


def create_private(path: Path) -> None:
    """Make an empty file for its owner alone, if there is none.

    Whoever opens it afterwards by its name, such as SQLite, keeps its mode.
    """
    with suppress(FileExistsError):
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE))


def keep_private(path: Path) -> None:
    """Take from all others the right to read and write a file, and say so if they had it.

    Where that can't be done (another's file, a file system without modes), it is said, and
    nothing fails. The file is not opened: closing it would drop locks that SQLite holds on it.
    """
    if os.name == "nt":  # Windows keeps no such modes; a folder's rights hold for its files.
        return
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
        if not mode & 0o077:
            return
        path.chmod(mode & 0o700)
        tightened = not path.stat().st_mode & 0o077
    except FileNotFoundError:
        return
    except OSError:
        tightened = False
    if tightened:
        _LOGGER.warning(
            "%s: others on this computer could read it (mode %04o); now its owner alone can",
            path,
            mode,
        )
    elif path not in _TOLD:
        _TOLD.add(path)
        _LOGGER.warning(
            "%s: others on this computer can read it (mode %04o), and that can't be changed from "
            "here; keep the study where only you can read",
            path,
            mode,
        )


_TOLD: set[Path] = set()
"""Files of which it was said that others can read them: once is enough."""


def write_text(path: Path, text: str, *, private: bool = False) -> None:
    """Write a text file (UTF-8, line feeds) through `replacing`."""
    with replacing(path, private=private) as temporary:
        temporary.write_bytes(text.encode())


def finished_files(folder: Path, pattern: str = "*") -> list[Path]:
    """Files of a folder, in the order of their names, but those that are still being written."""
    return sorted(path for path in folder.glob(pattern) if not path.name.startswith("."))


def check_empty(folder: Path) -> None:
    """Refuse a folder that holds something already; one that isn't there will be made.

    Raises
    ------
    InputError
        If it is there and not empty, or no folder.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder}: exists and is not an empty folder; choose another name")


def check_writable(path: Path) -> None:
    """Refuse a file name that can't be written, before long work is done for it.

    Raises
    ------
    InputError
        If the folder can't be made or written.
    """
    with suppress(_OnlyTryingError), replacing(path):
        raise _OnlyTryingError


class _OnlyTryingError(Exception):
    """Leaves `replacing` before anything is renamed."""
