"""Tables as files: CSV or Parquet, by the extension; read, checked and written here alone."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pourcast.errors import InputError
from pourcast.files import replacing

TABLE_SUFFIXES = (".csv", ".parquet")

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


def read_table(path: Path, *, text: Sequence[str] = (), verbatim: bool = False) -> pd.DataFrame:
    """Read a table, a .csv or .parquet file.

    Parameters
    ----------
    path
        The file.
    text
        Columns of a CSV file that hold text, even where it looks like a number. (Names such
        as ``0123`` would lose their zero.)
    verbatim
        All columns of a CSV file hold text, empty cells are empty text, and blank lines are
        left out: what is written back is what was read.

    Returns
    -------
    DataFrame
        Blank lines of a CSV file are rows without values: row k stands in line
        k + `FIRST_ROW`, unless it is read verbatim.

    Raises
    ------
    InputError
        One line that names the file, if it can't be read or is no table.
    """
    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(f"{path}: expected a {' or '.join(TABLE_SUFFIXES)} file")
    try:
        if path.suffix.lower() == ".parquet":
            return pd.read_parquet(path)
        kinds = str if verbatim else dict.fromkeys(text, str)
        return pd.read_csv(
            path, dtype=kinds, keep_default_na=not verbatim, skip_blank_lines=verbatim
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        raise InputError(f"{path}: not a table ({' '.join(str(error).split())})") from None


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
    more = f" (and {len(bad) - 1} more rows)" if len(bad) > 1 else ""
    row = bad[0] + FIRST_ROW if rows is None else rows[bad[0]]
    raise InputError(f"{path}: row {row}, column {column}: {expected}, found {found}{more}")


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
            table.to_csv(temporary, index=False, lineterminator="\n")
        else:
            table.to_parquet(temporary, index=False)
