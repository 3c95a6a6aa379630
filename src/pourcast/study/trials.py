"""Responses as arrays: a row a participant, a column a scene; what a reader should know of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.scenes.scene import Scene
from pourcast.study.recode import MEANS
from pourcast.study.responses import TEST
from pourcast.tables import more_rows

_TRIAL = ["participant", "scene", "liquid"]
"""Columns that tell what was asked whom."""


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
        right basin, or of the cup, of the scene as it is in the file (not mirrored). The mean
        where somebody answered a scene several times.
    occasions
        Shape [occasion_count, participant_count, scene_count]: first answers, second ones, and so
        on; NaN where there is none. None if nobody answered a scene twice.
    means_of
        If only means are known, which then are the only row of `responses`: how many answers each
        is of, shape [scene_count]; NaN if that isn't known either. None otherwise.
    """

    liquid: str
    participants: tuple[str, ...]
    scenes: tuple[Scene, ...]
    responses: NDArray[np.float64]
    occasions: NDArray[np.float64] | None = None
    means_of: NDArray[np.float64] | None = None

    @property
    def participant_count(self) -> int:
        """How many participants are known; 0 where only means are."""
        return 0 if self.means_of is not None else len(self.participants)


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

    Returns
    -------
    list of Trials
        Those of water first. Answers of a participant to a scene that was shown several times are
        averaged; exact copies of a row (`copied`) count once.

    Raises
    ------
    InputError
        If there is no response to any test trial, or two means of one scene.
    """
    test = table[(table["phase"] == TEST) & table["response"].notna()]
    if test.empty:
        phases = ", ".join(sorted(set(table["phase"])))
        raise InputError(f"{source}: no response to any test trial (phases: {phases})")
    test = test[~copied(test)]
    known = {scene.id: scene for scene in scenes}
    trials = zip(test["mirrored"], test["scene"], test["response"], strict=True)
    test = test.assign(
        response=[
            known[scene].goal.mirrored_judgment(response) if mirrored else response
            for mirrored, scene, response in trials
        ]
    )
    means = bool((test["participant"] == MEANS).all())
    if means:
        _refuse_second_means(test, source)
    liquids = sorted(set(test["liquid"]), key=lambda name: (name != "water", name))
    return [_of_liquid(liquid, test[test["liquid"] == liquid], scenes, means) for liquid in liquids]


def _refuse_second_means(test: pd.DataFrame, source: str) -> None:
    again = test[test.duplicated(_TRIAL)]
    if len(again):
        one = again.iloc[0]
        raise InputError(
            f"{source}: row {one['row']}: a second mean of scene {one['scene']} ({one['liquid']})"
            f"{more_rows(again['row'].to_list()[1:])}"
        )


def _of_liquid(liquid: str, rows: pd.DataFrame, scenes: Sequence[Scene], means: bool) -> Trials:
    """Trials of one liquid: an array for each occasion, and their mean."""
    there = set(rows["scene"])
    answered = tuple(scene for scene in scenes if scene.id in there)
    ids = [scene.id for scene in answered]
    people = sorted(set(rows["participant"]))
    occasion = rows.groupby(_TRIAL, sort=False).cumcount()
    each = np.stack(
        [
            again.pivot(index="participant", columns="scene", values="response")
            .reindex(index=people, columns=ids)
            .to_numpy(float)
            for _, again in rows.groupby(occasion)
        ]
    )
    counts = pd.to_numeric(rows["answers"], errors="coerce") if "answers" in rows else np.nan
    return Trials(
        liquid,
        tuple(map(str, people)),
        answered,
        each[0] if len(each) == 1 else _mean(each),
        each if len(each) > 1 else None,
        pd.Series(counts, index=rows.index).groupby(rows["scene"]).first()[ids].to_numpy(float)
        if means
        else None,
    )


def _mean(each: NDArray[np.float64]) -> NDArray[np.float64]:
    """Over the occasions on which there is an answer; shape [participant_count, scene_count]."""
    there = np.isfinite(each)
    with np.errstate(invalid="ignore"):
        mean: NDArray[np.float64] = np.where(there, each, 0.0).sum(axis=0) / there.sum(axis=0)
    return mean


def copied(table: pd.DataFrame) -> "pd.Series[bool]":
    """Test rows that are copies of earlier ones in all columns, trial number or time among them.

    Parameters
    ----------
    table
        From `responses.read_responses`.
    """
    told = [name for name in ("trial", "rt") if name in table]
    numbered = table[told].notna().any(axis=1) & (table["phase"] == TEST)
    return numbered & table.drop(columns="row").duplicated()


def repeats(table: pd.DataFrame) -> list[str]:
    """What a reader should know of trials that somebody answered several times.

    Parameters
    ----------
    table
        From `responses.read_responses` or `responses.exclude`.
    """
    test = table[(table["phase"] == TEST) & table["response"].notna()]
    copies = copied(test)
    again = test[~copies].duplicated(_TRIAL)
    found = []
    if copies.any():
        rows = test["row"][copies].to_list()
        found.append(
            f"{len(rows)} rows are copies of others, with the same trial number or response time: "
            f"they count once (row {rows[0]}{more_rows(rows[1:])})"
        )
    if again.any():
        people = test["participant"][again.reindex(test.index, fill_value=False)].nunique()
        found.append(
            f"{int(again.sum())} trials of {people} participants repeat a scene with its liquid: "
            "their answers are averaged (--exclude repeats=first keeps the first)"
        )
    return found


def remarks(trials: Sequence[Trials], scenes: Sequence[Scene]) -> list[str]:
    """What a reader should know of the data: gaps, constant answers, scenes without answers."""
    found = []
    for one in trials:
        absent = [scene.id for scene in scenes if scene not in one.scenes]
        if absent:
            found.append(f"{one.liquid}: nobody answered {len(absent)} scenes: {_listed(absent)}")
        if one.means_of is not None:
            found.append(f"{one.liquid}: only means are known, and nothing of single participants")
            continue
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


def uncompared(table: pd.DataFrame) -> list[str]:
    """What a reader should know of rows of other phases, or without a response: not compared.

    Parameters
    ----------
    table
        From `read_responses`.
    """
    test = table[table["phase"] == TEST]
    others = table["phase"][table["phase"] != TEST].value_counts()
    said = ", ".join(f"{count} of {phase}" for phase, count in others.items())
    found = [f"rows of other phases are not compared: {said}"] if said else []
    blank = test["response"].isna()
    if not blank.any():
        return found
    silent = blank.groupby(test["participant"]).all()
    found.append(f"{int(blank.sum())} test trials have no response: they count as missing")
    if silent.any():
        names = [str(name) for name in silent.index[silent]]
        found.append(f"without any response, and so no participants: {_listed(names)}")
    return found


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
