"""Writing files so that a crash never leaves half of one behind."""

import os
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pourcast.errors import InputError


@contextmanager
def replacing(path: Path, name: Callable[[Path], str] | None = None) -> Iterator[Path]:
    """Hand out a temporary name beside `path`, and rename it to `path` at the end.

    Parameters
    ----------
    path
        The file to write. Missing parent folders are made.
    name
        Gives the file its final name, in place of the last part of `path`, once
        all is written; called with the temporary file.

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
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError("it is a folder")
        temporary = path.with_name(f".{path.stem}-{secrets.token_hex(8)}{path.suffix}")
        # The system takes the umask off. Asking for it would mean to set it, for all threads.
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
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


def write_text(path: Path, text: str) -> None:
    """Write a text file (UTF-8, line feeds) through `replacing`."""
    with replacing(path) as temporary:
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
