"""Tables of other programs, recoded into tables of responses by a mapping (`study.columns`)."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pourcast.errors import Faults, InputError
from pourcast.files import finished_files
from pourcast.study.columns import ANY, FIELDS, Columns, Source, plain_text
from pourcast.study.programs import hint
from pourcast.tables import FIRST_ROW, MISSING, read_table, refuse_rows

REQUIRED = ("participant", "scene", "liquid", "response")
"""Columns that a table of responses must have."""

TEXT = ("participant", "scene", "liquid", "phase")
"""Columns of names, even where these look like numbers."""

SUFFIXES = (".csv", ".tsv", ".parquet")
"""Files of a folder that are tables; a .txt file may be anything, and must be named."""

MEANS = ""
"""Stands for the participant where only means are known; nobody is called so."""

_TRIALS, _PRACTICE, _OTHER = "trials", "of practice", "no trials"
"""Kinds of rows."""

_MOST_NAMED = 8


@dataclass(frozen=True)
class Recoded:
    """A table of responses, not yet checked.

    Parameters
    ----------
    table
        A row a response; columns as in `study.responses`, and others.
    rows
        Where each stands, as the file's rows are counted.
    names
        What the file calls our columns, where it calls them otherwise.
    remarks
        What a reader should know: how it was read, what was left out.
    """

    table: pd.DataFrame
    rows: tuple[int | str, ...]
    names: Mapping[str, str]
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class _Part:
    """A file's table, recoded; how many rows of which kind there were; what else is to be said."""

    table: pd.DataFrame
    rows: tuple[int | str, ...]
    counts: Counter[str]
    said: tuple[str, ...]


def recode(path: Path, columns: Columns, scene_ids: Collection[str]) -> Recoded:
    """Read a table, or a folder of tables, by a mapping.

    Parameters
    ----------
    path
        A table, or a folder of tables, which are read in the order of their names.
    columns
        Which column is what.
    scene_ids
        Of the study's scenes, which are looked for in what names a scene.

    Raises
    ------
    InputError
        Names the file and all columns that are missing, or the rows that are wrong.
    """
    files = table_files(path) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{path}: no table, expected {', '.join(SUFFIXES)} files")
    parts, faults = [], Faults()
    for file in files:
        with faults:
            parts.append(_file(file, columns, scene_ids))
    faults.refuse()
    remarks = _remarks(path, parts)
    filled = [one.table for one in parts if len(one.table)]
    if not filled:
        raise InputError("; ".join((f"{path}: no rows, expected one a trial", *remarks)))
    table = pd.concat(filled, ignore_index=True)
    rows = [
        f"{row} of {file.name}" if path.is_dir() else row
        for file, one in zip(files, parts, strict=True)
        for row in one.rows
    ]
    names = {name: source.column for name, source in columns.sources.items() if source.column}
    return Recoded(table, tuple(rows), names, tuple(remarks))


def table_files(folder: Path) -> list[Path]:
    """Tables in a folder, in the order of their names."""
    return [one for one in finished_files(folder) if one.suffix.lower() in SUFFIXES]


def _remarks(path: Path, parts: Sequence[_Part]) -> list[str]:
    """What is to be said of all tables together."""
    counts = sum((one.counts for one in parts), Counter())
    said = list(dict.fromkeys(text for one in parts for text in one.said))
    if counts[_PRACTICE] or counts[_OTHER]:
        left_out = [f"{counts[what]} {what}" for what in (_PRACTICE, _OTHER) if counts[what]]
        said.insert(
            0,
            f"{counts.total()} rows, {counts[_TRIALS]} of them trials; left out: "
            f"{', '.join(left_out)}",
        )
    tables = [f"{len(parts)} tables"] if path.is_dir() else []
    return [f"{path.name}: {text}" for text in (*tables, *said)]


def _file(path: Path, columns: Columns, scene_ids: Collection[str]) -> _Part:
    raw, read_as = _raw(path, columns)
    _require(path, raw, columns, scene_ids)
    kept, counts = _trials(raw, columns)
    values = {
        name: _values(path, raw, source, kept)
        for name, source in columns.sources.items()
        if not source.in_header
    }
    if columns.means:
        values["participant"] = pd.Series(MEANS, index=raw.index)
    table = raw.assign(**values)[kept]
    said = [f"read as {read_as}"] if read_as else []
    if not kept.any():
        said += [_found(raw, name) for name in columns.trials]
    rows: tuple[int | str, ...] = tuple(table.index.to_list())
    if columns.wide:
        table, rows, more = _long(path, table, columns, scene_ids)
    else:
        table, more = _with_scene_ids(table, columns, scene_ids)
    for name in {"response", "rt"} & set(table.columns):
        table[name] = _numbers(table[name], columns.missing, raw.attrs.get("decimal", "."))
    if columns.rt_unit == "ms" and "rt" in table:
        seconds = pd.to_numeric(table["rt"], errors="coerce") / 1000.0
        table["rt"] = seconds.where(seconds.notna(), table["rt"])
    return _Part(table.reset_index(drop=True), rows, counts, (*said, *more))


def _raw(path: Path, columns: Columns) -> tuple[pd.DataFrame, str]:
    """A table as it is in the file, by the numbers of its rows, and how it was read."""
    if columns.header_rows and path.suffix.lower() == ".parquet":
        raise InputError(f"{path}: header_rows: a Parquet table has none")
    texts = {name for name, what in columns.needed.items() if what in (*TEXT, "trials", "practice")}
    raw = read_table(path, text=sorted({*TEXT, *texts}), extra_header_rows=columns.header_rows)
    raw.columns = raw.columns.map(str)
    raw.index = pd.Index(np.arange(len(raw)) + FIRST_ROW + columns.header_rows)
    return raw[raw.notna().any(axis=1)], raw.attrs.get("read_as", "")


def _require(path: Path, raw: pd.DataFrame, columns: Columns, scene_ids: Collection[str]) -> None:
    """Refuse a table without a column that is needed; says which are, and how to map them."""
    needed = {*REQUIRED} - {*columns.sources} | {*columns.needed}
    if twice := [f"{name!r}" for name in raw.attrs.get("repeated", ()) if name in needed]:
        raise InputError(f"{path}: column {', '.join(twice)}: several are called so, expected one")
    said = [*columns.sources, *(["scene", "response"] if columns.wide else [])]
    said += ["participant"] if columns.means else []
    missing = [f"{name!r}" for name in REQUIRED if name not in (*said, *raw.columns)]
    missing += [
        f"{column!r} ({name})" for column, name in columns.needed.items() if column not in raw
    ]
    if not missing:
        return
    some = "columns" if len(missing) > 1 else "column"
    verb = "are" if len(missing) > 1 else "is"
    there = [str(name) for name in raw.columns if not str(name).startswith("Unnamed: ")]
    constant = 'what all rows share is { value = "..." }, or NAME:VALUE in the short form'
    suggestion = hint(there, scene_ids) if columns == Columns() else constant
    raise InputError(
        f"{path}: {some} {', '.join(missing)} {verb} missing; expected {', '.join(REQUIRED)}, "
        f"found {', '.join(there)}; {suggestion}"
    )


# Rows ----------------------------------------------------------------------------------


def _meets(raw: pd.DataFrame, conditions: Mapping[str, tuple[str, ...]]) -> "pd.Series[bool]":
    """Rows in which all columns have what they should."""
    met = pd.Series(data=True, index=raw.index)
    for column, wanted in conditions.items():
        cells = raw[column].map(plain_text)
        met &= (cells != "") if ANY in wanted else cells.isin(wanted)
    return met


def _trials(raw: pd.DataFrame, columns: Columns) -> tuple["pd.Series[bool]", Counter[str]]:
    """Which rows are trials, and how many are and aren't."""
    trials = _meets(raw, columns.trials)
    practice = _meets(raw, columns.practice) if columns.practice else ~trials & False
    counts = Counter(
        {
            _TRIALS: int((trials & ~practice).sum()),
            _PRACTICE: int(practice.sum()),
            _OTHER: int((~trials & ~practice).sum()),
        }
    )
    return trials & ~practice, counts


def _found(raw: pd.DataFrame, column: str) -> str:
    return f"found in {column}: {_listed(list(raw[column].dropna().unique()))}"


# Cells ---------------------------------------------------------------------------------


def _values(
    path: Path, raw: pd.DataFrame, source: Source, kept: "pd.Series[bool]"
) -> "pd.Series[Any]":
    """What a field has in each row."""
    if source.column is None:
        text = path.stem if source.file else str(source.value)
        return pd.Series(_matched(path, text, source), index=raw.index)
    cells = raw[source.column]
    if source.pattern is not None:
        cells = cells.astype("string").str.extract(source.pattern, expand=False).astype(object)
        cells = cells.where(cells.notna() & (cells != ""), np.nan)
    wrong = cells.isna() & raw[source.column].notna()
    if source.fill:
        # In any row: what doesn't match would get what stands above, somebody else's.
        cells = cells.ffill()
    else:
        wrong &= kept
    refuse_rows(
        path, raw, source.column, wrong, f"expected a text that matches {source.pattern}",
        raw.index.to_list(),
    )  # fmt: skip
    return cells


def _matched(path: Path, text: str, source: Source) -> str:
    if source.pattern is None:
        return text
    found = re.search(source.pattern, text)
    if found is None:
        raise InputError(f"{path}: expected a name that matches {source.pattern}, found {text!r}")
    return str(found[1])


def _numbers(cells: "pd.Series[Any]", missing: Sequence[str], decimal: str) -> "pd.Series[Any]":
    """Cells without those that stand for nothing, and with points where there are commas."""
    texts = cells.map(plain_text).astype(str)
    cells = cells.mask(texts.isin([*missing, *map(str.casefold, MISSING)]))
    if decimal == ".":
        return cells
    commas = texts.str.fullmatch(r"[-+]?\d*,\d+\s*%?")
    return cells.where(~commas, texts.str.replace(",", "."))


# Scenes --------------------------------------------------------------------------------


def _finder(scene_ids: Collection[str]) -> re.Pattern[str]:
    """Finds ids of scenes that stand in a text as a word."""
    longest_first = sorted(map(re.escape, scene_ids), key=len, reverse=True)
    return re.compile(rf"(?<![^\W_])(?:{'|'.join(longest_first)})(?![^\W_])")


def _with_scene_ids(
    table: pd.DataFrame, columns: Columns, scene_ids: Collection[str]
) -> tuple[pd.DataFrame, list[str]]:
    """Ids of scenes in place of texts that hold one; other texts stay, to be refused later."""
    if columns.scene is None or columns.scene.pattern is not None:
        return table, []
    finder = _finder(scene_ids)
    found = {text: set(finder.findall(str(text))) for text in table["scene"].dropna().unique()}
    ids = {
        text: one.pop()
        for text, one in found.items()
        if len(one) == 1 and text not in set(scene_ids)
    }
    if not ids:
        return table, []
    text, scene = min(ids.items())
    said = f"scenes are those that {columns.scene.column} names, as {text!r}: {scene}"
    return table.assign(scene=table["scene"].map(lambda cell: ids.get(cell, cell))), [said]


def _long(
    path: Path, table: pd.DataFrame, columns: Columns, scene_ids: Collection[str]
) -> tuple[pd.DataFrame, tuple[str, ...], list[str]]:
    """A wide table with a row a response; which row and column each was; what is to be said."""
    scenes = _scene_columns(columns, list(table.columns), scene_ids)
    if not scenes:
        raise InputError(
            f"{path}: no column names a scene of the study; found {', '.join(table.columns)}"
        )
    header = columns.liquid if columns.liquid is not None and columns.liquid.in_header else None
    shown = {
        name: (scene, "" if header is None else _matched(path, name, header))
        for name, scene in scenes.items()
    }
    several = Counter(shown.values())
    if twice := [name for name, what in shown.items() if several[what] > 1]:
        raise InputError(
            f"{path}: several columns name a scene: {_listed(twice)}; expected one each: say which "
            "with a `pattern` of the column's name (in a mapping's file)"
        )
    base = [name for name in FIELDS if name in table and name not in ("scene", "response")]
    parts = []
    for place, (column, scene) in enumerate(scenes.items()):
        part = table[base].assign(scene=scene, response=table[column], _place=place)
        if header is not None:
            part["liquid"] = shown[column][1]
        parts.append(part.assign(_row=[f"{row} ({column})" for row in table.index]))
    # By rows, then columns, as one reads.
    long = pd.concat(parts).rename_axis("_line").reset_index().sort_values(["_line", "_place"])
    others = [name for name in table.columns if name not in (*scenes, *base, *columns.needed)]
    there = [f"{column} ({scene})" for column, scene in scenes.items()]
    said = [f"responses are those of {len(there)} columns: {_listed(there)}"]
    said += [f"columns that name no scene are left alone: {_listed(others)}"] if others else []
    return long.drop(columns=["_line", "_place", "_row"]), tuple(long["_row"]), said


def _scene_columns(
    columns: Columns, names: Sequence[str], scene_ids: Collection[str]
) -> dict[str, str]:
    """Columns of a wide table that name a scene, and its id; if any are ids themselves, those."""
    names = [name for name in names if name not in columns.needed]
    if columns.scene is not None and columns.scene.pattern is not None:
        matches = {name: re.search(columns.scene.pattern, name) for name in names}
        return {name: one[1] for name, one in matches.items() if one}
    if exact := {name: name for name in names if name in set(scene_ids)}:
        return exact
    finder = _finder(scene_ids)
    found = {name: set(finder.findall(name)) for name in names}
    return {name: one.pop() for name, one in found.items() if len(one) == 1}


def _listed(names: Sequence[object]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(map(str, names[:_MOST_NAMED])) + more
