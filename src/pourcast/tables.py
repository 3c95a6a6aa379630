"""Tables as files: CSV or Parquet, by the extension."""

from pathlib import Path

import pandas as pd

from pourcast.errors import InputError
from pourcast.files import replacing

TABLE_SUFFIXES = (".csv", ".parquet")


def check_table_path(path: Path) -> None:
    """Refuse a table's file name whose extension is not known.

    Raises
    ------
    InputError
        If it is neither .csv nor .parquet.
    """
    if path.suffix.lower() not in TABLE_SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in {' or '.join(TABLE_SUFFIXES)}")


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
