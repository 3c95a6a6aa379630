"""Judgments of models on scenes, as a tidy table."""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.models.base import (
    Model,
    SimulationModel,
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
from pourcast.simulation.settings import EngineSettings
from pourcast.statistics.correlation import pearson

if TYPE_CHECKING:
    import pandas as pd


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
    settings: EngineSettings | None = None,
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
    settings
        How pours are computed.
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
                groups[number] = [_poured(model, scene, liquid, seed) for scene in scenes]
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
                settings=settings,
                remember=True,
                progress=partial(report, words),
            )
        said = iter(means)
        for number in groups:
            spec, _, scenes, _ = requests[number]
            judged[number] = checked_judgments([next(said) for _ in scenes], spec, scenes)
    return [judged[number] for number in range(len(requests))]


def _poured(model: SimulationModel, scene: Scene, liquid: Liquid, seed: int) -> list[Pour]:
    """A model's pours of a scene, looked at before they are run with those of others."""
    pours = list(model.pours(scene, liquid, seed))
    if not pours or not all(isinstance(pour, Pour) for pour in pours):
        raise TypeError(f"scene {scene.id!r}: expected one or more pours, found {pours}")
    return pours


class ModelJudgment(NamedTuple):
    """A model's judgment of a scene: a row of the table that `predict` makes."""

    scene: str
    digest: str
    liquid: str
    model: str
    parameters: str
    """JSON."""
    seed: int
    judgment: float


def judge_scenes(
    scenes: Sequence[Scene],
    models: Sequence[str],
    liquid: str = "water",
    seed: int = 0,
    *,
    own: Sequence[Liquid] = (),
    record: Collection[str] = (),
    report: Report = no_report,
) -> list[ModelJudgment]:
    """Let models judge scenes.

    Parameters
    ----------
    scenes, models, liquid, seed, own, record, report
        See `predict`, which makes a table of the same.

    Returns
    -------
    list of ModelJudgment
        All of the first model, in the order of the scenes; then those of the next.

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
    said = []
    for spec, model in built.items():
        judgments, parameters = np.empty(len(scenes)), json.dumps(model.parameters())
        for kind in by_goal:
            judgments[members[kind]] = next(judged)
        said += [
            ModelJudgment(
                scene=scene.id,
                digest=scene.digest,
                liquid=by_goal[scene.goal.kind].name,
                model=spec,
                parameters=parameters,
                seed=seed,
                judgment=judgment,
            )
            for scene, judgment in zip(scenes, judgments.tolist(), strict=True)
        ]
    return said


def table_of(judgments: Sequence[ModelJudgment]) -> "pd.DataFrame":
    """Judgments as a table, one row each."""
    import pandas as pd  # noqa: PLC0415 - what is only printed needs no table

    return pd.DataFrame(judgments, columns=list(ModelJudgment._fields))


def predict(
    scenes: Sequence[Scene],
    models: Sequence[str],
    liquid: str = "water",
    seed: int = 0,
    *,
    own: Sequence[Liquid] = (),
    record: Collection[str] = (),
    report: Report = no_report,
) -> "pd.DataFrame":
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
    return table_of(
        judge_scenes(scenes, models, liquid, seed, own=own, record=record, report=report)
    )


def summarise(table: "pd.DataFrame", references: Sequence[str] = ()) -> "pd.DataFrame":
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
    import pandas as pd  # noqa: PLC0415

    wide = table.pivot(index="scene", columns="model", values="judgment")
    judgments = {name: wide[name].tolist() for name in dict.fromkeys(table["model"])}
    return pd.DataFrame(summary_columns(judgments, references)).set_index("model")


def by_model(judgments: Sequence[ModelJudgment]) -> dict[str, list[float]]:
    """Model -> its judgments, in the order of the scenes."""
    found: dict[str, list[float]] = {}
    for one in judgments:
        found.setdefault(one.model, []).append(one.judgment)
    return found


def summary_columns(
    judgments: Mapping[str, Sequence[float]], references: Sequence[str] = ()
) -> dict[str, list[Any]]:
    """The columns of `summarise` by their names, that of the models first.

    Parameters
    ----------
    judgments
        Model -> its judgments of the same scenes; NaN where there is none.
    references
        As for `summarise`.

    Examples
    --------
    >>> columns = summary_columns({"a": [0.0, 0.5, 1.0], "b": [0.5, 0.5, 0.5]})
    >>> columns["mean"], columns["r with a"]
    ([0.5, 0.5], [1.0, nan])
    """
    values = {name: np.array(said) for name, said in judgments.items()}
    truths = [name for name in values if name.startswith("truth")]
    columns: dict[str, list[Any]] = {
        "model": list(values),
        "mean": [float(np.nanmean(said)) for said in values.values()],
        "sd": [float(np.nanstd(said)) for said in values.values()],
    }
    for reference in references or truths or list(values)[:1]:
        columns[f"r with {reference}"] = [
            _correlation(said, values[reference]) if reference in values else math.nan
            for said in values.values()
        ]
    return columns


def _correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    both = np.isfinite(x) & np.isfinite(y)
    return float(pearson(x[both], y[None, both])[0]) if both.sum() >= 3 else math.nan
