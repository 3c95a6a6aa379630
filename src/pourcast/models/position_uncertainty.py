"""PositionUncertainty: true physics from a noisy start."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from pourcast.models.base import SimulationModel, parameter
from pourcast.scenes.liquids.base import RESERVED, Liquid
from pourcast.scenes.liquids.registry import imagined_liquid, imagined_names
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import MAX_PARTICLES, Pour

_TRIES = 1000


@dataclass(frozen=True)
class PositionUncertainty(SimulationModel):
    """Undamped SPH whose start is displaced at random, averaged over draws.

    The authors' earlier model: Bates, Yildirim, Tenenbaum & Battaglia (2015),
    "Humans predict liquid dynamics using probabilistic simulation", CogSci.
    """

    n_particles: int = parameter(50, low=1, high=MAX_PARTICLES, doc="number of particles N")
    position_sd: float = parameter(
        0.05, unit="m", low=0, high=0.5, doc="SD of the start's displacement in x and in y"
    )
    n_draws: int = parameter(16, low=1, high=1000, doc="displacements a scene")
    damping_zeta: float = parameter(0.0, unit="1/s", low=0, high=100, doc="damping zeta")
    liquid: str | Liquid = parameter(
        "trial", choices=imagined_names, doc="liquid in the model's head"
    )

    @classmethod
    def follows_trial(cls, parameters: Mapping[str, Any]) -> bool:
        """Unless another liquid is in the head."""
        return bool(parameters["liquid"] == RESERVED)

    def pours(self, scene: Scene, liquid: Liquid, seed: int = 0) -> list[Pour]:
        """One pour for each displacement; they depend on the seed and on the scene alone."""
        rng = np.random.default_rng([seed, int(scene.digest, 16)])
        imagined = imagined_liquid(self.liquid, liquid, scene)
        return [
            Pour(scene, imagined, self.n_particles, self.damping_zeta, offset)
            for offset in self._offsets(scene, rng)
        ]

    def _offsets(self, scene: Scene, rng: np.random.Generator) -> list[tuple[float, float]]:
        """Displacements that leave the liquid inside the box and clear of all solids."""
        radius = scene.liquid.diameter / 2
        free = shapely.box(0.0, 0.0, scene.box.width, scene.box.height).buffer(-radius)
        solids = shapely.union_all([shapely.Polygon(p) for p in scene.solids]).buffer(radius)
        allowed = free.difference(solids)
        x, y = scene.liquid.centre
        offsets: list[tuple[float, float]] = []
        for dx, dy in rng.normal(0.0, self.position_sd, (_TRIES * self.n_draws, 2)):
            if len(offsets) == self.n_draws:
                break
            if allowed.contains(shapely.Point(x + dx, y + dy)):
                offsets.append((float(dx), float(dy)))
        return offsets or [(0.0, 0.0)]


MODEL = PositionUncertainty
