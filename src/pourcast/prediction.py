"""Judgments of models on scenes, as a tidy table."""

import json
from collections.abc import Collection, Sequence

import numpy as np
import pandas as pd

from pourcast.models.base import JudgmentRequest, judge_together
from pourcast.models.registry import make_model
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene


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
