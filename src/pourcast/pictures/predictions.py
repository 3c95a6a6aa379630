"""What a model predicts of a scene, as far as it can be pictured: a pour, a film, or paths."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pourcast.models.base import Model, SimulationModel, typical_pour
from pourcast.models.registry import make_model
from pourcast.prediction import JudgmentRequest, judge_together
from pourcast.progress import Progress, Report, no_progress, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.memory import REMEMBERED, outcomes_of
from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings

_MARBLE = (0.45, 0.30, 0.62)


@dataclass(frozen=True)
class Prediction:
    """A model's judgment of a scene, and what it is called and drawn in."""

    name: str
    judgment: float
    """Share of the liquid that the goal will hold, 0..1."""
    colour: tuple[float, float, float]
    """Red, green, blue, 0..1 each."""


@dataclass(frozen=True)
class PredictedPour(Prediction):
    """Prediction of a model that lets particles move: its typical pour, or its film."""

    frames: NDArray[np.float32]
    """Particle positions [m], shape [frame_count, n_particles, 3]; a film's can lack z."""
    spacing: float
    """Particle spacing [m]: a marble's diameter, the side of a grid's cell."""
    look: Literal["liquid", "marbles", "cells"] = "liquid"
    """As what the particles are drawn. Cells of a grid are no pour: their frames have no time."""


@dataclass(frozen=True)
class PredictedPaths(Prediction):
    """Prediction of any other model: paths that the liquid takes, if it tells them."""

    paths: tuple[NDArray[np.float64], ...]
    """Corners [m] of each, shape [corner_count, 2]."""


def make_predictions(
    scene: Scene,
    specs: Sequence[str],
    liquid: Liquid,
    seed: int = 0,
    own: Sequence[Liquid] = (),
    *,
    report: Report = no_report,
) -> list[PredictedPour | PredictedPaths]:
    """Judge a scene with models, and record their typical pours, their films or their paths.

    Parameters
    ----------
    scene
        The scene.
    specs
        Model specs, as for `make_model`.
    liquid
        Liquid that is shown in the trial.
    seed
        Source of randomness.
    own
        The study's own liquids, which the specs can name.
    report
        Told of the progress.
    """
    models = [make_model(spec, own) for spec in specs]
    requests = [
        JudgmentRequest(spec, model, [scene], liquid)
        for spec, model in zip(specs, models, strict=True)
    ]
    judged = judge_together(requests, seed, record=specs, report=report)
    typical = {
        spec: typical_pour(list(model.pours(scene, liquid, seed)))
        for spec, model in zip(specs, models, strict=True)
        if isinstance(model, SimulationModel)
    }
    poured = predict_pours(typical, progress=partial(report, "recording"))
    return [
        replace(poured[spec], judgment=float(judgments[0]))
        if spec in poured
        else _told_by(model, Prediction(spec, float(judgments[0]), liquid.rgb), scene, seed)
        for spec, model, judgments in zip(specs, models, judged, strict=True)
    ]


def predict_pours(
    pours: Mapping[str, Pour],
    *,
    settings: EngineSettings | None = None,
    progress: Progress = no_progress,
) -> dict[str, PredictedPour]:
    """Record pours, each as a prediction of its own.

    Parameters
    ----------
    pours
        What each is called -> the pour.
    settings
        How pours are computed; shorter ones for a look at the start.
    progress
        Called with the pours that were run, and how many are.
    """
    ends = outcomes_of(
        list(pours.values()),
        attrgetter("judgment", "frames"),
        settings=settings,
        record=range(len(pours)),
        memory=REMEMBERED,
        progress=progress,
    )
    predictions = {}
    for (name, pour), (judgment, frames) in zip(pours.items(), ends, strict=True):
        colour = _MARBLE if pour.kind == "marbles" else pour.liquid.rgb
        predictions[name] = PredictedPour(name, judgment, colour, frames, pour.spacing, pour.kind)
    return predictions


def _told_by(
    model: Model, prediction: Prediction, scene: Scene, seed: int
) -> PredictedPour | PredictedPaths:
    """The prediction of a model without pours, with its film (Blobs) or its paths (SimpleSim)."""
    film, paths = (getattr(model, name, None) for name in ("film", "paths"))
    if callable(film):
        positions, size = film(scene, seed)
        frames = np.asarray(positions, np.float32)
        return PredictedPour(**vars(prediction), frames=frames, spacing=size, look="cells")
    told = tuple(paths(scene, seed)) if callable(paths) else ()
    return PredictedPaths(**vars(prediction), paths=told)
