"""Tables of other programs, recoded into tables of responses by a mapping (`study.columns`)."""

import re
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
from pourcast.tables import FIRST_ROW, MISSING, TABLE_SUFFIXES, read_table, refuse_rows

REQUIRED = ("participant", "scene", "liquid", "response")
"""Columns that a table of responses must have."""

TEXT = ("participant", "scene", "liquid", "phase")
"""Columns of names, even where these look like numbers."""

MEANS = ""
"""Stands for the participant where only means are known; nobody is called so."""

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


def recode(path: Path, columns: Columns, scene_ids: Collection[str]) -> Recoded:
    """Read a table, or a folder of tables, by a mapping.

    Parameters
    ----------
    path
        A .csv or .parquet file, or a folder of them, which are read in the order of their names.
    columns
        Which column is what.
    scene_ids
        Of the study's scenes, which are looked for in what names a scene.

    Raises
    ------
    InputError
        Names the file and all columns that are missing, or the rows that are wrong.
    """
    if not path.is_dir():
        return _some(path, _file(path, columns, scene_ids))
    files = [one for one in finished_files(path) if one.suffix.lower() in TABLE_SUFFIXES]
    if not files:
        raise InputError(f"{path}: no table, expected {' or '.join(TABLE_SUFFIXES)} files")
    parts, faults = [], Faults()
    for file in files:
        with faults:
            parts.append(_file(file, columns, scene_ids))
    faults.refuse()
    rows = [
        f"{row} of {file.name}" for file, one in zip(files, parts, strict=True) for row in one.rows
    ]
    whole = Recoded(
        pd.concat([one.table for one in parts], ignore_index=True),
        tuple(rows),
        parts[0].names,
        (f"{path.name}: {len(files)} tables", *(said for one in parts for said in one.remarks)),
    )
    return _some(path, whole)


def _some(path: Path, found: Recoded) -> Recoded:
    """Refuse a table without any trial."""
    if found.table.empty:
        raise InputError("; ".join((f"{path}: no rows, expected one a trial", *found.remarks)))
    return found


def _file(path: Path, columns: Columns, scene_ids: Collection[str]) -> Recoded:
    if columns.header_rows and path.suffix.lower() == ".parquet":
        raise InputError(f"{path}: header_rows: a Parquet table has none")
    texts = {
        name for name in columns.needed if columns.needed[name] in (*TEXT, "trials", "practice")
    }
    raw = read_table(path, text=sorted({*TEXT, *texts}), extra_header_rows=columns.header_rows)
    read_as, decimal = raw.attrs.get("read_as", ""), raw.attrs.get("decimal", ".")
    raw.index = pd.Index(np.arange(len(raw)) + FIRST_ROW + columns.header_rows)
    raw = raw[raw.notna().any(axis=1)]
    _require(path, raw, columns, scene_ids)
    remarks = [f"{path.name} was read as {read_as}"] if read_as else []
    kept, left_out = _trials(path, raw, columns)
    remarks += left_out
    values = {
        name: _values(path, raw, source, kept)
        for name, source in columns.sources.items()
        if not source.in_header
    }
    if columns.means:
        values["participant"] = pd.Series(MEANS, index=raw.index)
    table = raw.assign(**values)[kept]
    rows: tuple[int | str, ...] = tuple(table.index.to_list())
    if columns.wide:
        table, rows, said = _long(path, table, columns, scene_ids)
        remarks += said
    elif columns.scene is None or columns.scene.pattern is None:
        table, said = _with_scene_ids(path, table, columns, scene_ids)
        remarks += said
    for name in {"response", "rt"} & set(table.columns):
        table[name] = _numbers(table[name], columns.missing, decimal)
    if columns.rt_unit == "ms" and "rt" in table:
        seconds = pd.to_numeric(table["rt"], errors="coerce") / 1000.0
        table["rt"] = seconds.where(seconds.notna(), table["rt"])
    names = {name: source.column for name, source in columns.sources.items() if source.column}
    return Recoded(table.reset_index(drop=True), rows, names, tuple(remarks))


def _require(path: Path, raw: pd.DataFrame, columns: Columns, scene_ids: Collection[str]) -> None:
    """Refuse a table without a column that is needed; says which are, and how to map them."""
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
    suggestion = f"; {hint(there, scene_ids)}" if columns == Columns() else ""
    raise InputError(
        f"{path}: {some} {', '.join(missing)} {verb} missing; expected {', '.join(REQUIRED)}, "
        f"found {', '.join(there)}{suggestion}"
    )


# Rows ----------------------------------------------------------------------------------


def _meets(raw: pd.DataFrame, conditions: Mapping[str, tuple[str, ...]]) -> "pd.Series[bool]":
    """Rows in which all columns have what they should."""
    met = pd.Series(data=True, index=raw.index)
    for column, wanted in conditions.items():
        cells = raw[column].map(plain_text)
        met &= (cells != "") if ANY in wanted else cells.isin(wanted)
    return met


def _trials(path: Path, raw: pd.DataFrame, columns: Columns) -> tuple["pd.Series[bool]", list[str]]:
    """Which rows are trials, and what is said of the others."""
    trials = _meets(raw, columns.trials)
    practice = _meets(raw, columns.practice) if columns.practice else ~trials & False
    kept = trials & ~practice
    counts = {"of practice": practice.sum(), "no trials": (~trials & ~practice).sum()}
    left_out = [f"{count} {what}" for what, count in counts.items() if count]
    said = f"{path.name}: {len(raw)} rows, {kept.sum()} of them trials; left out: "
    there = "" if kept.any() else "".join(_found(raw, name) for name in columns.trials)
    return kept, [said + ", ".join(left_out) + there] if left_out else []


def _found(raw: pd.DataFrame, column: str) -> str:
    return f"; found in {column}: {_listed(list(raw[column].dropna().unique()))}"


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
    if source.fill:
        return cells.ffill()
    wrong = kept & cells.isna() & raw[source.column].notna()
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
    texts = cells.map(plain_text)
    cells = cells.mask(texts.isin([*missing, *map(str.casefold, MISSING)]))
    if decimal == ".":
        return cells
    commas = texts.str.fullmatch(r"[-+]?\d*,\d+%?")
    return cells.where(~commas, texts.str.replace(",", "."))


# Scenes --------------------------------------------------------------------------------


def _finder(scene_ids: Collection[str]) -> re.Pattern[str]:
    """Finds ids of scenes that stand in a text as a word."""
    longest_first = sorted(map(re.escape, scene_ids), key=len, reverse=True)
    return re.compile(rf"(?<![^\W_])(?:{'|'.join(longest_first)})(?![^\W_])")


def _with_scene_ids(
    path: Path, table: pd.DataFrame, columns: Columns, scene_ids: Collection[str]
) -> tuple[pd.DataFrame, list[str]]:
    """Ids of scenes in place of texts that hold one; other texts stay, to be refused later."""
    if columns.scene is None or not scene_ids:
        return table, []
    finder = _finder(scene_ids)
    found = {text: set(finder.findall(str(text))) for text in table["scene"].dropna().unique()}
    ids = {text: one.pop() for text, one in found.items() if len(one) == 1 and one != {text}}
    if not ids:
        return table, []
    text, scene = next(iter(ids.items()))
    said = f"{path.name}: scenes are those that {columns.scene.column} names ({text!r}: {scene})"
    return table.assign(scene=table["scene"].map(lambda cell: ids.get(cell, cell))), [said]


def _long(
    path: Path, table: pd.DataFrame, columns: Columns, scene_ids: Collection[str]
) -> tuple[pd.DataFrame, tuple[str, ...], list[str]]:
    """A wide table with a row a response; which row and column each was; what was left alone."""
    scenes = _scene_columns(columns, [str(name) for name in table.columns], scene_ids)
    if not scenes:
        names = ", ".join(map(str, table.columns))
        raise InputError(f"{path}: no column names a scene of the study; found {names}")
    base = [name for name in FIELDS if name in table and name not in ("scene", "response")]
    parts = []
    for place, (column, scene) in enumerate(scenes.items()):
        part = table[base].assign(scene=scene, response=table[column], _place=place)
        if columns.liquid is not None and columns.liquid.in_header:
            part["liquid"] = _matched(path, column, columns.liquid)
        parts.append(part.assign(_row=[f"{row} ({column})" for row in table.index]))
    # By rows, then columns, as one reads.
    long = pd.concat(parts).rename_axis("_line").reset_index().sort_values(["_line", "_place"])
    others = [name for name in table.columns if name not in (*scenes, *base, *columns.needed)]
    said = [f"{path.name}: columns that name no scene are left alone: {_listed(others)}"]
    rows = tuple(long["_row"])
    return long.drop(columns=["_line", "_place", "_row"]), rows, said if others else []


def _scene_columns(
    columns: Columns, names: Sequence[str], scene_ids: Collection[str]
) -> dict[str, str]:
    """Columns of a wide table that name a scene, and its id."""
    others = set(columns.needed)
    if columns.scene is not None and columns.scene.pattern is not None:
        matches = {name: re.search(columns.scene.pattern, name) for name in names}
        return {name: one[1] for name, one in matches.items() if one and name not in others}
    finder = _finder(scene_ids)
    found = {name: set(finder.findall(name)) for name in names if name not in others}
    return {name: one.pop() for name, one in found.items() if len(one) == 1}


def _listed(names: Sequence[object]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(map(str, names[:_MOST_NAMED])) + more
