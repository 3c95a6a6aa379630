"""Tables as files: CSV or Parquet, by the extension; read, checked and written here alone.

A CSV file that we write opens in a spreadsheet with its texts as they are (`spreadsheets`); with
letters beyond ASCII it has a byte-order mark.
"""

import codecs
import warnings
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from pourcast.errors import InputError
from pourcast.files import replacing
from pourcast.spreadsheets import guarded, text_columns, without_guards

TABLE_SUFFIXES = (".csv", ".parquet")
TEXT_SUFFIXES = (".csv", ".tsv", ".txt")
"""Tables as text, of which we write the first only."""

SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs"}
"""What separates the columns of a CSV file, and in words; of as many, the first."""

_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16",
}  # fmt: skip
_ENCODINGS = {"utf-16": "UTF-16", "cp1252": "Windows-1252"}
MISSING = ("", "NA", "N/A", "n/a", "NaN", "nan", "null", "NULL", "None", "#N/A")
"""What programs write where there is no value; a name may be any of them."""
_DECIMAL_COMMA, _DECIMAL_POINT = r"\s*[-+]?\d*,\d+\s*%?\s*", r"\s*[-+]?\d*\.\d+\s*%?\s*"

_NAMED_ROWS = 5
"""Rows with one fault that are named besides the first."""

FIRST_ROW = 2
"""Row of a spreadsheet or text editor that a table's first row stands in, after the header."""


def check_table_path(path: Path) -> None:
    """Refuse a table's file name whose extension is not known.

    Raises
    ------
    InputError
        If it is neither .csv nor .parquet.
    """
    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in {' or '.join(TABLE_SUFFIXES)}")


def read_table(path: Path, *, text: Sequence[str] = (), extra_header_rows: int = 0) -> pd.DataFrame:
    """Read a table: a .parquet file, or a .csv, .tsv or .txt file.

    These may be written as programs and spreadsheets do: in UTF-8, UTF-16 or Windows-1252,
    separated by commas, semicolons or tabs, with decimal points or commas.

    Parameters
    ----------
    path
        The file.
    text
        Columns of a CSV file that hold text, even where it looks like a number (names such
        as ``0123`` would lose their zero) or like nothing (a participant called ``NA``).
    extra_header_rows
        Rows of a CSV file that are left out below the first one, which has the columns' names.

    Returns
    -------
    DataFrame
        Blank lines of a CSV file are rows without values: row k stands in line
        k + `FIRST_ROW`. `attrs["read_as"]` says in words how it was
        read, if not as UTF-8 with commas and points; `attrs["decimal"]` has "." or ",";
        `attrs["repeated"]` has names that several columns of a CSV file share.

    Raises
    ------
    InputError
        One line that names the file, if it can't be read or is no table.
    """
    suffix = path.suffix.lower()
    if suffix not in (*TEXT_SUFFIXES, ".parquet"):
        raise InputError(f"{path}: expected a {', '.join(TEXT_SUFFIXES)} or .parquet file")
    try:
        if suffix == ".parquet":
            return pd.read_parquet(path)
        return _read_csv(path.read_bytes(), text, extra_header_rows)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise InputError(f"{path}: not a table ({' '.join(str(error).split())})") from None


def _read_csv(content: bytes, text: Sequence[str], extra_header_rows: int) -> pd.DataFrame:
    encoding = _encoding(content)
    characters = content.decode(encoding)
    header = characters.split("\n", 1)[0]
    outside_quotes = "".join(header.split('"')[::2])
    separator = max(SEPARATORS, key=outside_quotes.count)
    skipped = range(1, 1 + extra_header_rows)
    table = _with_numbers(characters, separator, text, skipped)
    decimal = table.attrs.get("decimal", ".")
    said = [
        *([_ENCODINGS[encoding]] if encoding in _ENCODINGS else []),
        *([f"separated by {SEPARATORS[separator]}"] if separator != "," else []),
        *(["with decimal commas"] if decimal == "," else []),
    ]
    table = without_guards(table)
    table.attrs = {
        "read_as": ", ".join(said),
        "decimal": decimal,
        "repeated": _repeated(characters, separator),
    }
    return table


def _repeated(characters: str, separator: str) -> tuple[str, ...]:
    """Names of columns that stand there several times; pandas numbers all but the first."""
    header = pd.read_csv(StringIO(characters), sep=separator, header=None, nrows=1, dtype=str)
    names = header.iloc[0].dropna()
    return tuple(dict.fromkeys(names[names.duplicated()]))


def _with_numbers(
    characters: str, separator: str, text: Sequence[str], skipped: range
) -> pd.DataFrame:
    """A table whose columns are numbers where all their values are."""
    names = pd.read_csv(StringIO(characters), sep=separator, nrows=0).columns
    others = [name for name in names if name not in text]
    decimal = "." if separator == "," else _decimal(characters, separator, others)

    def read(*, index_col: Literal[False] | None) -> pd.DataFrame:
        return pd.read_csv(
            StringIO(characters), sep=separator, decimal=decimal, dtype=dict.fromkeys(text, str),
            keep_default_na=False, na_values={name: [""] for name in text}
            | {name: list(MISSING) for name in others},
            skip_blank_lines=False, skiprows=skipped, index_col=index_col,
        )  # fmt: skip

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = read(index_col=False)
    except pd.errors.ParserWarning:
        # Cells beyond the header. Without `index_col`, they move all others to the left.
        if not read(index_col=None).iloc[:, -1].isna().all():
            raise ValueError("rows have more cells than the header") from None
        with warnings.catch_warnings(action="ignore"):
            table = read(index_col=False)
    table.attrs["decimal"] = decimal
    return table


def _decimal(characters: str, separator: str, columns: Sequence[str]) -> str:
    """What stands before decimals: a comma, if some values have one and none has a point."""
    raw = pd.read_csv(StringIO(characters), sep=separator, dtype=str, keep_default_na=False)
    values = pd.Series(raw[columns].to_numpy().ravel(), dtype=str).str
    commas = values.fullmatch(_DECIMAL_COMMA).any()
    return "," if commas and not values.fullmatch(_DECIMAL_POINT).any() else "."


def _encoding(content: bytes) -> str:
    """How a file's text is encoded: by its first bytes, else UTF-8 if it is that."""
    for mark, encoding in _MARKS.items():
        if content.startswith(mark):
            return encoding
    try:
        content.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def require_columns(path: Path, table: pd.DataFrame, columns: Sequence[str]) -> None:
    """Refuse a table that lacks a column.

    Parameters
    ----------
    path
        Where it is from, for the error message.
    table, columns
        The table, and what it needs.

    Raises
    ------
    InputError
        One line that names the column.
    """
    missing = [name for name in columns if name not in table.columns]
    if missing:
        raise InputError(
            f"{path}: column {missing[0]!r} is missing; expected {', '.join(columns)}, "
            f"found {', '.join(map(str, table.columns))}"
        )


def refuse_rows(
    path: Path,
    table: pd.DataFrame,
    column: str,
    wrong: "pd.Series[bool]",
    expected: str,
    rows: Sequence[int] | None = None,
) -> None:
    """Refuse a table for the first row that is wrong, if any is.

    Parameters
    ----------
    path
        Where it is from, for the error message.
    table, column
        The table, and the column at fault.
    wrong
        Which rows are.
    expected
        What was, in words, such as "expected a number".
    rows
        Number of each row in the file; counted from `FIRST_ROW` by default.

    Raises
    ------
    InputError
        One line that names row and column, what was expected and found.
    """
    bad = np.flatnonzero(wrong.to_numpy())
    if len(bad) == 0:
        return
    value = table[column].iloc[bad[0]]
    found = f"{value:g}" if isinstance(value, float) else repr(value)
    row, *others = (k + FIRST_ROW if rows is None else rows[k] for k in bad.tolist())
    raise InputError(
        f"{path}: row {row}, column {column}: {expected}, found {found}{more_rows(others)}"
    )


def more_rows(rows: Sequence[object]) -> str:
    """Half a sentence about further rows with the same fault.

    Examples
    --------
    >>> more_rows([3, 7])
    ' (and 2 more rows: 3, 7)'
    """
    if not rows:
        return ""
    named = ", ".join(map(str, rows[:_NAMED_ROWS]))
    dots = ", ..." if len(rows) > _NAMED_ROWS else ""
    return f" (and {len(rows)} more row{'s' if len(rows) > 1 else ''}: {named}{dots})"


def numbers_in(
    path: Path,
    table: pd.DataFrame,
    column: str,
    needed: "pd.Series[bool] | None" = None,
    rows: Sequence[int] | None = None,
) -> "pd.Series[float]":
    """A column of numbers; NaN where there is none.

    Parameters
    ----------
    path, table, column, rows
        As for `refuse_rows`.
    needed
        Rows that need one; none by default.

    Raises
    ------
    InputError
        One line that names the first row without a number.
    """
    numbers = pd.to_numeric(table[column], errors="coerce")
    wrong = numbers.isna() & table[column].notna()
    if needed is not None:
        wrong |= numbers.isna() & needed
    refuse_rows(path, table, column, wrong, "expected a number", rows)
    return numbers.astype(float)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV or Parquet, by the extension; whole or not at all.

    Raises
    ------
    InputError
        If the extension is not known or the file can't be written.
    """
    check_table_path(path)
    with replacing(path) as temporary:
        if path.suffix.lower() == ".csv":
            temporary.write_bytes(csv_bytes(table))
        else:
            table.to_parquet(temporary, index=False)


def marked(tables: Mapping[str, pd.DataFrame], *, simulated: bool) -> dict[str, pd.DataFrame]:
    """Tables by their names; if observers were simulated, with a column that says so."""
    return {
        name: table.assign(simulated=True) if simulated else table for name, table in tables.items()
    }


def write_tables(folder: Path, tables: Mapping[str, pd.DataFrame]) -> None:
    """Write tables as CSV files of their names; see `write_table`."""
    for name, table in tables.items():
        write_table(folder / f"{name}.csv", table)


def csv_bytes(table: pd.DataFrame, *, mark: bool = True) -> bytes:
    """A table as the content of a CSV file that spreadsheets open with its texts intact.

    Parameters
    ----------
    table
        The table; its index is left out.
    mark
        Begin with a byte-order mark, by which spreadsheets know UTF-8, if it isn't all ASCII.
    """
    safe = guarded(table)
    # A carriage return alone is quoted by no Python before 3.13.
    returns = any("\r" in str(cell) for name in text_columns(safe) for cell in (name, *safe[name]))
    quoting: Literal[0, 2] = 2 if returns else 0  # csv.QUOTE_NONNUMERIC, csv.QUOTE_MINIMAL
    text = safe.to_csv(index=False, lineterminator="\n", quoting=quoting)
    return text.encode("utf-8-sig" if mark and not text.isascii() else "utf-8")
