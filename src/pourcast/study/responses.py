"""Responses of participants: read, checked row by row, and excluded by explicit rules only.

A table with a row a trial, CSV or Parquet. Columns: `participant`, `scene` (its id),
`liquid`, `response` (0..1); optional: `trial`, `phase` (``test`` by default; other phases
are not compared), `rt` [s], `mirrored` (the scene was shown in a mirror), `correct` (of
attention checks), `simulated`. Any other column is left alone. `study.columns` says how tables with
other columns are read.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unicodedata import normalize

import pandas as pd

from pourcast.errors import Faults, InputError, unknown
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.study.columns import Columns
from pourcast.study.experiments.base import Experiment
from pourcast.study.recode import MEANS, REQUIRED, recode
from pourcast.study.scale import PERCENT, SHARES, Scale
from pourcast.tables import FIRST_ROW, more_rows, refuse_rows, require_columns

LONGEST_MEDIAN = 300.0
"""Longest median response time [s] that is taken for one; a longer one is in milliseconds."""


TEST, ATTENTION = "test", "attention"
"""Phases: trials that are compared, and attention checks."""


@dataclass(frozen=True)
class Exclusion:
    """What a rule took out.

    Parameters
    ----------
    rule
        The rule, as it was given.
    participants
        Those who were taken out.
    trials
        Test trials that went, theirs included.
    """

    rule: str
    participants: tuple[str, ...]
    trials: int


# Reading -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Origin:
    """Where a table is from, for error messages: its file, and what that calls our columns."""

    path: Path
    names: Mapping[str, str]

    def refuse(
        self, table: pd.DataFrame, column: str, wrong: "pd.Series[bool]", expected: str
    ) -> None:
        """Refuse rows of a column that are wrong, if any are."""
        called = self.called(column)
        cells = pd.DataFrame({called: table[column]})
        refuse_rows(self.path, cells, called, wrong, expected, table["row"].to_list())

    def called(self, column: str) -> str:
        """What the file calls a column."""
        return self.names.get(column, column)

    def numbers(self, table: pd.DataFrame, column: str) -> "pd.Series[float]":
        """A column of numbers; NaN where there is none."""
        numbers = pd.to_numeric(table[column], errors="coerce")
        wrong = numbers.isna() & table[column].notna()
        self.refuse(table, column, wrong, "expected a number")
        return numbers.astype(float)


def read_responses(
    path: Path,
    scenes: Sequence[Scene],
    *,
    columns: Columns | None = None,
    scale: Scale | None = None,
    own: Sequence[Liquid] = (),
    experiment: Experiment | None = None,
) -> pd.DataFrame:
    """Read a table of responses, or a folder of them, and check every row.

    Parameters
    ----------
    path
        A .csv or .parquet file, or a folder of them.
    columns
        Which column is what, if they are not called as here.
    scenes, scale, own, experiment
        As for `check_responses`; a scale that the mapping names need not be given.

    Returns
    -------
    DataFrame
        As from `check_responses`; `attrs["told"]` is a tuple of what a reader should know of how it
        was read.

    Raises
    ------
    InputError
        Names all that is wrong, a line each.
    """
    columns = columns or Columns()
    recoded = recode(path, columns, [scene.id for scene in scenes])
    used = columns.scale_or(scale) or SHARES
    checked = check_responses(
        recoded.table, path, scenes, scale=used, own=own, experiment=experiment,
        rows=recoded.rows, names=recoded.names,
    )  # fmt: skip
    said = [] if used == SHARES else [f"{path.name}: responses are on the scale {used.words}"]
    said += [f"{path.name}: {text}" for text in _on_another_scale(checked, used)]
    checked.attrs["told"] = (*recoded.remarks, *said)
    return checked


def _on_another_scale(table: pd.DataFrame, scale: Scale) -> list[str]:
    """Who seems to have answered in 0..1 where others did on a longer scale."""
    if scale.high <= 1.0 or scale.low < 0.0:
        return []
    test = table[table["phase"] == TEST]
    written = (test["response"] * (scale.high - scale.low) + scale.low).round(9)
    who_answered = test["participant"]
    between = (written % 1.0 > 0.0).groupby(who_answered).any()
    within = (written.groupby(who_answered).max() <= 1.0) & between
    if not within.any():
        return []
    who = ", ".join(map(str, within.index[within]))
    return [f"nothing above 1 on the scale {scale.words}, as if answered in 0..1, by {who}"]


def check_responses(
    table: pd.DataFrame,
    path: Path,
    scenes: Sequence[Scene],
    *,
    scale: Scale = SHARES,
    own: Sequence[Liquid] = (),
    experiment: Experiment | None = None,
    rows: Sequence[int | str] | None = None,
    names: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Check every row of a table of responses.

    Parameters
    ----------
    table
        The table.
    path
        Where it comes from, for error messages.
    scenes
        The study's scenes.
    own
        The study's own liquids.
    scale
        What the least and the most that can be answered stand as; 0 and 1 by default.
    experiment
        The study's experiment: liquids that it shows others in place of are refused.
    rows
        Where each row stands in the file; one after another, by default.
    names
        What the file calls our columns, where it calls them otherwise.

    Returns
    -------
    DataFrame
        The file's columns; `phase` and `simulated` filled in, `liquid` as the judgments'
        tables name it, responses in 0..1 (NaN where none was given), and `row`, that of the file.

    Raises
    ------
    InputError
        A line for each column and what was expected of it, which names the rows.
    """
    require_columns(path, table, REQUIRED)
    table = table.assign(row=range(FIRST_ROW, FIRST_ROW + len(table)) if rows is None else rows)
    if table.empty:
        raise InputError(f"{path}: no rows, expected one a trial")
    origin, faults = _Origin(path, names or {}), Faults()
    for name in ("participant", "scene", "liquid"):
        with faults:
            origin.refuse(table, name, table[name].isna(), "expected a name")
        table[name] = table[name].map(_text, na_action="ignore")
    default = pd.Series(TEST, index=table.index, dtype=object)
    table["phase"] = table["phase"].fillna(TEST).map(_phase) if "phase" in table else default
    for name in ("simulated", "mirrored"):
        table[name] = _flags(origin, table, name, faults)
    judged = table["phase"] == TEST
    table["response"] = _shares(origin, table, judged, scale, faults)
    if "rt" in table:
        with faults:
            table["rt"] = _seconds(origin, table)
    if "answers" in table and (table["participant"] == MEANS).all():
        with faults:
            counts = origin.numbers(table, "answers")
            origin.refuse(table, "answers", counts <= 0, "expected a number above 0")
    table["liquid"] = _known_liquids(origin, table, scenes, own, experiment, faults)
    faults.refuse()
    return table


def _text(value: Any) -> str:
    whole = isinstance(value, float) and value.is_integer()
    # One name may be written in two forms of Unicode.
    return str(int(value)) if whole else normalize("NFC", str(value).strip())


def _phase(value: Any) -> str:
    return str(value).strip().lower()


def _flags(origin: _Origin, table: pd.DataFrame, column: str, faults: Faults) -> "pd.Series[bool]":
    """A column of yes and no; no where there is none."""
    if column not in table:
        return pd.Series(data=False, index=table.index)
    words = table[column].map(lambda value: str(value).strip().lower())
    known = {"true": True, "1": True, "1.0": True, "yes": True}
    known |= {"false": False, "0": False, "0.0": False, "no": False, "nan": False, "": False}
    with faults:
        origin.refuse(table, column, ~words.isin(known), "expected true or false")
    return words.map(known).eq(other=True)


def _shares(
    origin: _Origin, table: pd.DataFrame, judged: "pd.Series[bool]", scale: Scale, faults: Faults
) -> "pd.Series[float]":
    """Responses as shares; NaN where none was given (a trial that timed out)."""
    written = table["response"].map(lambda value: str(value).strip(), na_action="ignore")
    signs = written.map(lambda value: str(value).endswith("%")).astype(bool)
    plain = judged & written.notna() & ~signs
    if signs.any():
        with faults:
            origin.refuse(table, "response", plain, "expected a percent sign, as in other rows")
        table, scale = table.assign(response=written.str.rstrip("% ")), PERCENT
    with faults:
        origin.numbers(table, "response")
    values = pd.to_numeric(table["response"], errors="coerce").astype(float)
    outside = (values < scale.low) | (values > scale.high)
    hint = "" if scale != SHARES else " (on another scale? say which, such as --scale 0-100)"
    with faults:
        shown = table.assign(response=values)
        origin.refuse(shown, "response", outside, f"expected {scale.words}{hint}")
    if scale.high > 1.0 and not signs.any() and values[judged].max() <= 1.0:
        with faults:
            raise InputError(
                f"{origin.path}: column {origin.called('response')}: expected "
                f"{scale.words}, found nothing above {values[judged].max():g}: are these 0..1 "
                "already?"
            )
    return (values - scale.low) / (scale.high - scale.low)


def _seconds(origin: _Origin, table: pd.DataFrame) -> "pd.Series[float]":
    """Response times; none that can't be seconds."""
    times = origin.numbers(table, "rt")
    if (median := float(times.median())) > LONGEST_MEDIAN:
        raise InputError(
            f"{origin.path}: column {origin.called('rt')}: expected seconds, found a "
            f"median of {median:g}: are these milliseconds (--columns rt_unit:ms)?"
        )
    return times


def _known_liquids(
    origin: _Origin,
    table: pd.DataFrame,
    scenes: Sequence[Scene],
    own: Sequence[Liquid],
    experiment: Experiment | None,
    faults: Faults,
) -> list[Any]:
    """Liquids as the judgments' tables name them; scenes and liquids that aren't known are kept."""
    known = {scene.id: scene for scene in scenes}
    # Practice trials may show scenes that are none of the study's.
    named = (table["phase"] == TEST) & table["scene"].notna() & table["liquid"].notna()
    strange = (table["phase"] == TEST) & table["scene"].notna() & ~table["scene"].isin(known)
    first = table["scene"][strange].iloc[0] if strange.any() else ""
    hint = unknown(first, list(known)[:5]) if first else ""
    with faults:
        origin.refuse(table, "scene", strange, f"expected a scene of the study ({hint} ...)")
    kinds = table["scene"].map(lambda scene: known[scene].goal.kind if scene in known else "")
    names: dict[tuple[str, str], str] = {}
    for at, rows in table[named & ~strange].groupby([table["liquid"], kinds], sort=False):
        liquid, kind = map(str, at)
        try:
            _refuse_namesake(liquid, experiment)
            scene = known[rows["scene"].iloc[0]]
            names[liquid, kind] = resolve_liquid(liquid, scene, own).name
        except InputError as error:
            expected = str(error).removeprefix("liquid: ")
            with faults:
                raise InputError(
                    f"{origin.path}: row {rows['row'].iloc[0]}, column "
                    f"{origin.called('liquid')}: {expected}"
                    f"{more_rows(rows['row'].to_list()[1:])}"
                ) from None
    return [
        names.get((liquid, kind), liquid)
        for liquid, kind in zip(table["liquid"], kinds, strict=True)
    ]


def _refuse_namesake(liquid: str, experiment: Experiment | None) -> None:
    if experiment is not None and (meant := experiment.namesake(liquid)) is not None:
        raise InputError(
            f"liquid: {liquid!r} is not what {experiment.name} shows by that name: if {meant!r} "
            "was shown, as by pourcast 0.1, write that there (`pourcast experiment data` makes a "
            "table of a database, --responses takes it)"
        )


# Excluding ---------------------------------------------------------------------------


def _participants_below(values: "pd.Series[Any]", least: float) -> list[str]:
    return [str(name) for name in values.index[values < least]]


def _min_sd(table: pd.DataFrame, least: float) -> list[str]:
    test = table[table["phase"] == TEST]
    return _participants_below(test.groupby("participant")["response"].std(ddof=0), least)


def _min_trials(table: pd.DataFrame, least: float) -> list[str]:
    test = table[table["phase"] == TEST]
    return _participants_below(test.groupby("participant")["response"].count(), least)


def _min_attention(table: pd.DataFrame, least: float) -> list[str]:
    checks = table[table["phase"] == ATTENTION]
    if "correct" not in table or checks.empty:
        raise InputError(
            "needs rows of the phase 'attention' and the column 'correct', and there are none"
        )
    correct = checks["correct"].map(lambda value: str(value).lower() in ("true", "1", "1.0"))
    return _participants_below(correct.groupby(checks["participant"]).mean(), least)


PARTICIPANT_RULES: Mapping[str, Callable[[pd.DataFrame, float], list[str]]] = {
    "min-sd": _min_sd,
    "min-trials": _min_trials,
    "min-attention": _min_attention,
}
"""Rules that take out participants: least spread of the answers, number of test trials,
share of attention checks that were answered rightly."""

TRIAL_RULES = ("min-rt", "max-rt")
"""Rules that take out single trials, by response time [s]."""

RULES = (*PARTICIPANT_RULES, *TRIAL_RULES, "participant", "repeats")


def exclude(table: pd.DataFrame, rules: Sequence[str]) -> tuple[pd.DataFrame, list[Exclusion]]:
    """Take out participants and trials by rules, one after another.

    Parameters
    ----------
    table
        From `read_responses`.
    rules
        ``min-sd=0.05``, ``min-trials=100``, ``min-attention=0.75``, ``min-rt=0.3``,
        ``max-rt=60``, ``participant=NAME``, ``repeats=first`` or ``repeats=last`` (which of a
        participant's repeated trials is kept).

    Returns
    -------
    DataFrame, list of Exclusion
        What is left, and what each rule took out, even if that is nothing.

    Raises
    ------
    InputError
        If a rule is wrong, or nothing is left.
    """
    if rules and (table["participant"] == MEANS).all():
        raise InputError("exclude: only means are known, and no participants or trials of theirs")
    exclusions = []
    for rule in rules:
        name, equals, value = (part.strip() for part in rule.partition("="))
        if name not in RULES:
            raise InputError(f"exclude: {unknown(name, RULES)}")
        if not equals or not value:
            raise InputError(f"exclude: {name}: expected {name}=VALUE")
        try:
            out = _matched(table, name, value)
        except InputError as error:
            raise InputError(f"exclude: {rule}: {error}") from None
        test = table["phase"] == TEST
        kept = table[~out]
        gone = sorted(set(table["participant"][test]) - set(kept["participant"]))
        exclusions.append(Exclusion(rule, tuple(gone), int((out & test).sum())))
        table = kept
    if not (table["phase"] == TEST).any():
        raise InputError("exclude: no test trials are left")
    return table, exclusions


def _matched(table: pd.DataFrame, name: str, value: str) -> "pd.Series[bool]":
    """Which rows a rule takes out."""
    if name == "participant":
        if value not in set(table["participant"]):
            raise InputError("there is no such participant")
        return table["participant"] == value
    if name == "repeats":
        if value not in ("first", "last"):
            raise InputError(f"expected first or last, found {value!r}")
        test = table["phase"] == TEST
        keep: Any = value
        again = table[test].duplicated(["participant", "scene", "liquid"], keep=keep)
        return again.reindex(table.index, fill_value=False)
    try:
        number = float(value)
    except ValueError:
        raise InputError(f"expected a number, found {value!r}") from None
    if name in PARTICIPANT_RULES:
        return table["participant"].isin(PARTICIPANT_RULES[name](table, number))
    if "rt" not in table:
        raise InputError("needs the column 'rt', and there is none")
    slow = table["rt"] < number if name == "min-rt" else table["rt"] > number
    return slow & (table["phase"] == TEST)
