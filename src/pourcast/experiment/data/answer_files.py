"""Files of answers as they come: JSON in texts of any coding, in archives and folders.

What can be read is read, whatever stands beside it: a file is JSON Lines, or one JSON array, or
values one after another as JATOS joins them. What can't be read is named by file and line.
"""

import codecs
import gzip
import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from pourcast.errors import InputError
from pourcast.experiment.storage.record_bodies import storable

_BETWEEN = re.compile(r"[\s,\]\ufeff\x1e]*")
"""What may stand between two values: also what is left of an array that can't be read whole."""

_NEXT = re.compile(r'\n|\{\s*"(?:format|session|trial_type)"')
"""Where a value may begin again after one that can't be read: the next line, or a line of ours."""

_LINE = re.compile(rb'\{"(?:format|session)":')
"""What UTF-8 has, and nothing else, where a line of ours begins."""

_ESCAPED = re.compile(r"\\u(?:d[89a-f]|0000)", re.IGNORECASE)
"""What a file has if anything in it may not be storable; most have not, and are read faster."""

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Byte-order marks; UTF-32's begins like one of UTF-16."""

_NOT_ANSWERS = ("metadata.json",)
"""What JATOS puts into an archive beside the results: who came when, and no answers."""

_SYSTEMS = ("__MACOSX", ".")
"""How names of what systems leave in folders and archives begin."""


class Place(NamedTuple):
    """Where something stands: file, line from 1, and item from 1 if the line is an array."""

    file: str
    line: int = 0
    item: int = 0

    def __str__(self) -> str:
        """As messages name it."""
        return (
            self.file
            + (f": line {self.line}" if self.line else "")
            + (f", item {self.item}" if self.item else "")
        )


class Faults:
    """What was left out, and where; beside it, what else is to be told."""

    def __init__(self) -> None:
        self._left_out: list[tuple[Place, Place, str]] = []
        self._notes: list[tuple[Place, Place, str]] = []

    def add(self, place: Place, message: str) -> None:
        """Say why something was left out; what follows one another for the same reason is one."""
        if self._left_out:
            first, last, before = self._left_out[-1]
            if before == message and _follows(place, last):
                self._left_out[-1] = first, place, message
                return
        self._left_out.append((place, place, message))

    def note(self, place: Place, message: str) -> None:
        """Say what became of something that was taken in."""
        self._notes.append((place, place, message))

    def __len__(self) -> int:
        """How many lines or items were left out."""
        return sum(
            1 + (last.item - first.item if first.item else last.line - first.line)
            for first, last, _ in self._left_out
        )

    def lines(self, file: str) -> set[int]:
        """Numbers of a file's lines that something was left out of."""
        return {
            number
            for first, last, _ in self._left_out
            if first.file == file
            for number in range(first.line, last.line + 1)
        }

    def messages(self) -> list[str]:
        """A line each, in the order of files and lines."""
        told = sorted([*self._left_out, *self._notes])
        return [f"{first}{_to(first, last)}: {message}" for first, last, message in told]


def answer_files(path: Path, faults: Faults) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the files that a file, a folder or an archive has.

    Raises
    ------
    InputError
        If it can't be read.
    """
    try:
        if not path.is_dir():
            yield from _unpacked(str(path), path.read_bytes(), faults)
            return
        for file in sorted(path.rglob("*")):
            if file.is_file() and _is_answers(file.relative_to(path).parts):
                yield from _unpacked(str(file), file.read_bytes(), faults)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


def json_values(name: str, content: bytes, faults: Faults) -> Iterator[tuple[Place, Any]]:
    """The values in a file, those of arrays one by one, with their places.

    What no database can store is replaced by U+FFFD.
    """
    text, decoder = _text(name, content, faults), json.JSONDecoder()
    clean = storable if _ESCAPED.search(text) else _same
    position, line = 0, 1
    while True:
        between = _BETWEEN.match(text, position)
        start = between.end() if between else position
        line += text.count("\n", position, start)
        if start == len(text):
            return
        try:
            value, position = decoder.raw_decode(text, start)
        except (ValueError, RecursionError):
            faults.add(Place(name, line), "left out: cut short, or not JSON")
            again = _NEXT.search(text, start + 1)
            position = again.start() if again else len(text)
        else:
            yield from _items(Place(name, line), clean(value))
        line += text.count("\n", start, position)


def _items(place: Place, value: Any) -> Iterator[tuple[Place, Any]]:
    if isinstance(value, list):
        for number, item in enumerate(value, start=1):
            yield place._replace(item=number), item
    else:
        yield place, value


def _same(value: Any) -> Any:
    return value


def _text(name: str, content: bytes, faults: Faults) -> str:
    """A file's text; a line that is not in the file's coding is read as far as it can be."""
    coding = next((coding for mark, coding in _MARKS if content.startswith(mark)), "")
    if not coding and b"\x00" in content[:2]:  # JSON begins with a letter of ASCII
        coding = "utf-16-be" if content[:1] == b"\x00" else "utf-16-le"
    try:
        return content.decode(coding or "utf-8")
    except UnicodeDecodeError:
        # A server appends UTF-8 to a journal, whatever somebody's editor made of it.
        if (coding or b"\x00" in content) and not _LINE.search(content):
            faults.add(Place(name), "left out: not a text file")
            return ""
    lines = []
    for number, line in enumerate(content.split(b"\n"), start=1):
        try:
            lines.append(line.decode())
        except UnicodeDecodeError:
            faults.add(
                Place(name, number),
                "not UTF-8; what can't be read became \N{REPLACEMENT CHARACTER}",
            )
            lines.append(line.decode(errors="replace"))
    return "\n".join(lines)


def _unpacked(name: str, content: bytes, faults: Faults) -> Iterator[tuple[str, bytes]]:
    if content.startswith(b"\x1f\x8b"):
        yield from _unpacked(name, _gunzipped(name, content, faults), faults)
    elif content.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        yield from _unzipped(name, content, faults)
    else:
        yield name, content


def _gunzipped(name: str, content: bytes, faults: Faults) -> bytes:
    """What is in a gzip file, as far as it can be read."""
    parts = []
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as stream:
        try:
            while part := stream.read1(65536):
                parts.append(part)
        except (OSError, EOFError, zlib.error) as error:
            faults.add(Place(name), f"cut short, or damaged ({error}); what can be read is taken")
    return b"".join(parts)


def _unzipped(name: str, content: bytes, faults: Faults) -> Iterator[tuple[str, bytes]]:
    try:
        archive = zipfile.ZipFile(io.BytesIO(content))
    except zipfile.BadZipFile as error:
        faults.add(Place(name), f"left out: not a whole archive ({error})")
        return
    for member in archive.infolist():
        if member.is_dir() or not _is_answers(tuple(member.filename.split("/"))):
            continue
        inside = f"{name}: {member.filename}"
        try:
            part = archive.read(member)
        except (zipfile.BadZipFile, RuntimeError, EOFError, OSError, zlib.error) as error:
            faults.add(Place(inside), f"left out: cannot be read ({error})")
            continue
        yield from _unpacked(inside, part, faults)


def _is_answers(parts: tuple[str, ...]) -> bool:
    """Whether a file can have answers: it is neither the system's, nor about the archive."""
    return parts[-1] not in _NOT_ANSWERS and not any(part.startswith(_SYSTEMS) for part in parts)


def _follows(place: Place, last: Place) -> bool:
    if place.file != last.file or not last.line:
        return False
    if place.item:
        return place.line == last.line and place.item == last.item + 1
    return place.line in (last.line, last.line + 1) and not last.item


def _to(first: Place, last: Place) -> str:
    if first == last:
        return ""
    return f" to {last.item}" if first.item else f" to {last.line}"
