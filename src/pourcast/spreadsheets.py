"""Texts that a spreadsheet would change when it opens a table: guarded, and read without the guard.

What it would take for a formula, or turn into another number, a date or a truth value, has an
apostrophe first. What has one already has one more, so that it comes off again.
"""

import re
from collections.abc import Callable
from typing import Any

import pandas as pd


def guarded(table: pd.DataFrame) -> pd.DataFrame:
    """A table with an apostrophe before what a spreadsheet would change; in its header, formulas.

    `without_guards` takes it off again.

    Examples
    --------
    >>> names = ["=A1", "00123", "1E5", "17", "p-1", "'=A1"]
    >>> guarded(pd.DataFrame({"name": names}))["name"].to_list()
    ["'=A1", "'00123", "'1E5", '17', 'p-1', "''=A1"]
    """
    return _in_texts(table, _with_guard)


def without_guards(table: pd.DataFrame) -> pd.DataFrame:
    """A table as it was before `guarded`."""
    return _in_texts(table, _without_guard)


def unguarded(text: str) -> str:
    """A text of a CSV file without the apostrophe that `guarded` set, if it did.

    Examples
    --------
    >>> [unguarded(text) for text in ("'00123", "'quoted", "''=A1")]
    ['00123', "'quoted", "'=A1"]
    """
    return _without_guard(text, _would_change)


_FORMULA = re.compile("[=+\\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""How a formula begins, in a spreadsheet; in the wide forms of Asian keyboards, too."""
_MONTH = (
    "(jan(uary)?|feb(ruary)?|mar(ch)?|apr(il)?|may|june?|july?|aug(ust)?|sept?(ember)?|oct(ober)?"
    "|nov(ember)?|dec(ember)?)"
)
_DATE = re.compile(
    r"\d{1,4}\s*[-/.:]\s*\d{1,4}(\s*[-/.:]\s*\d{1,4})?(\s+\d{1,2}:.*)?"
    rf"|(\d{{1,4}}[-/. ]*)?{_MONTH}[-/. ]*\d{{1,4}}|\d{{1,4}}[-/. ]*{_MONTH}",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"\s*(\d[\d.,\s]*|[.,]\d+)(e[-+]?\d+)?\s*%?\s*", re.IGNORECASE)
_SAME_NUMBER = re.compile(r"0|[1-9]\d{0,14}")
"""A number that a spreadsheet shows as it was written: whole, with no more digits than it keeps."""
_TRUTH = ("true", "false")


def _would_change(text: str) -> bool:
    """Whether a spreadsheet would make something else of a text, apostrophes before it apart."""
    core = text.lstrip("'")
    if _SAME_NUMBER.fullmatch(core):
        return False
    return bool(
        _is_formula(text)
        or _NUMBER.fullmatch(core)
        or _DATE.fullmatch(core)
        or core.lower() in _TRUTH
    )


def _is_formula(text: str) -> bool:
    return _FORMULA.match(text.lstrip("'")) is not None


def _with_guard(text: str, changes: Callable[[str], bool]) -> str:
    return f"'{text}" if changes(text) else text


def _without_guard(text: str, changes: Callable[[str], bool]) -> str:
    return text[1:] if text.startswith("'") and changes(text) else text


def _in_texts(
    table: pd.DataFrame, guard: Callable[[str, Callable[[str], bool]], str]
) -> pd.DataFrame:
    """A table with a guard set, or taken off, in all its texts and its header."""

    def changed(value: Any, changes: Callable[[str], bool]) -> Any:
        return guard(value, changes) if isinstance(value, str) else value

    table = table.rename(columns=lambda name: changed(name, _is_formula))
    for name in text_columns(table):
        table[name] = table[name].map(lambda value: changed(value, _would_change))
    return table


def text_columns(table: pd.DataFrame) -> list[str]:
    """Names of the columns that may hold texts."""
    return list(table.select_dtypes(["object", "string"]).columns)
