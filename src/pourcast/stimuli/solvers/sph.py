"""The particle engine's own ground truth: at once, but no independent witness."""

import math

import numpy as np

from pourcast.models.base import SimulationModel
from pourcast.models.registry import make_model
from pourcast.pictures.video import FRAME_RATE
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from pourcast.stimuli.poured import Moment, Poured

_TRUTH = {"water": "truth-water", "honey": "truth-honey"}


def pour(scene: Scene, liquid: str, seconds: float) -> Poured:
    """Pour a liquid into a scene.

    Parameters
    ----------
    scene
        The scene.
    liquid
        `water` or `honey`.
    seconds
        Length of the film [s].
    """
    model = make_model(_TRUTH[liquid])
    assert isinstance(model, SimulationModel)
    (job,) = model.pours(scene, resolve_liquid(liquid, scene), 0)
    count = max(1, round(seconds * FRAME_RATE))
    settings = EngineSettings(max_duration=count / FRAME_RATE, frame_rate=FRAME_RATE)
    (end,) = simulate([job], settings=settings, record=True)
    assert end.frames is not None
    volume = math.pi / 4 * scene.liquid.diameter**2 * scene.box.depth / job.n_particles
    last = len(end.frames) - 1
    moments = []
    no_cells = np.zeros((0, 0, 0), dtype=np.uint8)
    for k in range(count):
        place = end.frames[min(k, last)]
        points = np.column_stack([place, np.full(len(place), volume, dtype=np.float32)])
        moments.append(Moment(no_cells, points.astype(np.float32)))
    return Poured(
        moments=tuple(moments),
        cell=job.spacing,
        origin=(0.0, 0.0, 0.0),
        solid=no_cells.astype(bool),
        outcome=end.judgment,
        stranded=end.stranded,
    )
