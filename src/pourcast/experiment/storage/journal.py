"""A second copy of every record: one line of JSON each, appended as it comes.

The database is the first copy, and a record is acknowledged when the database has it. What the
journal could not take waits in memory and is tried again; until then the journal says so
(`Journal.waiting`, `Journal.failures`), and what a server that ends has not written is appended at
the next start (`Journal.catch_up`).
"""

import json
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock

from pourcast.errors import InputError, StoreError
from pourcast.experiment.storage.failures import LOGGER, Failures
from pourcast.experiment.storage.records import Record
from pourcast.experiment.storage.sessions import Session
from pourcast.experiment.storage.storage import Storage
from pourcast.files import PRIVATE, keep_private, replacing

NAME = "responses.jsonl"

_LONGEST_WAIT = 2.0
"""After so long a journal that another process has is given up for now [s]."""


class Journal:
    """The journal of a study's records.

    Parameters
    ----------
    path
        The file; made when the first record comes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failures = Failures("new records are in the database alone until it can be")
        self._lock = FileLock(path.with_suffix(".lock"), mode=PRIVATE)
        self._waiting: list[str] = []
        keep_private(path)
        keep_private(path.with_suffix(".lock"))

    @classmethod
    def of_study(cls, study: Path) -> "Journal":
        """The journal of a study."""
        return cls(study / NAME)

    @property
    def waiting(self) -> int:
        """How many records wait to be appended, since it could not be done."""
        return len(self._waiting)

    def append(self, records: Iterable[Record]) -> None:
        """Append records, and those that could not be appended before.

        A full disk is no reason to refuse a record that the database has: the failure is
        noted in `failures`, and the record is appended with the next ones, by `retry` or
        by `catch_up`.
        """
        self._waiting += [_line(record) for record in records]
        self.retry()

    def retry(self) -> None:
        """Append what could not be appended before."""
        if not self._waiting:
            return
        try:
            with self._lock.acquire(timeout=_LONGEST_WAIT):
                _append(self.path, "".join(self._waiting).encode())
        except OSError as error:
            self.failures.add(f"{self.path}: cannot be written ({error.strerror or error})")
            return
        self._waiting.clear()
        self.failures.end()

    def keep_waiting_of(self, sessions: Collection[int]) -> None:
        """Forget what waits of other sessions, which were deleted in the meantime."""
        self._waiting = [line for line in self._waiting if json.loads(line)["session"] in sessions]

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield the lines; one that was cut short by a crash is left out.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        yield from (line for line in self._parsed() if line is not None)

    def missing(self, records: Iterable[Record]) -> list[Record]:
        """Those of some records that the file doesn't have.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        keys = {(line["session"], line["seq"]) for line in self.lines()}
        return [record for record in records if (record.session, record.seq) not in keys]

    def catch_up(self, records: Iterable[Record]) -> int:
        """Append the records that are missing, after a crash between two commits.

        Returns
        -------
        int
            How many there were.

        Raises
        ------
        StoreError
            If the file can't be read.
        """
        damaged = sum(line is None for line in self._parsed())
        if damaged:
            LOGGER.warning(
                "%s: %s lines are cut short; the records are appended again", self.path, damaged
            )
        missing = self.missing(records)
        self.append(missing)
        return len(missing)

    def remove(self, match: Callable[[Mapping[str, Any]], bool]) -> int:
        """Take out the lines that match, and those that are cut short; returns how many matched.

        Raises
        ------
        StoreError
            If it can't be done; then all lines stay.
        """
        removed = 0
        if self.path.is_file():
            try:
                with self._lock.acquire(timeout=_LONGEST_WAIT):
                    removed = self._remove_from_file(match)
            except (OSError, InputError) as error:
                cause = getattr(error, "strerror", None) or error
                raise StoreError(f"{self.path}: lines cannot be taken out ({cause})") from error
        waiting = [line for line in self._waiting if not match(json.loads(line))]
        removed += len(self._waiting) - len(waiting)
        self._waiting = waiting
        return removed

    def _remove_from_file(self, match: Callable[[Mapping[str, Any]], bool]) -> int:
        lines = list(self.lines())
        kept = [line for line in lines if not match(line)]
        with replacing(self.path, private=True) as temporary:
            temporary.write_bytes("".join(_dumps(line) for line in kept).encode())
        return len(lines) - len(kept)

    def _parsed(self) -> Iterator[dict[str, Any] | None]:
        """Yield the lines; None for one that is damaged."""
        try:
            with self.path.open(encoding="utf-8", errors="replace") as stream:
                for text in stream:
                    if text.strip():
                        yield _parse(text)
        except FileNotFoundError:
            return
        except OSError as error:
            raise StoreError(f"{self.path}: cannot be read ({error.strerror or error})") from None


def journal_records(storage: Storage) -> list[Record]:
    """All that a journal should have of a database."""
    return [*map(opening_record, storage.sessions()), *storage.records()]


def opening_record(session: Session) -> Record:
    """First line of a session in the journal: who it is, should the database be lost."""
    body = {
        "participant": session.participant,
        "entry": session.entry,
        "group": session.group,
        "place": session.place,
        "identifiers": dict(session.identifiers),
    }
    return Record(session.number, -1, "session", json.dumps(body), session.started)


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
        except OSError:
            os.ftruncate(handle, size)
            raise
    finally:
        os.close(handle)


def _parse(text: str) -> dict[str, Any] | None:
    """A line's content; None if it is no record's."""
    try:
        content = json.loads(text)
    except ValueError:
        return None
    whole = isinstance(content, dict) and {"session", "seq"} <= content.keys()
    return content if whole else None


def _line(record: Record) -> str:
    return _dumps(
        {
            "session": record.session,
            "seq": record.seq,
            "kind": record.kind,
            "body": json.loads(record.body),
            "received": record.received,
        }
    )


def _dumps(line: Mapping[str, Any]) -> str:
    return json.dumps(line, separators=(",", ":"), ensure_ascii=False) + "\n"
