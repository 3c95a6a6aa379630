"""What a model predicts of a scene, as far as it can be pictured: a pour, a film, or paths."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Literal, TypeVar

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

K = TypeVar("K", bound=Hashable)

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
    (predictions,) = predictions_of_all([scene], specs, [liquid], seed, own, report=report)
    return predictions


def predictions_of_all(
    scenes: Sequence[Scene],
    specs: Sequence[str],
    liquids: Sequence[Liquid],
    seed: int = 0,
    own: Sequence[Liquid] = (),
    *,
    report: Report = no_report,
) -> list[list[PredictedPour | PredictedPaths]]:
    """The same for many scenes, all pours of which run in one queue.

    Parameters
    ----------
    scenes
        The scenes.
    specs, seed, own, report
        See `make_predictions`.
    liquids
        For each scene the liquid that is shown in its trial.

    Returns
    -------
    list of list of Prediction
        For each scene those of all models.
    """
    models = {spec: make_model(spec, own) for spec in specs}
    asked = [
        (spec, scene, liquid)
        for scene, liquid in zip(scenes, liquids, strict=True)
        for spec in specs
    ]
    requests = [
        JudgmentRequest(spec, models[spec], [scene], liquid) for spec, scene, liquid in asked
    ]
    judged = judge_together(requests, seed, record=specs, report=report)
    typical = {
        number: typical_pour(list(model.pours(scene, liquid, seed)))
        for number, (spec, scene, liquid) in enumerate(asked)
        if isinstance(model := models[spec], SimulationModel)
    }
    poured = predict_pours(typical, progress=partial(report, "recording"))
    told: list[PredictedPour | PredictedPaths] = []
    for number, ((spec, scene, liquid), (judgment,)) in enumerate(zip(asked, judged, strict=True)):
        said = Prediction(spec, float(judgment), liquid.rgb)
        if number in poured:
            told.append(replace(poured[number], name=spec, judgment=said.judgment))
        else:
            told.append(_told_by(models[spec], said, scene, seed))
    count = len(specs)
    return [told[number * count : (number + 1) * count] for number in range(len(scenes))]


def predict_pours(
    pours: Mapping[K, Pour],
    *,
    settings: EngineSettings | None = None,
    progress: Progress = no_progress,
) -> dict[K, PredictedPour]:
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
        predictions[name] = PredictedPour(
            str(name), judgment, colour, frames, pour.spacing, pour.kind
        )
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
