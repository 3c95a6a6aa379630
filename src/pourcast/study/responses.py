"""Responses of participants: read, checked row by row, and excluded by explicit rules only.

A table with a row a trial, CSV or Parquet. Columns: `participant`, `scene` (its id),
`liquid`, `response` (0..1); optional: `trial`, `phase` (``test`` by default; other phases
are not compared), `rt` [s], `mirrored` (the scene was shown in a mirror), `correct` (of
attention checks), `simulated`. Any other column is left alone.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unicodedata import normalize

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError, unknown
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.study.experiments.base import Experiment
from pourcast.tables import FIRST_ROW, numbers_in, read_table, refuse_rows, require_columns

REQUIRED = ("participant", "scene", "liquid", "response")


@dataclass(frozen=True)
class Scale:
    """What the least and the most that can be answered stand as in a table."""

    low: float
    high: float

    @property
    def words(self) -> str:
        """The range, as messages have it."""
        return f"{self.low:g}..{self.high:g}"


SHARES, PERCENT = Scale(0.0, 1.0), Scale(0.0, 100.0)


def scale_of(text: str) -> Scale:
    """A scale as a user writes it.

    Raises
    ------
    InputError
        If it is none.

    Examples
    --------
    >>> scale_of("0-100"), scale_of("-1..1")
    (Scale(low=0.0, high=100.0), Scale(low=-1.0, high=1.0))
    """
    number = r"[-+]?\d+(?:\.\d+)?"
    found = re.fullmatch(rf"\s*({number})\s*(?:-|\.\.|:)\s*({number})\s*", text)
    if found is None or not float(found[1]) < float(found[2]):
        raise InputError(f"scale: expected LOW-HIGH, such as 0-100 or -1..1, found {text!r}")
    return Scale(float(found[1]), float(found[2]))


TEST, ATTENTION = "test", "attention"
"""Phases: trials that are compared, and attention checks."""


@dataclass(frozen=True)
class Trials:
    """Responses to the trials of one liquid.

    Parameters
    ----------
    liquid
        Name of the liquid that was shown.
    participants
        Who answered at least once.
    scenes
        Scenes that were answered at least once, in the study's order.
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer. Shares of the
        right basin, or of the cup, of the scene as it is in the file (not mirrored).
    """

    liquid: str
    participants: tuple[str, ...]
    scenes: tuple[Scene, ...]
    responses: NDArray[np.float64]


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


def read_responses(
    path: Path,
    scenes: Sequence[Scene],
    *,
    scale: Scale = SHARES,
    own: Sequence[Liquid] = (),
    experiment: Experiment | None = None,
) -> pd.DataFrame:
    """Read a table of responses, a .csv or .parquet file, and check every row.

    See `check_responses`; `attrs["read_as"]` is that of `tables.read_table`.
    """
    table = read_table(path, text=("participant", "scene", "liquid", "phase"))
    checked = check_responses(table, path, scenes, scale=scale, own=own, experiment=experiment)
    checked.attrs["read_as"] = table.attrs.get("read_as", "")
    return checked


def check_responses(
    table: pd.DataFrame,
    path: Path,
    scenes: Sequence[Scene],
    *,
    scale: Scale = SHARES,
    own: Sequence[Liquid] = (),
    experiment: Experiment | None = None,
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

    Returns
    -------
    DataFrame
        The file's columns; `phase` and `simulated` filled in, `liquid` as the judgments'
        tables name it, responses in 0..1 (NaN where none was given), and `row`, that of the file.

    Raises
    ------
    InputError
        One line that names the row, the column and what was expected.
    """
    require_columns(path, table, REQUIRED)
    blank = table.isna().all(axis=1)
    table = table.assign(row=np.arange(len(table)) + FIRST_ROW)[~blank]
    if table.empty:
        raise InputError(f"{path}: no rows, expected one a trial")
    for name in ("participant", "scene", "liquid"):
        _refuse(path, table, name, table[name].isna(), "expected a name")
        table[name] = table[name].map(_text)
    default = pd.Series(TEST, index=table.index, dtype=object)
    table["phase"] = table["phase"].fillna(TEST).map(_phase) if "phase" in table else default
    table["simulated"] = _flags(path, table, "simulated")
    table["mirrored"] = _flags(path, table, "mirrored")
    judged = table["phase"] == TEST
    table["response"] = _shares(path, table, judged, scale)
    if "rt" in table:
        table["rt"] = _numbers(path, table, "rt")
    return _with_known_scenes(path, table, scenes, own, experiment)


def _text(value: Any) -> str:
    whole = isinstance(value, float) and value.is_integer()
    # One name may be written in two forms of Unicode.
    return str(int(value)) if whole else normalize("NFC", str(value).strip())


def _phase(value: Any) -> str:
    return str(value).strip().lower()


def _refuse(
    path: Path, table: pd.DataFrame, column: str, wrong: "pd.Series[bool]", expected: str
) -> None:
    refuse_rows(path, table, column, wrong, expected, table["row"].to_list())


def _numbers(
    path: Path, table: pd.DataFrame, column: str, needed: "pd.Series[bool] | None" = None
) -> "pd.Series[float]":
    return numbers_in(path, table, column, needed, table["row"].to_list())


def _flags(path: Path, table: pd.DataFrame, column: str) -> "pd.Series[bool]":
    """A column of yes and no; no where there is none."""
    if column not in table:
        return pd.Series(data=False, index=table.index)
    words = table[column].map(lambda value: str(value).strip().lower())
    known = {"true": True, "1": True, "1.0": True, "yes": True}
    known |= {"false": False, "0": False, "0.0": False, "no": False, "nan": False, "": False}
    _refuse(path, table, column, ~words.isin(known), "expected true or false")
    return words.map(known).astype(bool)


def _shares(
    path: Path, table: pd.DataFrame, judged: "pd.Series[bool]", scale: Scale
) -> "pd.Series[float]":
    """Responses as shares; NaN where none was given (a trial that timed out)."""
    written = table["response"].map(lambda value: str(value).strip(), na_action="ignore")
    signs = written.map(lambda value: str(value).endswith("%")).astype(bool)
    plain = judged & written.notna() & ~signs
    if signs.any():
        _refuse(path, table, "response", plain, "expected a percent sign, as in other rows")
        table, scale = table.assign(response=written.str.rstrip("% ")), PERCENT
    values = _numbers(path, table, "response")
    shown = table.assign(response=values)
    outside = (values < scale.low) | (values > scale.high)
    hint = "" if scale != SHARES else " (on another scale? say which, such as --scale 0-100)"
    _refuse(path, shown, "response", outside, f"expected {scale.words}{hint}")
    if scale.high > 1.0 and not signs.any() and values[judged].max() <= 1.0:
        raise InputError(
            f"{path}: column response: expected {scale.words}, found nothing above "
            f"{values[judged].max():g}: are these 0..1 already?"
        )
    return (values - scale.low) / (scale.high - scale.low)


def _with_known_scenes(
    path: Path,
    table: pd.DataFrame,
    scenes: Sequence[Scene],
    own: Sequence[Liquid],
    experiment: Experiment | None,
) -> pd.DataFrame:
    known = {scene.id: scene for scene in scenes}
    # Practice trials may show scenes that are none of the study's.
    judged = table["phase"] == TEST
    strange = judged & ~table["scene"].isin(known)
    first = table["scene"][strange].iloc[0] if strange.any() else ""
    hint = unknown(first, list(known)[:5]) if first else ""
    _refuse(path, table, "scene", strange, f"expected a scene of the study ({hint} ...)")
    names: dict[tuple[str, str], str] = {}
    for row, liquid, scene in zip(
        table["row"][judged], table["liquid"][judged], table["scene"][judged], strict=True
    ):
        kind = known[scene].goal.kind
        if (liquid, kind) not in names:
            try:
                _refuse_namesake(liquid, experiment)
                names[liquid, kind] = resolve_liquid(liquid, known[scene], own).name
            except InputError as error:
                raise InputError(f"{path}: row {row}, column {error}") from None
    resolved = [
        names.get((liquid, known[scene].goal.kind), liquid) if scene in known else liquid
        for liquid, scene in zip(table["liquid"], table["scene"], strict=True)
    ]
    return table.assign(liquid=resolved)


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


# Arranging ---------------------------------------------------------------------------


def arrange(table: pd.DataFrame, scenes: Sequence[Scene], source: str) -> list[Trials]:
    """Responses as an array for each liquid.

    Parameters
    ----------
    table
        From `read_responses` or `exclude`.
    scenes
        The study's scenes.
    source
        Name of the file, for error messages.

    Raises
    ------
    InputError
        If a participant answered a trial twice.
    """
    test = table[(table["phase"] == TEST) & table["response"].notna()]
    if test.empty:
        raise InputError(f"{source}: no response to any test trial")
    keys = ["participant", "scene", "liquid"]
    again = test[test.duplicated(keys, keep="first")]
    if len(again):
        second = again.iloc[0]
        same = (test[keys] == second[keys]).all(axis=1)
        raise InputError(
            f"{source}: rows {test['row'][same].iloc[0]} and {second['row']}: participant "
            f"{second['participant']} answered scene {second['scene']} ({second['liquid']}) twice; "
            f"keep one of them with --exclude repeats=first ({len(again)} repeated trials)"
        )
    known = {scene.id: scene for scene in scenes}
    trials = zip(test["mirrored"], test["scene"], test["response"], strict=True)
    test = test.assign(
        response=[
            known[scene].goal.mirrored_judgment(response) if mirrored else response
            for mirrored, scene, response in trials
        ]
    )
    found = []
    for liquid in sorted(set(test["liquid"]), key=lambda name: (name != "water", name)):
        wide = test[test["liquid"] == liquid].pivot(
            index="participant", columns="scene", values="response"
        )
        answered = [scene for scene in scenes if scene.id in wide.columns]
        wide = wide[[scene.id for scene in answered]]
        found.append(
            Trials(liquid, tuple(map(str, wide.index)), tuple(answered), wide.to_numpy(float))
        )
    return found


def remarks(trials: Sequence[Trials], scenes: Sequence[Scene]) -> list[str]:
    """What a reader should know of the data: gaps, constant answers, scenes without answers."""
    found = []
    for one in trials:
        absent = [scene.id for scene in scenes if scene not in one.scenes]
        if absent:
            found.append(f"{one.liquid}: nobody answered {len(absent)} scenes: {_listed(absent)}")
        gaps = np.isnan(one.responses).sum(axis=1)
        short = [
            f"{name} ({count})"
            for name, count in zip(one.participants, gaps, strict=True)
            if count > 0
        ]
        if short:
            found.append(
                f"{one.liquid}: {len(short)} participants left out scenes (number): "
                f"{_listed(short)}; means are over those who answered"
            )
        spread = np.nanmax(one.responses, axis=1) - np.nanmin(one.responses, axis=1)
        constant = [one.participants[k] for k in np.flatnonzero(spread < 1e-9)]
        if constant:
            found.append(
                f"{one.liquid}: always the same answer: {_listed(constant)}; they have no "
                "correlation of their own (--exclude min-sd=... takes them out)"
            )
    return found


def blanks(table: pd.DataFrame) -> list[str]:
    """What a reader should know of test trials without a response, such as timed-out ones.

    Parameters
    ----------
    table
        From `read_responses`.
    """
    test = table[table["phase"] == TEST]
    blank = test["response"].isna()
    if not blank.any():
        return []
    silent = blank.groupby(test["participant"]).all()
    found = [f"{int(blank.sum())} test trials have no response: they count as missing"]
    if silent.any():
        names = [str(name) for name in silent.index[silent]]
        found.append(f"without any response, and so no participants: {_listed(names)}")
    return found


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
