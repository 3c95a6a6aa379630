"""A second copy of all that the database has: a line of JSON each, appended as it comes.

The database is the first copy, and a record is acknowledged when the database has it. What the
journal could not take waits in memory and is tried again; until then the journal says so
(`Journal.waiting`, `Journal.failures`), and what a server that ends has not written is appended at
the next start (`Journal.catch_up`). The journal alone is enough to make the database again:
`record_lines` says what is in it, `data.record_import` reads it.
"""

import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from pourcast.errors import InputError, StoreError
from pourcast.experiment.storage.failures import LOGGER, Failures
from pourcast.experiment.storage.record_lines import (
    FORMAT,
    JOURNAL_FORMAT,
    LAST,
    Line,
    dumps,
    is_line,
    line_names,
    names_of,
)
from pourcast.files import PRIVATE, keep_private, left_behind, replacing

NAME = "responses.jsonl"

_LONGEST_WAIT = 2.0
"""After so long a journal that another process has is given up for now [s]."""


class Journal:
    """The journal of a study.

    Parameters
    ----------
    path
        The file; made when the first line comes.
    sessions
        Says the keys of the sessions that there are. It is asked whenever lines are appended, while
        nobody else changes the file: lines of who withdrew in the meantime are left out.
    """

    def __init__(self, path: Path, sessions: Callable[[], Collection[str]] | None = None) -> None:
        self.path = path
        self._sessions = sessions
        self.failures = Failures("new records are in the database alone until it can be")
        self._lock = FileLock(path.with_suffix(".lock"), mode=PRIVATE)
        self._waiting: list[Line] = []
        keep_private(path)
        keep_private(path.with_suffix(".lock"))

    @classmethod
    def of_study(
        cls, study: Path, sessions: Callable[[], Collection[str]] | None = None
    ) -> "Journal":
        """The journal of a study."""
        return cls(study / NAME, sessions)

    @property
    def waiting(self) -> int:
        """How many lines wait to be appended, since it could not be done."""
        return len(self._waiting)

    def append(self, lines: Iterable[Line]) -> None:
        """Append lines, and those that could not be appended before.

        A full disk is no reason to refuse a record that the database has: the failure is
        noted in `failures`, and the record is appended with the next ones, by `retry` or
        by `catch_up`.
        """
        self._waiting += lines
        self.retry()

    def retry(self) -> None:
        """Append what could not be appended before."""
        if not self._waiting:
            return
        try:
            with self._lock.acquire(timeout=_LONGEST_WAIT):
                if self._sessions is not None:
                    self.keep_waiting_of(self._sessions())
                _append(self.path, _encoded(self._waiting))
        except OSError as error:
            self.failures.add(f"{self.path}: cannot be written ({error.strerror or error})")
            return
        self._waiting.clear()
        self.failures.end()

    def keep_waiting_of(self, sessions: Collection[str]) -> None:
        """Forget what waits of other sessions, which were deleted in the meantime."""
        kept = {"", *sessions}
        self._waiting = [line for line in self._waiting if line.get("session", "") in kept]

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield the lines; what is no line, such as one that a crash cut short, is left out.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        for text in self.read().split(b"\n"):
            line = _parse(text)
            if line is not None:
                yield line

    def read(self) -> bytes:
        """All of the file, as it is when nobody writes; nothing if it is not there.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        try:
            with self.held():
                return self.path.read_bytes()
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise StoreError(f"{self.path}: cannot be read ({error.strerror or error})") from None

    def missing(self, lines: Iterable[Line]) -> list[Line]:
        """Those of some lines that the file doesn't have.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        return _lacking(self.lines(), lines)

    def catch_up(self, lines: Iterable[Line]) -> int:
        """Append the lines that are missing, after a crash between two commits.

        Returns
        -------
        int
            How many there were.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        parsed = [_parse(text) for text in self.read().split(b"\n") if text.strip()]
        there = [line for line in parsed if line is not None]
        if damaged := len(parsed) - len(there):
            LOGGER.warning(
                "%s: %s lines can't be read, such as one that a crash cut short; they stay, and "
                "what the database has is appended again",
                self.path,
                damaged,
            )
        missing = _lacking(there, lines)
        waiting = names_of(self._waiting)
        self.append(line for line in missing if not line_names(line) <= waiting)
        return len(missing)

    def remove(self, sessions: Collection[str], names: Collection[str] = ()) -> int:
        """Take out all lines of sessions, and those that can't be read and name one of them.

        Parameters
        ----------
        sessions
            Keys of the sessions.
        names
            What else their participant is called, such as a platform's id.

        Returns
        -------
        int
            How many there were.

        Raises
        ------
        StoreError
            If it can't be done; then all lines stay.
        """
        removed = 0
        if self.path.is_file():
            marks = [key.encode() for key in sessions]
            marks += [json.dumps(name, ensure_ascii=False).encode() for name in names]
            try:
                with self._lock.acquire(timeout=_LONGEST_WAIT):
                    removed = self._remove_from_file(sessions, marks)
            except (OSError, InputError) as error:
                cause = getattr(error, "strerror", None) or error
                raise StoreError(f"{self.path}: lines cannot be taken out ({cause})") from error
        waiting = [line for line in self._waiting if line.get("session") not in sessions]
        removed += len(self._waiting) - len(waiting)
        self._waiting = waiting
        return removed

    def _remove_from_file(self, sessions: Collection[str], marks: Collection[bytes]) -> int:
        lines = [(text, _parse(text)) for text in self.path.read_bytes().split(b"\n")]
        # No new database gives a number out again that somebody had who is gone.
        last = max(_last_number(line) for _, line in lines)
        kept = [
            _with_last(text, line, last)
            for text, line in lines
            if not _is_of(text, line, sessions, marks)
        ]
        self.rewrite(b"\n".join(kept))
        return len(lines) - len(kept)

    def rewrite(self, content: bytes) -> None:
        """Put something else in the place of the file, all of it or nothing."""
        with self._lock:
            for old in left_behind(self.path):  # whoever wrote it was killed: we have the lock
                old.unlink(missing_ok=True)
            with replacing(self.path, private=True) as temporary:
                temporary.write_bytes(content)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Let nobody else change the file, and nobody be taken out of it, who waits for that.

        Where no lock can be made, as in a read-only copy, nobody changes it.
        """
        locked = False
        with suppress(OSError, Timeout):
            self._lock.acquire(timeout=_LONGEST_WAIT)
            locked = True
        try:
            yield
        finally:
            if locked:
                self._lock.release()


def journal_words(path: Path) -> dict[str, str]:
    """The secrets of the database that a journal was written for; empty if it doesn't tell.

    Raises
    ------
    StoreError
        If the file can't be read.
    """
    for line in Journal(path).lines():
        if line.get("format") == JOURNAL_FORMAT:
            return {name: word for name, word in line.items() if isinstance(word, str)}
    return {}


def how_to_restore(study: Path) -> str:
    """What to do where the database is not there but its journal is; empty if that isn't either.

    Raises
    ------
    StoreError
        If the journal can't be read.
    """
    journal = study / NAME
    sessions = sum(line.get("format") == FORMAT for line in Journal(journal).lines())
    if not sessions:
        return ""
    return (
        f"{journal} has its {sessions} sessions: restore them by `pourcast experiment data {study} "
        f"--import {journal}`, or start the server, which does so"
    )


def _append(path: Path, lines: bytes) -> None:
    """Append all of it, or nothing."""
    handle = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, PRIVATE)
    try:
        size = os.fstat(handle).st_size
        if size:
            os.lseek(handle, -1, os.SEEK_END)
            if os.read(handle, 1) != b"\n":
                lines = b"\n" + lines  # what a crash cut short stays a line of its own
        try:
            if os.write(handle, lines) < len(lines):
                raise OSError("disk full")
            os.fsync(handle)
        except OSError:
            os.ftruncate(handle, size)
            raise
    finally:
        os.close(handle)


def _encoded(lines: Iterable[Line]) -> bytes:
    return "".join(map(dumps, lines)).encode("utf-8", "replace")


def _parse(text: bytes) -> dict[str, Any] | None:
    """A line's content; None if it is none."""
    try:
        content = json.loads(text.decode("utf-8", "replace"))
    except (ValueError, RecursionError):
        return None
    return content if is_line(content) else None


def _lacking(there: Iterable[Line], lines: Iterable[Line]) -> list[Line]:
    """Those of some lines that are not said there."""
    names = names_of(there)
    return [line for line in lines if not line_names(line) <= names]


def _last_number(line: Line | None) -> int:
    """The number of the session that a line opens, or the last one that a first line tells of."""
    if line is None:
        return 0
    number = line.get(LAST if line.get("format") == JOURNAL_FORMAT else "number")
    return number if isinstance(number, int) else 0


def _with_last(text: bytes, line: Line | None, last: int) -> bytes:
    """A line as it is; a journal's first one with the last number that a session had."""
    if line is None or line.get("format") != JOURNAL_FORMAT:
        return text
    return _encoded([{**line, LAST: last}]).rstrip(b"\n")


def _is_of(
    text: bytes, line: Line | None, sessions: Collection[str], marks: Collection[bytes]
) -> bool:
    """Whether a line is one of these sessions', or can't be read and has one of these marks."""
    if line is None:
        return any(mark in text for mark in marks)
    return line.get("session") in sessions
