"""What a model predicts of a scene, as far as it can be pictured: a pour, or paths."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.models.base import Model, SimulationModel
from pourcast.models.registry import make_model
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.run import simulate
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
    """Prediction of a model that judges by running pours: its typical one."""

    frames: NDArray[np.float32]
    """Particle positions [m], shape [frame_count, n_particles, 3]."""
    spacing: float
    """Particle spacing [m]."""
    marbles: bool
    """Whether the particles are rigid marbles."""


@dataclass(frozen=True)
class PredictedPaths(Prediction):
    """Prediction of any other model: paths that the liquid takes, if it tells them."""

    paths: tuple[NDArray[np.float64], ...]
    """Corners [m] of each, shape [corner_count, 2]."""


def make_prediction(
    scene: Scene, spec: str, liquid: Liquid, seed: int = 0, own: Sequence[Liquid] = ()
) -> PredictedPour | PredictedPaths:
    """Judge a scene with a model, and record its typical pour or its paths.

    Parameters
    ----------
    scene
        The scene.
    spec
        Model spec, as for `make_model`.
    liquid
        Liquid that is shown in the trial.
    seed
        Source of randomness.
    own
        The study's own liquids, which the spec can name.
    """
    model = make_model(spec, own)
    if isinstance(model, SimulationModel):
        return predict_pour(scene, spec, model, liquid, seed)
    judgment = float(model.judge([scene], liquid, seed)[0])
    return PredictedPaths(spec, judgment, liquid.rgb, _paths(model, scene, seed))


def predict_pour(
    scene: Scene,
    name: str,
    model: SimulationModel,
    liquid: Liquid,
    seed: int = 0,
    *,
    settings: EngineSettings | None = None,
) -> PredictedPour:
    """Judge a scene with a model that runs pours, and record its typical one.

    Parameters
    ----------
    scene
        The scene.
    name
        What the model is called.
    model
        The model.
    liquid
        Liquid that is shown in the trial.
    seed
        Source of randomness.
    settings
        How pours are computed; shorter ones for a look at the start.
    """
    pours = model.pours(scene, liquid, seed)
    outcomes = simulate(pours, settings=settings, record=True)
    typical, outcome = pours[len(pours) // 2], outcomes[len(pours) // 2]
    assert outcome.frames is not None
    marbles = typical.kind == "marbles"
    return PredictedPour(
        name=name,
        judgment=float(np.mean([each.judgment for each in outcomes])),
        colour=_MARBLE if marbles else typical.liquid.rgb,
        frames=outcome.frames,
        spacing=typical.spacing,
        marbles=marbles,
    )


def _paths(model: Model, scene: Scene, seed: int) -> tuple[NDArray[np.float64], ...]:
    """Paths of a model that can tell them (SimpleSim), none of any other."""
    tell = getattr(model, "paths", None)
    return tuple(tell(scene, seed)) if callable(tell) else ()
