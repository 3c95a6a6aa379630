"""A scene as cells: what is solid, across which direction, and where the liquid starts."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from pourcast.scene import Scene
from pourcast.stimuli.lattice_boltzmann.solver import wall_normals

Array = NDArray[np.float64]

_SUBCELLS = 16
"""Points along each side of a cell by which partly filled ones are measured."""


@dataclass(frozen=True)
class Voxels:
    """A scene on a grid that is centred in the box, so that mirrored scenes have mirrored grids.

    Parameters
    ----------
    cell
        Width of a cell [m], in the scene's measure.
    origin
        Corner of the first cell [m], shape [3].
    solid
        Which cells are solid, shape [nx, ny, nz].
    normal
        Directions across the surface of solid cells and of the margin, shape
        [3, nx + 2, ny + 2, nz + 2].
    fill
        Share of each cell that liquid fills at the start, shape [nx, ny, nz].
    goal
        Share of each cell that counts towards the judgment, shape [nx, ny].
    """

    cell: float
    origin: tuple[float, float, float]
    solid: NDArray[np.bool_]
    normal: NDArray[np.float32]
    fill: NDArray[np.float64]
    goal: NDArray[np.float64]


def voxelise(scene: Scene, resolution: int) -> Voxels:
    """Put a scene on a grid.

    Parameters
    ----------
    scene
        The scene.
    resolution
        Cells along the longest side of the box.
    """
    box = scene.box
    sides = (box.width, box.height, box.depth)
    cell = max(sides) / resolution
    counts = tuple(max(3, round(side / cell)) for side in sides)
    # The floor is where it is; left and right, front and back are alike.
    origin = (
        (box.width - counts[0] * cell) / 2,
        0.0,
        (box.depth - counts[2] * cell) / 2,
    )
    centres = [origin[axis] + (np.arange(counts[axis]) + 0.5) * cell for axis in range(2)]
    x, y = np.meshgrid(*centres, indexing="ij")
    solid = np.zeros(x.shape, dtype=bool)
    for polygon in scene.solids:
        solid |= shapely.contains_xy(shapely.Polygon(polygon), x, y)
    depth = counts[2]
    blob = shapely.Point(scene.liquid.centre).buffer(scene.liquid.diameter / 2, quad_segs=64)
    fill = _share(lambda px, py: shapely.contains_xy(blob, px, py), x, y, cell)
    holds = np.vectorize(scene.goal.holds)
    return Voxels(
        cell=cell,
        origin=origin,
        solid=_through(solid, depth),
        normal=_normals(scene, solid, x, y, depth),
        fill=_through(np.where(solid, 0.0, fill), depth),
        goal=_share(holds, x, y, cell),
    )


def _through(plane: NDArray[Any], depth: int) -> NDArray[Any]:
    """The same plane of cells all through the depth."""
    return np.repeat(plane[:, :, None], depth, axis=2)


def _share(inside: Callable[..., Any], x: Array, y: Array, cell: float) -> Array:
    """Share of each cell for which `inside` holds, by points spread evenly over it."""
    steps = ((np.arange(_SUBCELLS) + 0.5) / _SUBCELLS - 0.5) * cell
    total = np.zeros(x.shape)
    for dx in steps:
        for dy in steps:
            total += inside(x + dx, y + dy)
    return total / _SUBCELLS**2


def _normals(
    scene: Scene, solid: NDArray[np.bool_], x: Array, y: Array, depth: int
) -> NDArray[np.float32]:
    """Across the surface of each solid cell: towards the nearest point of its polygon's edges."""
    normal = wall_normals((*solid.shape, depth))
    for polygon in scene.solids:
        corners = np.array(polygon)
        shape = shapely.Polygon(polygon)
        inside = np.argwhere(solid & shapely.contains_xy(shape, x, y))
        edges = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(*edges.T)
        outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths[:, None]
        points = np.stack([x[tuple(inside.T)], y[tuple(inside.T)]], axis=1)
        depths = np.einsum("ek,pek->pe", outward, corners[None] - points[:, None])
        nearest = outward[np.argmin(depths, axis=1)]
        for (i, j), direction in zip(inside, nearest, strict=True):
            normal[:2, i + 1, j + 1, 1:-1] = direction[:, None]
            normal[2, i + 1, j + 1, 1:-1] = 0.0
    return normal
