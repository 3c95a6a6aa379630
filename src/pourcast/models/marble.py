"""MarbleSim: the IFE's particles as rigid, inelastic spheres."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.liquid import WATER, Liquid
from pourcast.model import Model, mean_judgments, parameter, zeta_window
from pourcast.scene import Scene
from pourcast.simulate import Pour, Progress

MAX_MARBLES = 300


@dataclass(frozen=True)
class MarbleSim(Model):
    """Rigid, perfectly inelastic spheres instead of SPH forces; never sticky.

    Bates et al., section "Alternative models".
    """

    n_particles: int = parameter(
        25, low=1, high=MAX_MARBLES, doc="number of marbles N (paper: 15 to 100)"
    )
    damping_zeta: float = parameter(2.0, unit="1/s", low=0, high=100, doc="damping zeta")
    zeta_sigma: int = parameter(
        4, unit="1/s", low=0, high=20, doc="half-width sigma of the window of dampings"
    )

    def judge(
        self,
        scenes: Sequence[Scene],
        liquid: Liquid,
        seed: int = 0,
        *,
        progress: Progress | None = None,
    ) -> NDArray[np.float64]:
        """Judge scenes; deterministic, liquid and seed are not used. See `Model.judge`."""

        def pours(scene: Scene) -> list[Pour]:
            window = zeta_window(self.damping_zeta, self.zeta_sigma)
            return [
                Pour(scene, WATER, self.n_particles, zeta, kind="marbles") for zeta in window
            ]

        return mean_judgments(scenes, pours, progress)


MODEL = MarbleSim
