"""Judgments of models on scenes, as a tidy table."""

import json
from collections.abc import Collection, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.models.base import (
    Model,
    averages_pours,
    checked_judgments,
    failing_as,
    judge_checked,
    means_over_pours,
)
from pourcast.models.registry import make_model
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour


class JudgmentRequest(NamedTuple):
    """What a model is asked."""

    spec: str
    """What the model is called."""
    model: Model
    scenes: Sequence[Scene]
    liquid: Liquid
    """Liquid shown in the trials."""


def judge_together(
    requests: Sequence[JudgmentRequest],
    seed: int,
    *,
    record: Collection[str] = (),
    report: Report = no_report,
) -> list[NDArray[np.float64]]:
    """Let models judge, and run the pours of all of them together, each different one once.

    What was poured in this process lately is not poured again. Models that judge in a way of
    their own are asked one after another.

    Parameters
    ----------
    requests
        What is asked.
    seed
        Source of all randomness.
    record
        Specs of models whose typical pours are recorded, to be pictured afterwards.
    report
        Told of the progress.

    Returns
    -------
    list of ndarray
        For each request its judgments, shape [scene_count], each 0..1.

    Raises
    ------
    ModelError
        If a model fails, or says anything else.
    SimulationDivergedError
        If a pour breaks: the message names scene, liquid and settings.
    """
    groups: dict[int, list[Sequence[Pour]]] = {}
    for number, (spec, model, scenes, liquid) in enumerate(requests):
        if averages_pours(model):
            with failing_as(spec):
                groups[number] = [model.pours(scene, liquid, seed) for scene in scenes]
    judged = {
        number: judge_checked(model, spec, scenes, liquid, seed, partial(report, spec))
        for number, (spec, model, scenes, liquid) in enumerate(requests)
        if number not in groups
    }
    if groups:
        names = list(dict.fromkeys(requests[number].spec for number in groups))
        words = names[0] if len(names) == 1 else f"{len(names)} models"
        pictured = [requests[number].spec in record for number in groups for _ in groups[number]]
        with failing_as(", ".join(names)):
            means = means_over_pours(
                [group for number in groups for group in groups[number]],
                pictured,
                remember=True,
                progress=partial(report, words),
            )
        said = iter(means)
        for number in groups:
            spec, _, scenes, _ = requests[number]
            judged[number] = checked_judgments([next(said) for _ in scenes], spec, scenes)
    return [judged[number] for number in range(len(requests))]


def predict(
    scenes: Sequence[Scene],
    models: Sequence[str],
    liquid: str = "water",
    seed: int = 0,
    *,
    own: Sequence[Liquid] = (),
    record: Collection[str] = (),
    report: Report = no_report,
) -> pd.DataFrame:
    """Let models judge scenes.

    Pours of all models are run together, each different one once; what was poured in this process
    lately is not poured again.

    Parameters
    ----------
    scenes
        The scenes.
    models
        Model specs such as ``water-ife`` or ``ife:n_particles=75``.
    liquid
        Liquid that is shown in the trials. Most presets fix the liquid in the
        model's head, and judge any trial with that.
    seed
        Source of all randomness.
    own
        A study's own liquids, which `liquid` and the models' parameters can name.
    record
        Models whose typical pours are recorded, so that `show` need not run them again.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        One row per scene and model: `scene`, `digest`, `liquid`, `model`,
        `parameters` (JSON), `seed`, `judgment`.

    Raises
    ------
    InputError
        If a model or the liquid is wrong; nothing has been simulated then.
    """
    built = {spec: make_model(spec, own) for spec in dict.fromkeys(models)}
    by_goal = {scene.goal.kind: resolve_liquid(liquid, scene, own) for scene in scenes}
    members = {
        kind: [k for k, scene in enumerate(scenes) if scene.goal.kind == kind] for kind in by_goal
    }
    requests = [
        JudgmentRequest(spec, model, [scenes[k] for k in members[kind]], trial_liquid)
        for spec, model in built.items()
        for kind, trial_liquid in by_goal.items()
    ]
    judged = iter(judge_together(requests, seed, record=record, report=report))
    tables = []
    for spec, model in built.items():
        judgments = np.empty(len(scenes))
        for kind in by_goal:
            judgments[members[kind]] = next(judged)
        tables.append(
            pd.DataFrame(
                {
                    "scene": [scene.id for scene in scenes],
                    "digest": [scene.digest for scene in scenes],
                    "liquid": [by_goal[scene.goal.kind].name for scene in scenes],
                    "model": spec,
                    "parameters": json.dumps(model.parameters()),
                    "seed": seed,
                    "judgment": judgments,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)


def summarise(table: pd.DataFrame, references: Sequence[str] = ()) -> pd.DataFrame:
    """One row per model: mean, spread, and correlations with reference models.

    Parameters
    ----------
    table
        Judgments, from `predict`.
    references
        Models to correlate with; by default all whose names begin with
        ``truth``, else the first of the table.

    Returns
    -------
    DataFrame
        Indexed by model: `mean`, `sd`, and for each reference a column
        ``r with <reference>`` (Pearson, over the scenes; not a number with fewer
        than 3 scenes or without spread).
    """
    wide = table.pivot(index="scene", columns="model", values="judgment")
    wide = wide[list(dict.fromkeys(table["model"]))]
    names = [str(name) for name in wide.columns]
    truths = [name for name in names if name.startswith("truth")]
    summary = pd.DataFrame({"mean": wide.mean(), "sd": wide.std(ddof=0)})
    spread = wide.loc[:, summary["sd"] > 1e-12]
    for reference in references or truths or names[:1]:
        enough = len(wide) >= 3 and reference in spread.columns
        correlation = spread.corrwith(spread[reference]) if enough else pd.Series(dtype=float)
        summary[f"r with {reference}"] = correlation.reindex(summary.index)
    return summary
