"""The experiment: rows of square pegs; everybody sees water and oil."""

from dataclasses import dataclass

import numpy as np

from pourcast import Experiment, LiquidStart, Scene
from pourcast.scenes.geometry import Polygon
from pourcast.study.selection import CoarseFilter, FilteredScenes
from pourcast_pegs.middle_bin import MiddleBin


@dataclass(frozen=True)
class Pegs:
    """Rows of square pegs that stand on a corner, each shifted sideways at random.

    Parameters
    ----------
    row_count, peg_count
        Rows, and pegs in a row.
    half_width
        From a peg's centre to its corners [m].
    """

    row_count: int = 3
    peg_count: int = 3
    half_width: float = 0.06
    name: str = "pegs"

    def draw(self, rng: np.random.Generator, scene_id: str) -> Scene | None:
        """Draw a scene."""
        pegs = []
        for y in np.linspace(0.55, 1.1, self.row_count):
            across = (np.arange(self.peg_count) + rng.uniform(0.2, 0.8)) / self.peg_count
            pegs += [self._peg(float(x), float(y)) for x in across]
        liquid = LiquidStart(centre=(round(float(rng.uniform(0.3, 0.7)), 6), 1.38))
        return Scene(id=scene_id, obstacles=tuple(pegs), liquid=liquid, goal=MiddleBin())

    def _peg(self, x: float, y: float) -> Polygon:
        r = self.half_width
        x, y = round(min(max(x, r), 1.0 - r), 6), round(y, 6)
        return ((x - r, y), (x, y - r), (x + r, y), (x, y + r))


EXPERIMENT = Experiment(
    name="pegs",
    title="three bins below rows of pegs; everybody sees water and oil",
    family=Pegs(),
    choice=FilteredScenes(CoarseFilter(min_touched=0.5, max_stranded=0.5)),
    goal="middle-bin",
    scene_count=30,
    practice_count=6,
    participants=20,
    groups=(("water", "oil"),),
    practice_filter=CoarseFilter(min_touched=0.5, max_stranded=0.5),
    observers={"oil": "honey-ife-2"},
    models=("water-ife", "gravity", "ife:n_particles=200,damping_zeta=0,zeta_sigma=0"),
    words={
        "page": {"title": "Pegs"},
        "liquids": {"oil": {"description": "The olive-green liquid is oil, thicker than water."}},
    },
)
