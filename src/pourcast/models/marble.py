"""MarbleSim: the IFE's particles as rigid, inelastic spheres."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pourcast.models.base import SimulationModel, parameter, zeta_window
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour

MAX_MARBLES = 300


@dataclass(frozen=True)
class MarbleSim(SimulationModel):
    """Rigid, perfectly inelastic spheres instead of SPH forces; never sticky.

    Bates et al., section "Alternative models".
    """

    same_pours_everywhere = True

    n_particles: int = parameter(
        25, low=1, high=MAX_MARBLES, doc="number of marbles N (paper: 15 to 100)"
    )
    damping_zeta: float = parameter(2.0, unit="1/s", low=0, high=100, doc="damping zeta")
    zeta_sigma: int = parameter(
        4, unit="1/s", low=0, high=20, doc="half-width sigma of the window of dampings"
    )

    @classmethod
    def follows_trial(cls, parameters: Mapping[str, Any]) -> bool:
        """No: marbles are no liquid."""
        return False

    def pours(self, scene: Scene, liquid: Liquid, seed: int = 0) -> list[Pour]:
        """One pour for each damping of the window; liquid and seed are not used."""
        window = zeta_window(self.damping_zeta, self.zeta_sigma)
        return [Pour(scene, WATER, self.n_particles, zeta, kind="marbles") for zeta in window]


MODEL = MarbleSim
