"""Intuitive Fluids Engine: few SPH particles, strongly damped."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pourcast.models.base import SimulationModel, parameter, zeta_window
from pourcast.scenes.liquids.base import RESERVED, Liquid
from pourcast.scenes.liquids.registry import imagined_liquid, imagined_names
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import MAX_PARTICLES, Pour


@dataclass(frozen=True)
class IntuitiveFluidsEngine(SimulationModel):
    """SPH with few particles and damping; the mean over a window of dampings.

    Bates et al., section "Intuitive Fluids Engine". With zeta = 0, sigma = 0 and
    many particles it is the paper's ground truth.
    """

    same_pours_everywhere = True

    n_particles: int = parameter(
        50, low=1, high=MAX_PARTICLES, doc="number of particles N (paper: 15 to 100)"
    )
    damping_zeta: float = parameter(5.0, unit="1/s", low=0, high=100, doc="damping zeta")
    zeta_sigma: int = parameter(
        4, unit="1/s", low=0, high=20, doc="half-width sigma of the window of dampings"
    )
    liquid: str | Liquid = parameter(
        "trial", choices=imagined_names, doc="liquid in the model's head"
    )
    viscosity_alpha: float | None = parameter(
        None, low=0, high=10, doc="artificial viscosity; none: the liquid's own"
    )

    @classmethod
    def follows_trial(cls, parameters: Mapping[str, Any]) -> bool:
        """Unless another liquid is in the head."""
        return bool(parameters["liquid"] == RESERVED)

    def pours(self, scene: Scene, liquid: Liquid, seed: int = 0) -> list[Pour]:
        """One pour for each damping of the window; the seed is not used."""
        imagined = imagined_liquid(self.liquid, liquid, scene)
        if self.viscosity_alpha is not None:
            imagined = replace(imagined, viscosity_alpha=self.viscosity_alpha)
        window = zeta_window(self.damping_zeta, self.zeta_sigma)
        return [Pour(scene, imagined, self.n_particles, zeta) for zeta in window]


MODEL = IntuitiveFluidsEngine
