"""A person's rows and lines taken out of files of ours: tables, records, copies of the database.

What is ours is told by its content, whatever its name and folder; all else stays as it was, to the
byte. Nothing is written if nothing was found.
"""

import csv
import io
import json
import sqlite3
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pourcast.experiment.data.person import Person
from pourcast.experiment.data.tables import IDENTIFIER_PREFIX
from pourcast.experiment.design.links import PERSONAL
from pourcast.experiment.storage.sessions import token_digest
from pourcast.files import replacing
from pourcast.spreadsheets import unguarded

_TEXT_TABLES = {".csv": ",;\t", ".tsv": "\t", ".txt": "\t"}
"""Extensions of tables, and what may part their columns."""

_SQLITE = b"SQLite format 3\0"

_ID_COLUMNS = {*PERSONAL[1:], *(f"{IDENTIFIER_PREFIX}{name}" for name in PERSONAL)}
"""Columns of the ids that tell a person; `participant` has the code, where it is ours."""


def remove_from_file(path: Path, person: Person) -> str:
    """Take a person out of a file, if it is one of ours; says what was taken out, or nothing.

    Raises
    ------
    OSError
        If the file can't be read or written.
    """
    path = path.resolve()  # a link stays a link
    with path.open("rb") as stream:
        begin = stream.read(16)
    if begin == _SQLITE:
        return _counted(_remove_from_database(path, person), "session")
    if begin.startswith(b"PAR1"):
        return _counted(_remove_from_parquet(path, person), "row")
    content = path.read_bytes()
    lines = _without_lines(content, person)
    if lines is not None:
        _replace(path, lines[0])
        return _counted(lines[1], "line")
    rows = _without_rows(content, person, _TEXT_TABLES.get(path.suffix.lower(), ""))
    if rows is not None:
        _replace(path, rows[0])
        return _counted(rows[1], "row")
    return ""


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count > 1 else ''}" if count else ""


def _replace(path: Path, content: bytes) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(content)


# Tables --------------------------------------------------------------------------------


def _is_theirs(row: Mapping[str, Any], person: Person) -> bool:
    """Whether a row of a table of ours is this person's."""

    def is_one(column: str, names: AbstractSet[str]) -> bool:
        cell = str(row.get(column))
        return cell in names or unguarded(cell) in names

    return (
        is_one("participant", person.participants | person.distinctive)
        or is_one("code", person.completion_codes)
        or any(is_one(column, person.given) for column in _ID_COLUMNS)
    )


def _without_rows(content: bytes, person: Person, delimiters: str) -> tuple[bytes, int] | None:
    """A table without a person's rows, and how many there were; None if it is no such table."""
    text, encoding = _decoded(content)
    for delimiter in delimiters:
        try:
            rows = list(_csv_rows(text, delimiter))
        except csv.Error:
            continue
        header = [name.lstrip("\ufeff") for name in rows[0][0]] if rows else []
        if "participant" not in header:
            continue
        kept = [
            raw
            for number, (cells, raw) in enumerate(rows)
            if number == 0 or not _is_theirs(_cells(header, cells), person)
        ]
        if len(kept) < len(rows):
            return "".join(kept).encode(encoding), len(rows) - len(kept)
    return None


def _cells(header: list[str], cells: list[str]) -> dict[str, str]:
    return dict(zip(header, [*cells, *[""] * len(header)], strict=False))


def _csv_rows(text: str, delimiter: str) -> Iterator[tuple[list[str], str]]:
    """Yield the rows of a CSV file, each with the text that it stands in."""
    lines = list(io.StringIO(text, newline=""))
    reader = csv.reader(lines, delimiter=delimiter)
    begin = 0
    for cells in reader:
        yield cells, "".join(lines[begin : reader.line_num])
        begin = reader.line_num


def _decoded(content: bytes) -> tuple[str, str]:
    """A file's text, and an encoding that makes the very same bytes of it."""
    by_mark = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be", b"\xef\xbb": "utf-8-sig"}
    for encoding in (by_mark.get(content[:2], "utf-8"), "latin-1"):
        try:
            return content.decode(encoding), encoding
        except UnicodeDecodeError:
            continue
    raise AssertionError("Latin-1 has a letter for every byte")


def _remove_from_parquet(path: Path, person: Person) -> int:
    table = pq.read_table(path)
    if "participant" not in table.column_names:
        return 0
    wanted = [name for name in ("participant", "code", *_ID_COLUMNS) if name in table.column_names]
    rows = table.select(wanted).to_pylist()
    theirs = [_is_theirs(row, person) for row in rows]
    if not any(theirs):
        return 0
    kept = table.filter(pa.array([not one for one in theirs]))
    for number, column in enumerate(kept.schema):
        if pa.types.is_dictionary(column.type):  # it would keep words that no row has any more
            plain = kept.column(number).cast(column.type.value_type)
            words = pc.dictionary_encode(plain).cast(column.type)
            kept = kept.set_column(number, column, words)
    with replacing(path) as temporary:
        pq.write_table(kept, temporary)
    return sum(theirs)


# Records -------------------------------------------------------------------------------


def _without_lines(content: bytes, person: Person) -> tuple[bytes, int] | None:
    """A file of records without a person's lines; None if it has none of theirs."""
    lines = content.splitlines(keepends=True)
    kept = [line for line in lines if not _is_their_line(line, person)]
    return (b"".join(kept), len(lines) - len(kept)) if len(kept) < len(lines) else None


def _is_their_line(line: bytes, person: Person) -> bool:
    if b'"session"' not in line:
        return False
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        return False
    session = content.get("session") if isinstance(content, dict) else None
    # Older pages called a session by its token.
    return isinstance(session, str) and (
        session in person.keys or token_digest(session) in person.tokens
    )


# Copies of the database ----------------------------------------------------------------


def _remove_from_database(path: Path, person: Person) -> int:
    """Take a person out of a copy of the database, of any version; 0 if it is something else."""
    try:
        with closing(sqlite3.connect(path, timeout=2.0, isolation_level=None)) as connection:
            connection.row_factory = sqlite3.Row
            connection.execute("PRAGMA secure_delete = ON")
            numbers = _their_sessions(connection, person)
            tables = _tables_of_sessions(connection) if numbers else []
            connection.execute("BEGIN IMMEDIATE")
            for number in numbers:
                for table in tables:
                    connection.execute(f'DELETE FROM "{table}" WHERE session = ?', (number,))
                connection.execute("DELETE FROM sessions WHERE id = ?", (number,))
            connection.execute("COMMIT")
            if numbers:
                connection.execute("VACUUM")
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    except sqlite3.Error as error:
        raise OSError(f"cannot be changed ({error})") from None
    return len(numbers)


def _their_sessions(connection: sqlite3.Connection, person: Person) -> list[int]:
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master")}
    if not {"sessions", "records"} <= tables:
        return []
    rows = [dict(row) for row in connection.execute("SELECT * FROM sessions")]
    return [int(row["id"]) for row in rows if _is_their_session(row, person)]


def _tables_of_sessions(connection: sqlite3.Connection) -> list[str]:
    """Tables of which each row belongs to a session; older and newer versions have others."""
    query = (
        "SELECT m.name FROM sqlite_master AS m JOIN pragma_table_info(m.name) AS c "
        "WHERE m.type = 'table' AND c.name = 'session'"
    )
    return [str(row[0]) for row in connection.execute(query)]


def _is_their_session(row: Mapping[str, Any], person: Person) -> bool:
    identifiers = json.loads(row.get("identifiers") or "{}")
    ids = {value for name, value in identifiers.items() if name in PERSONAL[1:]}
    return (
        row.get("participant") in person.participants
        or row.get("key") in person.keys
        or bool(ids & person.given)
    )
