"""Solids: distances from convex polygons, and the broad phase.

A polygon stands for a prism through the whole depth of the box, so that
distances are a problem in the x-y plane.

The closest point is taken on the edges, with the sign from the inside test. A
largest-half-plane-distance test would treat a sharp corner as a long mitre.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import allocating_kernel, kernel

CELLS_X, CELLS_Y = 50, 75


class BroadPhase(NamedTuple):
    """Broad phase: the polygons near each cell of a grid over each scene."""

    inverse_size: NDArray[np.float64]
    """Cells per metre along x and y, shape [scene_count, 2]."""
    start: NDArray[np.int64]
    """Offsets into `polygons`, shape [scene_count * CELLS_X * CELLS_Y + 1]."""
    polygons: NDArray[np.int64]
    clearance: NDArray[np.float64]
    """Lower bound of the distance [m] from any point of a cell to the nearest polygon."""


@kernel
def edge_gap(x: float, y: float, edge: int, solids: Any) -> Any:
    """Where a point is, as seen from an edge.

    Parameters
    ----------
    x, y
        The point [m].
    edge
        Index of the edge's first vertex.
    solids
        The polygons.

    Returns
    -------
    squared_distance, height
        Squared distance from the edge [m^2]; height over its line [m], positive outside.
    """
    normal_x, normal_y = solids.normals[edge, 0], solids.normals[edge, 1]
    from_x, from_y = x - solids.vertices[edge, 0], y - solids.vertices[edge, 1]
    height = from_x * normal_x + from_y * normal_y
    along = from_y * normal_x - from_x * normal_y
    beyond = along - min(max(along, 0.0), solids.lengths[edge])
    return height * height + beyond * beyond, height


@kernel
def signed_distance(x: float, y: float, polygon: int, solids: Any) -> float:
    """Distance of a point from a convex polygon [m], negative inside.

    Parameters
    ----------
    x, y
        The point [m].
    polygon
        Index of the polygon.
    solids
        The polygons.
    """
    nearest, highest = np.inf, -np.inf
    for edge in range(solids.polygon_start[polygon], solids.polygon_start[polygon + 1]):
        squared, height = edge_gap(x, y, edge, solids)
        nearest, highest = min(nearest, squared), max(highest, height)
    distance = float(np.sqrt(nearest))
    return distance if highest > 0.0 else -distance


@allocating_kernel
def _bounding_circles(solids: Any) -> Any:
    """Centre x, y and radius [m] of a circle around each polygon, shape [polygon_count, 3]."""
    circles = np.zeros((len(solids.is_goal), 3))
    for polygon in range(len(circles)):
        corners = solids.vertices[solids.polygon_start[polygon] : solids.polygon_start[polygon + 1]]
        x, y = corners[:, 0].mean(), corners[:, 1].mean()
        radius = np.hypot(corners[:, 0] - x, corners[:, 1] - y).max()
        circles[polygon, 0], circles[polygon, 1], circles[polygon, 2] = x, y, radius
    return circles


@allocating_kernel
def build_broad_phase(solids: Any, extents: Any, reach: float, begin: int, end: int) -> Any:
    """List, for each cell of some scenes, the polygons within reach of it.

    Parameters
    ----------
    solids
        The polygons.
    extents
        Width and height of each scene's box [m], shape [scene_count, 2].
    reach
        Largest distance [m] at which a polygon matters.
    begin, end
        Scenes ``begin:end`` are looked at.

    Returns
    -------
    inverse_size, start, polygons, clearance
        The fields of `BroadPhase` for these scenes.
    """
    scene_count = end - begin
    inverse_size = np.empty((scene_count, 2))
    start = np.zeros(scene_count * CELLS_X * CELLS_Y + 1, dtype=np.int64)
    clearance = np.empty(scene_count * CELLS_X * CELLS_Y)
    listed = [np.int64(0) for _ in range(0)]
    circles = _bounding_circles(solids)
    cell = 0
    for scene in range(begin, end):
        size_x, size_y = extents[scene, 0] / CELLS_X, extents[scene, 1] / CELLS_Y
        inverse_size[scene - begin, 0], inverse_size[scene - begin, 1] = 1.0 / size_x, 1.0 / size_y
        half_diagonal = 0.5 * np.sqrt(size_x * size_x + size_y * size_y)
        for row in range(CELLS_Y):
            nearest = np.inf
            for column in range(CELLS_X):
                x, y = (column + 0.5) * size_x, (row + 0.5) * size_y
                # No farther than from the cell before, and the way from there to here.
                limit = max(nearest + 1.001 * size_x, reach + half_diagonal)
                nearest = np.inf
                for polygon in range(solids.scene_start[scene], solids.scene_start[scene + 1]):
                    dx, dy = x - circles[polygon, 0], y - circles[polygon, 1]
                    if dx * dx + dy * dy > (limit + circles[polygon, 2]) ** 2:
                        continue
                    distance = signed_distance(x, y, polygon, solids)
                    nearest = min(nearest, distance)
                    if distance <= reach + half_diagonal:
                        listed.append(np.int64(polygon))
                clearance[cell] = nearest - half_diagonal
                cell += 1
                start[cell] = len(listed)
    polygons = np.empty(len(listed), dtype=np.int64)
    for k in range(len(listed)):
        polygons[k] = listed[k]
    return inverse_size, start, polygons, clearance


def join_broad_phases(shares: Sequence[BroadPhase]) -> BroadPhase:
    """Cells of all scenes from those of some of them at a time, in order."""
    offsets = np.cumsum([0] + [len(share.polygons) for share in shares])
    starts = [share.start[:-1] + at for share, at in zip(shares, offsets[:-1], strict=True)]
    return BroadPhase(
        inverse_size=np.concatenate([share.inverse_size for share in shares]),
        start=np.concatenate([*starts, offsets[-1:]]),
        polygons=np.concatenate([share.polygons for share in shares]),
        clearance=np.concatenate([share.clearance for share in shares]),
    )


@kernel
def grid_index(cells_along: float, count: int) -> int:
    """Index of a cell along one of a grid's axes, within the grid; 0 for what is no number.

    Parameters
    ----------
    cells_along
        Distance from the grid's start, in cells.
    count
        Number of cells along the axis.
    """
    if not cells_along > 0.0:
        return 0
    return count - 1 if cells_along >= count else int(cells_along)


@kernel
def cell_of(x: float, y: float, scene: int, broad_phase: Any) -> int:
    """Index of the cell that holds a point; points outside belong to the nearest cell."""
    column = grid_index(x * broad_phase.inverse_size[scene, 0], CELLS_X)
    row = grid_index(y * broad_phase.inverse_size[scene, 1], CELLS_Y)
    return (scene * CELLS_Y + row) * CELLS_X + column


@allocating_kernel
def obstacle_distances(points: Any, scene: int, solids: Any) -> Any:
    """Distance of points from a scene's nearest obstacle, the goal's parts left out.

    Parameters
    ----------
    points
        Points in the x-y plane [m], shape [point_count, 2].
    scene
        Index of the scene.
    solids
        The polygons.

    Returns
    -------
    ndarray
        Signed distances [m], shape [point_count]; infinite without obstacles.
    """
    nearest = np.full(len(points), np.inf)
    for polygon in range(solids.scene_start[scene], solids.scene_start[scene + 1]):
        if solids.is_goal[polygon]:
            continue
        for k in range(len(points)):
            gap = signed_distance(points[k, 0], points[k, 1], polygon, solids)
            nearest[k] = min(nearest[k], gap)
    return nearest
