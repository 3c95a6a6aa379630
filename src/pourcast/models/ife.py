"""Intuitive Fluids Engine: few SPH particles, strongly damped."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pourcast.liquid import Liquid
from pourcast.model import (
    IMAGINED_LIQUIDS,
    Model,
    imagined_liquid,
    mean_judgments,
    parameter,
    zeta_window,
)
from pourcast.scene import Scene
from pourcast.simulate import MAX_PARTICLES, Pour, Progress


@dataclass(frozen=True)
class IntuitiveFluidsEngine(Model):
    """SPH with few particles and damping; the mean over a window of dampings.

    Bates et al., section "Intuitive Fluids Engine". With zeta = 0, sigma = 0 and
    many particles it is the paper's ground truth.
    """

    n_particles: int = parameter(
        50, low=1, high=MAX_PARTICLES, doc="number of particles N (paper: 15 to 100)"
    )
    damping_zeta: float = parameter(5.0, unit="1/s", low=0, high=100, doc="damping zeta")
    zeta_sigma: int = parameter(
        4, unit="1/s", low=0, high=20, doc="half-width sigma of the window of dampings"
    )
    liquid: str = parameter("trial", choices=IMAGINED_LIQUIDS, doc="liquid in the model's head")
    viscosity_alpha: float | None = parameter(
        None, low=0, high=10, doc="artificial viscosity; none: the liquid's own"
    )

    def judge(
        self,
        scenes: Sequence[Scene],
        liquid: Liquid,
        seed: int = 0,
        *,
        progress: Progress | None = None,
    ) -> NDArray[np.float64]:
        """Judge scenes; deterministic, the seed is not used. See `Model.judge`."""

        def pours(scene: Scene) -> list[Pour]:
            imagined = imagined_liquid(self.liquid, liquid, scene)
            if self.viscosity_alpha is not None:
                imagined = replace(imagined, viscosity_alpha=self.viscosity_alpha)
            window = zeta_window(self.damping_zeta, self.zeta_sigma)
            return [Pour(scene, imagined, self.n_particles, zeta) for zeta in window]

        return mean_judgments(scenes, pours, progress)


MODEL = IntuitiveFluidsEngine
