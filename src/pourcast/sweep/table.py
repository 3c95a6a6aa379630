"""From the shards to one tidy table of judgments."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from pourcast.sweep.plan import Answer, Plan
from pourcast.sweep.settings import named_engine
from pourcast.sweep.store import Store
from pourcast.sweep.survey import PlannedRows
from pourcast.tables import write_table

COLUMNS = ("scene", "digest", "liquid", "model", "parameters", "seed", "judgment")
"""As in a table of `prediction.predict`; a column for each parameter follows."""


def gather(plan: Plan, store: Store, files: Iterable[Path]) -> pd.DataFrame:
    """Table of all judgments that a grid asks for, in the grid's order.

    Parameters
    ----------
    plan
        The plan.
    store
        The store.
    files
        Files of the shards that hold the results.

    Returns
    -------
    DataFrame
        One row per scene, model, parameters, liquid and seed, with the columns of
        `prediction.predict`, then one per parameter (``model_`` before the name if it
        is taken). A judgment whose simulations are not all there is missing.
    """
    values = setting_judgments(plan, store, files)
    return judgment_table(plan, values)


def setting_judgments(plan: Plan, store: Store, files: Iterable[Path]) -> NDArray[np.float64]:
    """Judgment of each setting in each scene, shape [settings, scenes]; NaN where none is known."""
    values = np.full((len(plan.settings), len(plan.scenes)), np.nan)
    rows = PlannedRows(plan)
    for path in files:
        table = store.read(path)
        if table is not None:
            first, judgments = _over_draws(table)
            settings, scenes, wanted = (column[first] for column in rows.find(table))
            values[settings[wanted], scenes[wanted]] = judgments[wanted]
    return values


def _over_draws(table: pa.Table) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """First row of each judgment, and its mean over the draws, which lie one after another."""
    judgments = table["judgment"].to_numpy()
    first = np.flatnonzero(table["draw"].to_numpy() == 0)
    ends = np.append(first[1:], len(judgments))
    means = judgments[first].copy()
    for k in np.flatnonzero(ends - first > 1):
        # The same sum as in `means_over_pours`, to the last digit.
        means[k] = np.mean(judgments[first[k] : ends[k]])
    return first, means


LIQUIDS = "liquids"
"""What a table's file keeps beside the table: the study's own liquids in it, as they were."""


def judgment_table(plan: Plan, values: NDArray[np.float64]) -> pd.DataFrame:
    """Table of judgments from the settings'; see `gather`."""
    index = {name: k for k, name in enumerate(plan.scene_digests)}
    listed = np.array([index[scene.digest] for scene in plan.listed])
    ids = np.array([scene.id for scene in plan.listed], dtype=object)
    digests = np.array(plan.scene_digests, dtype=object)[listed]
    members = [np.flatnonzero((listed >= a.start) & (listed < a.stop)) for a in plan.answers]
    sizes = [len(member) for member in members]
    rows = np.concatenate(members)
    judgments = [
        _mean(values, answer, listed[member])
        for answer, member in zip(plan.answers, members, strict=True)
    ]
    per_answer: dict[str, list[Any]] = {
        "liquid": [a.trial_liquid for a in plan.answers],
        "model": [a.point.name for a in plan.answers],
        "parameters": [json.dumps(a.point.model.parameters()) for a in plan.answers],
        "seed": [a.point.seed for a in plan.answers],
    }
    repeated = {
        name: np.repeat(np.array(column, dtype=None if name == "seed" else object), sizes)
        for name, column in per_answer.items()
    }
    table = pd.DataFrame(
        {"scene": ids[rows], "digest": digests[rows], **repeated}
        | {"judgment": np.concatenate(judgments)}
    )
    parameters = [answer.point.model.parameters() for answer in plan.answers]
    for name in dict.fromkeys(name for values in parameters for name in values):
        title = f"model_{name}" if name in COLUMNS else name
        table[title] = np.repeat(_column([values.get(name) for values in parameters]), sizes)
    named = {*per_answer["liquid"], *(values.get("liquid") for values in parameters)}
    used = [liquid for liquid in plan.grid.own if liquid.name in named]
    if used:
        table.attrs[LIQUIDS] = {liquid.name: liquid.engine_identity for liquid in used}
    for setting in plan.settings[:1]:  # all of a plan have the same engine settings
        table.attrs |= named_engine(setting.engine)
    return table


def _column(values: list[Any]) -> NDArray[Any]:
    """Values as numbers if they are, missing ones as NaN."""
    if any(isinstance(value, str) for value in values):
        return np.array(values, dtype=object)
    if all(isinstance(value, int) for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in values])


def _mean(
    values: NDArray[np.float64], answer: Answer, scenes: NDArray[np.int64]
) -> NDArray[np.float64]:
    # A row a scene, contiguous: NumPy then sums as it does a single list.
    chosen = np.ascontiguousarray(values[list(answer.settings)][:, scenes].T)
    mean: NDArray[np.float64] = chosen.mean(axis=1)
    return mean


def write_judgments(folder: Path, name: str, table: pd.DataFrame) -> Path:
    """Write a grid's table; one that lacks judgments never takes the index of a whole one.

    Parameters
    ----------
    folder
        Where to.
    name
        Name of the grid.
    table
        From `gather`.

    Returns
    -------
    Path
        ``NAME.parquet``, or ``NAME-incomplete.parquet`` if judgments are missing.
    """
    whole, incomplete = folder / f"{name}.parquet", folder / f"{name}-incomplete.parquet"
    if table["judgment"].isna().any():
        write_table(incomplete, table)
        return incomplete
    write_table(whole, table)
    incomplete.unlink(missing_ok=True)
    return whole
