"""A search of a study's folder for words, such as a person's identifiers, in files of every kind.

What is packed is unpacked: gzip, bzip2, xz, zip (Excel's and LibreOffice's files are such) and
Parquet. A word is found in UTF-8, UTF-16 and Windows' Latin letters, and as JSON, HTML and links
write it.
"""

import bz2
import gzip
import html
import io
import json
import lzma
import os
import re
import unicodedata
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote, quote_plus

import pyarrow as pa
import pyarrow.parquet as pq

from pourcast.stimuli.manifest import FOLDER as STIMULI

LEFT_OUT = "pictures, films and pours in stimuli/, simulation results in sweep/"
"""What is left out of a search: it is made of scenes alone."""

_MEDIA = frozenset({".png", ".jpg", ".mp4", ".webm", ".exr", ".npz", ".npy", ".obj", ".ply"})
_RESULTS = frozenset({".parquet", ".zip"})

_SHOWN = frozenset({".pdf", ".png", ".jpg", ".jpeg", ".gif", ".tif", ".tiff", ".webp", ".heic",
                    ".mp4", ".webm", ".mov", ".avi", ".wav", ".mp3"})  # fmt: skip
"""Files that may show or say a word that doesn't stand in their bytes."""

_DATABASES = (b"SQLite format 3\0", b"7\x7f\x06\x82", b"7\x7f\x06\x83")
"""What SQLite's files and write-ahead logs begin with."""

_DEEPEST = 4
"""Packed files in packed files are opened down to here."""

_LARGEST = 2**28
"""What is packed may be so large, unpacked [bytes]; what is larger is told of."""

_CHUNK = 2**26
"""So much is read at once [bytes], and so much again that a word may be parted by that:"""

_OVERLAP = 2**14


@dataclass(frozen=True)
class Needle:
    """A word to be looked for.

    Parameters
    ----------
    text
        The word.
    label
        What it is, for people.
    whole
        Only where no letter or digit stands beside it: it may be a part of another's word.
    fields
        Only as the value of one of these fields, in JSON or a link: it is too short to be looked
        for alone.
    in_databases
        Whether SQLite's files are searched for it, too, where words stand side by side.
    """

    text: str
    label: str
    whole: bool = False
    fields: tuple[str, ...] = ()
    in_databases: bool = True


@dataclass
class Findings:
    """What a search found.

    Parameters
    ----------
    found
        File -> labels of what is in it, or in its name.
    unread
        File -> why it could not be looked through.
    shown
        Pictures, films, PDFs: what they show was not read.
    searched, left_out
        Number of files that were looked through, and that were not (`LEFT_OUT`).
    """

    found: dict[Path, list[str]] = field(default_factory=dict)
    unread: dict[Path, str] = field(default_factory=dict)
    shown: list[Path] = field(default_factory=list)
    searched: int = 0
    left_out: int = 0


def search_folder(folder: Path, needles: Sequence[Needle]) -> Findings:
    """Look through all files of a folder.

    A file that SQLite has open in this process must not be among them: closing it drops SQLite's
    locks.

    Parameters
    ----------
    folder
        The study folder; links are followed.
    needles
        What to look for.
    """
    findings = Findings()
    search = _Search(needles)
    for path in sorted(_files(folder, findings.unread)):
        inside = path.relative_to(folder)
        if _is_left_out(inside):
            findings.left_out += 1
            continue
        try:
            labels, problem = search.file(path, str(inside))
        except FileNotFoundError:  # a temporary file of a server that runs
            continue
        findings.searched += 1
        if labels:
            findings.found[path] = labels
        if problem:
            findings.unread[path] = problem
        if path.suffix.lower() in _SHOWN:
            findings.shown.append(path)
    return findings


def _files(folder: Path, unread: dict[Path, str]) -> Iterator[Path]:
    """Yield all files, each folder once, wherever links lead; folders that can't be read aside."""
    seen: set[tuple[int, int]] = set()

    def note(error: OSError) -> None:
        unread[Path(error.filename)] = f"cannot be read ({error.strerror})"

    for place, folders, names in os.walk(folder, followlinks=True, onerror=note):
        found = os.stat(place)
        if (found.st_dev, found.st_ino) in seen:
            folders.clear()
            continue
        seen.add((found.st_dev, found.st_ino))
        yield from (path for name in names if (path := Path(place, name)).is_file())


def _is_left_out(path: Path) -> bool:
    if path.parts[0] == STIMULI:
        return path.suffix.lower() in _MEDIA
    return path.parts[0] == "sweep" and path.suffix.lower() in _RESULTS


class _Search:
    """Looks for the same words in one file after another."""

    def __init__(self, needles: Sequence[Needle]) -> None:
        self._forms = {needle: _written(needle) for needle in needles}

    def file(self, path: Path, name: str) -> tuple[list[str], str]:
        """Labels of what is in a file or its name; and why it could not be looked through."""
        found = set(self._in(name.encode("utf-8", "surrogateescape"), is_database=False))
        problem = ""
        try:
            with path.open("rb") as stream:
                for part, is_database in _parts(stream):
                    found.update(self._in(part, is_database))
        except FileNotFoundError:
            raise
        except OSError as error:
            problem = f"cannot be read ({error.strerror or error})"
        except _UnreadableError as error:
            problem = str(error)
        return list(dict.fromkeys(one.label for one in self._forms if one in found)), problem

    def _in(self, content: bytes, is_database: bool) -> Iterator[Needle]:
        """Yield the words that are in something."""
        for needle, forms in self._forms.items():
            if is_database and not needle.in_databases:
                continue
            whole = needle.whole and not is_database
            if any(_is_in(content, form, width, whole) for form, width in forms.items()):
                yield needle


class _UnreadableError(Exception):
    """A file can't be looked through; the message says why."""


def _parts(stream: IO[bytes], depth: int = 0) -> Iterator[tuple[bytes, bool]]:
    """Yield a file's content as it is, and all that is packed in it; and if it is a database's."""
    content, kept = stream.read(_CHUNK), b""
    is_database = content.startswith(_DATABASES)
    unpack = next((one for magic, one in _PACKED.items() if content.startswith(magic)), None)
    while content:
        yield kept + content, is_database
        kept, content = (kept + content)[-_OVERLAP:], stream.read(_CHUNK)
    if unpack is not None:
        yield from _unpacked(unpack, stream, depth)


def _unpacked(unpack: "_Unpack", stream: IO[bytes], depth: int) -> Iterator[tuple[bytes, bool]]:
    if depth == _DEEPEST:
        raise _UnreadableError("packed too often to be unpacked")
    stream.seek(0)
    try:
        for inner in unpack(stream):
            yield from _parts(io.BytesIO(inner), depth + 1)
    except (EOFError, OSError, lzma.LZMAError, zlib.error, zipfile.BadZipFile) as error:
        raise _UnreadableError(f"damaged: it can't be unpacked ({error})") from None
    except pa.ArrowException as error:
        raise _UnreadableError(f"damaged: it is no Parquet file ({error})") from None
    except (NotImplementedError, RuntimeError) as error:  # zipfile's, of what is encrypted
        raise _UnreadableError(f"cannot be unpacked ({error})") from None


_Unpack = Callable[[IO[bytes]], Iterator[bytes]]


def _unzipped(stream: IO[bytes]) -> Iterator[bytes]:
    with zipfile.ZipFile(stream) as archive:
        yield "\n".join(archive.namelist()).encode("utf-8", "surrogateescape")
        for entry in archive.infolist():
            with archive.open(entry) as inner:
                yield _all_of(inner)


def _rows(stream: IO[bytes]) -> Iterator[bytes]:
    """Yield a Parquet file's rows as text."""
    for batch in pq.ParquetFile(stream).iter_batches():
        yield batch.to_pandas().to_csv().encode("utf-8", "surrogatepass")


def _opened(
    opener: Callable[[Any], IO[bytes] | gzip.GzipFile],
) -> _Unpack:
    def unpack(stream: IO[bytes]) -> Iterator[bytes]:
        with opener(stream) as inner:
            yield _all_of(inner)

    return unpack


def _all_of(stream: IO[bytes] | gzip.GzipFile) -> bytes:
    content = stream.read(_LARGEST + 1)
    if len(content) > _LARGEST:
        raise _UnreadableError("too large to be unpacked")
    return content


_PACKED: Mapping[bytes, _Unpack] = {
    b"PK\x03\x04": _unzipped,
    b"PAR1": _rows,
    b"\x1f\x8b": _opened(gzip.open),
    b"BZh": _opened(bz2.open),
    b"\xfd7zXZ\0": _opened(lzma.open),
}
"""What unpacks files, by what they begin with."""


def _is_in(content: bytes, form: bytes, width: int, whole: bool) -> bool:
    """Whether a word stands somewhere; `width`: bytes of a letter."""
    at = content.find(form)
    while at >= 0:
        end = at + len(form)
        before, after = content[max(0, at - width) : at], content[end : end + width]
        parted = not (
            (_is_letter(before) and _is_letter(form[:width]))
            or (_is_letter(after) and _is_letter(form[-width:]))
        )
        if parted or not whole:
            return True
        at = content.find(form, at + 1)
    return False


def _is_letter(character: bytes) -> bool:
    """Whether it is a letter or digit of ASCII, in one byte or two."""
    return character.replace(b"\0", b"").isalnum()


def _written(needle: Needle) -> dict[bytes, int]:
    """How a word may be written in a file, and how many bytes a letter has there."""
    forms: dict[bytes, int] = {}
    for normal in ("NFC", "NFD"):
        text = unicodedata.normalize(normal, needle.text)
        for word in _spelled(text):
            for one in _in_fields(word, needle.fields):
                forms |= _encoded(one)
    return forms


def _spelled(text: str) -> set[str]:
    """A word as CSV, JSON, HTML and links write it."""
    printed = text.encode("utf-8", "replace").decode()
    links = {quote(printed), quote(printed, safe=""), quote_plus(printed)}
    return {
        text,
        text.replace('"', '""'),
        html.escape(text),
        html.escape(text, quote=False),
        json.dumps(text)[1:-1],
        json.dumps(text, ensure_ascii=False)[1:-1],
        *links,
        *(re.sub("%..", lambda code: code[0].lower(), link) for link in links),
    }


def _in_fields(word: str, fields: tuple[str, ...]) -> list[str]:
    """A word, or a word as the value of a field."""
    patterns = ('"{}": "{}"', '"{}":"{}"', "?{}={}", "&{}={}")
    return [one.format(name, word) for name in fields for one in patterns] if fields else [word]


def _encoded(text: str) -> dict[bytes, int]:
    forms = {}
    for encoding, width in (("utf-8", 1), ("cp1252", 1), ("utf-16-le", 2), ("utf-16-be", 2)):
        try:
            forms[text.encode(encoding)] = width
        except UnicodeEncodeError:  # not one of the encoding's characters
            continue
    return forms
