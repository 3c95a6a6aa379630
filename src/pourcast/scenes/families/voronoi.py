"""Experiment 1: obstacles from a Voronoi tessellation, two basins below.

Bates et al., section "Stimuli": a 2-D Voronoi tessellation, of which a random
subset of cells with a total area of about 0.12 m^2 is made solid. What the
paper leaves open is inferred (`docs/explanation/open-choices.md`).
"""

from dataclasses import dataclass

import numpy as np
import shapely

from pourcast.scenes.geometry import Polygon
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.polygons import DECIMALS, ring_of
from pourcast.scenes.scene import Box, LiquidStart, Scene


@dataclass(frozen=True)
class VoronoiFamily:
    """Statistics of Experiment 1's scenes.

    Parameters
    ----------
    cell_count
        Cells of the tessellation of the whole box.
    band_bottom, band_top
        Only cells that lie wholly between these heights may be solid [m].
    solid_area
        Total area of the solid cells [m^2] (paper: about 0.12).
    wall_gap
        Least distance of a solid cell from the side walls [m]; with 0, cells at
        the walls may be solid too.
    liquid_y
        Height of the liquid's centre [m].
    liquid_spread
        The liquid's centre is drawn uniformly within this distance of the middle [m].
    """

    cell_count: int = 190
    band_bottom: float = 0.43
    band_top: float = 1.25
    solid_area: float = 0.12
    wall_gap: float = 0.0012
    liquid_y: float = 1.4
    liquid_spread: float = 0.034
    name: str = "exp1"

    def draw(self, rng: np.random.Generator, scene_id: str) -> Scene | None:
        """Draw a scene.

        Parameters
        ----------
        rng
            Source of randomness.
        scene_id
            Its name.

        Returns
        -------
        Scene or None
            None if the draw didn't come near the wanted area.
        """
        box = Box()
        cells = bounded_voronoi(rng, self.cell_count, box.width, box.height)
        order = rng.permutation(len(cells))
        liquid_x = box.width / 2 + rng.uniform(-self.liquid_spread, self.liquid_spread)
        solid: list[Polygon] = []
        area = 0.0
        for index in order:
            cell_area = shapely.Polygon(cells[index]).area
            if self._allows(cells[index], box.width) and area + cell_area <= 1.05 * self.solid_area:
                solid.append(cells[index])
                area += cell_area
        if area < 0.95 * self.solid_area:
            return None
        return Scene(
            id=scene_id,
            box=box,
            obstacles=tuple(solid),
            liquid=LiquidStart(centre=(round(liquid_x, DECIMALS), self.liquid_y)),
            goal=Basins(),
        )

    def _allows(self, cell: Polygon, width: float) -> bool:
        x, y = np.array(cell).T
        in_band = y.min() >= self.band_bottom and y.max() <= self.band_top
        return bool(in_band and x.min() >= self.wall_gap and x.max() <= width - self.wall_gap)


def bounded_voronoi(
    rng: np.random.Generator, count: int, width: float, height: float
) -> list[Polygon]:
    """Voronoi cells of uniform random points in a rectangle, cut at its border.

    Parameters
    ----------
    rng
        Source of randomness.
    count
        Number of cells.
    width, height
        Size of the rectangle [m].

    Returns
    -------
    list of Polygon
        The cells, counter-clockwise, coordinates rounded to 1e-6 m.
    """
    from scipy.spatial import Voronoi  # noqa: PLC0415 - slow to import

    size = np.array([width, height])
    seeds = rng.uniform((0.0, 0.0), size, (count, 2))
    # Mirror images of the seeds make the border an edge of the tessellation.
    mirrored = [seeds]
    for axis in range(2):
        for border in (0.0, size[axis]):
            image = seeds.copy()
            image[:, axis] = 2 * border - image[:, axis]
            mirrored.append(image)
    diagram = Voronoi(np.concatenate(mirrored))
    regions = (diagram.regions[diagram.point_region[index]] for index in range(count))
    corners = (np.clip(diagram.vertices[region], 0.0, size) for region in regions)
    return [ring_of(shapely.MultiPoint(points)) for points in corners]
