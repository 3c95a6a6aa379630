"""A second copy of every record: one line of JSON each, appended as it comes."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock

from pourcast.experiment.storage.storage import Record
from pourcast.files import replacing

NAME = "responses.jsonl"


class Journal:
    """The journal of a study's records.

    Parameters
    ----------
    path
        The file; made when the first record comes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = FileLock(path.with_suffix(".lock"))
        self._late: list[Record] = []

    @classmethod
    def of_study(cls, study: Path) -> "Journal":
        """The journal of a study."""
        return cls(study / NAME)

    def append(self, records: Iterable[Record]) -> None:
        """Append records, and those that could not be appended before.

        A full disk is no reason to refuse a record that the database has: it is
        appended with the next ones, or by `catch_up`.
        """
        self._late += records
        if not self._late:
            return
        lines = "".join(_line(record) for record in self._late).encode()
        try:
            with self._lock:
                _append(self.path, lines)
        except OSError:
            return
        self._late.clear()

    def lines(self) -> Iterator[dict[str, Any]]:
        """Yield the lines; one that was cut short by a crash is left out."""
        if not self.path.is_file():
            return
        with self.path.open(encoding="utf-8", errors="replace") as stream:
            for line in stream:
                try:
                    yield json.loads(line)
                except ValueError:
                    continue

    def catch_up(self, records: Iterable[Record]) -> int:
        """Append the records that are missing, after a crash between two commits.

        Returns
        -------
        int
            How many there were.
        """
        there = {(line["session"], line["seq"]) for line in self.lines()}
        missing = [record for record in records if (record.session, record.seq) not in there]
        self.append(missing)
        return len(missing)

    def remove(self, match: Callable[[Mapping[str, Any]], bool]) -> int:
        """Take out the lines that match; returns how many."""
        if not self.path.is_file():
            return 0
        with self._lock:
            lines = list(self.lines())
            kept = [line for line in lines if not match(line)]
            with replacing(self.path) as temporary:
                text = "".join(_dumps(line) for line in kept)
                temporary.write_bytes(text.encode())
        return len(lines) - len(kept)


def _append(path: Path, lines: bytes) -> None:
    """Append all of it, or nothing."""
    handle = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o644)
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
