"""The particle engine's own ground truth: at once, but no independent witness."""

import math
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from pourcast.models.base import SimulationModel
from pourcast.models.registry import make_model
from pourcast.pictures.video import FRAME_RATE
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from pourcast.stimuli.recording import Moment, RecordedPour
from pourcast.stimuli.solvers.base import Solver


class ParticleEngine(Solver):
    """The particle engine's undamped pour; there is nothing to set."""

    name: ClassVar[str] = "sph"

    def pour(
        self,
        scene: Scene,
        liquid: Liquid,
        seconds: float,
        *,
        threads: int = 1,  # a single pour runs in one
        report: Report = no_report,
    ) -> RecordedPour:
        """Pour a liquid. See `Solver.pour`."""
        truth = true_pour(scene, liquid)
        count = max(1, round(seconds * FRAME_RATE))
        settings = EngineSettings(max_duration=count / FRAME_RATE, frame_rate=FRAME_RATE)
        (end,) = simulate([truth], settings=settings, record=True)
        assert end.frames is not None
        volume = math.pi / 4 * scene.liquid.diameter**2 * scene.box.depth / truth.n_particles
        last = len(end.frames) - 1
        moments = []
        no_cells = np.zeros((0, 0, 0), dtype=np.uint8)
        for k in range(count):
            place = end.frames[min(k, last)]
            points = np.column_stack([place, np.full(len(place), volume, dtype=np.float32)])
            moments.append(Moment(no_cells, points.astype(np.float32)))
        report("pouring", count, count)
        return RecordedPour(
            moments=tuple(moments),
            cell=truth.spacing,
            origin=(0.0, 0.0, 0.0),
            room=no_cells.astype(np.float32),
            outcome=end.judgment,
            stranded=end.stranded,
        )

    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """What the particle engine knows of it. See `Solver.liquid_identity`."""
        return liquid.engine_identity


def true_pour(scene: Scene, liquid: Liquid) -> Pour:
    """The ground truth's pour, of any liquid.

    Stickiness depends on the number of particles: a liquid that sticks has as many as the paper's
    true honey, any other as many as its true water.
    """
    model = make_model("truth-honey" if liquid.sticky else "truth-water")
    assert isinstance(model, SimulationModel)
    (pour,) = model.pours(scene, liquid)
    return replace(pour, liquid=liquid)


SOLVER = ParticleEngine
