"""A scene as cells: what is solid, across which direction, and where the liquid starts."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import label

from pourcast.scenes.scene import Scene
from pourcast.stimuli.lattice_boltzmann.cells import CutCells
from pourcast.stimuli.lattice_boltzmann.lattice import N_DIRECTIONS, VELOCITY
from pourcast.stimuli.lattice_boltzmann.solver import wall_normals

Array = NDArray[np.float64]

_TOUCHING = 1e-5
"""Gap [m] at which solids touch."""
SUBCELLS = 16
"""Points along each side of a cell by which partly filled ones are measured."""
_LEAST_ROOM = 0.05
"""Cells with less are solid."""
_LEAST_WALL = 0.2
"""Thickness [cells] that thinner walls are given: points would miss some of them."""
_LEAST_GAP = 0.5
"""Width [cells] below which a gap between solids is closed: a cell has one velocity, and knows
nothing of how the sides of such a gap hold liquid back."""


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
    cut
        How much of each other cell is solid.
    normal
        Directions across the surface of solid and cut cells and of the margin, shape
        [3, nx + 2, ny + 2, nz + 2].
    plane
        Where the margin is a plane of symmetry and no wall: front and back, shape
        [nx + 2, ny + 2, nz + 2].
    fill
        Share of each cell's room that liquid fills at the start, shape [nx, ny, nz].
    goal
        Share of each cell that counts towards the judgment, shape [nx, ny].
    """

    cell: float
    origin: tuple[float, float, float]
    solid: NDArray[np.bool_]
    cut: CutCells
    normal: NDArray[np.float32]
    plane: NDArray[np.bool_]
    fill: NDArray[np.float64]
    goal: NDArray[np.float64]


def voxelise(scene: Scene, resolution: int, layers: int | None = None) -> Voxels:
    """Put a scene on a grid.

    Parameters
    ----------
    scene
        The scene.
    resolution
        Cells along the longest side of the box.
    layers
        Cells through the depth, in the middle of the box; as many as fill it by default.
    """
    box = scene.box
    sides = (box.width, box.height, box.depth)
    cell = max(sides) / resolution
    counts = [max(3, round(side / cell)) for side in sides]
    counts[2] = min(layers or counts[2], counts[2])
    # The floor is where it is; left and right, front and back are alike.
    origin = (
        (box.width - counts[0] * cell) / 2,
        0.0,
        (box.depth - counts[2] * cell) / 2,
    )
    centres = [origin[axis] + (np.arange(counts[axis]) + 0.5) * cell for axis in range(2)]
    x, y = np.meshgrid(*centres, indexing="ij")
    closed = _without_splits(_solid_points(scene, x, y, cell))
    cut = _measured(closed)
    solid = cut.room < _LEAST_ROOM
    depth = counts[2]
    blob = shapely.Point(scene.liquid.centre).buffer(scene.liquid.diameter / 2, quad_segs=64)
    wet = _points_in([blob], x, y, cell) & ~closed
    fill = _by_cell(wet).mean(axis=(2, 3)) / np.maximum(cut.room, _LEAST_ROOM)
    return Voxels(
        cell=cell,
        origin=origin,
        solid=_through(solid, depth),
        cut=cut,
        normal=_normals(scene, solid, cut.room < 1.0, x, y, depth),
        plane=_planes(solid, depth),
        fill=_through(np.where(solid, 0.0, fill), depth),
        goal=_goal_share(scene, ~closed, x, y, cell),
    )


def cut_cells(solid: NDArray[np.bool_]) -> CutCells:
    """Room and passages of cells, measured by points.

    Parameters
    ----------
    solid
        Whether points are in a solid, `SUBCELLS` along each side of each cell, shape
        [nx * SUBCELLS, ny * SUBCELLS]. Of a cell that a wall splits, all but one part counts as
        solid.
    """
    return _measured(_without_splits(solid))


def _measured(solid: NDArray[np.bool_]) -> CutCells:
    """What `cut_cells` gives, of cells that no wall splits."""
    shape = (solid.shape[0] // SUBCELLS, solid.shape[1] // SUBCELLS)
    passage = np.empty((N_DIRECTIONS, *shape), dtype=np.float32)
    known: dict[tuple[int, int], NDArray[np.float32]] = {}
    for i, (dx, dy, _) in enumerate(VELOCITY):
        way = (int(dx), int(dy))
        if way not in known:
            blocks = _passing(~solid, *way).reshape(shape[0], SUBCELLS, shape[1], SUBCELLS)
            known[way] = blocks.mean(axis=(1, 3), dtype=np.float32)
        passage[i] = known[way]
    return CutCells(known[0, 0], passage)


def _without_splits(solid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Close all but the largest open part of each cell; of two as large, both.

    A cell has one velocity and one mass: through one that a thin wall splits, liquid would seep.
    """
    closed = solid.copy()
    cells = _by_cell(closed)
    share = cells.mean(axis=(2, 3))
    for i, j in np.argwhere((share > 0.0) & (share < 1.0)):
        parts, count = label(~cells[i, j])
        if count > 1:
            sizes = np.bincount(parts.ravel())[1:]
            largest = np.flatnonzero(sizes == sizes.max())
            cells[i, j] = True if len(largest) > 1 else parts != 1 + largest[0]
    return closed


def _solid_points(scene: Scene, x: Array, y: Array, cell: float) -> NDArray[np.bool_]:
    """Whether points are in a solid, `SUBCELLS` along each side of each cell."""
    # As one, or points on an edge that two of them share would let liquid between.
    merged = shapely.union_all([shapely.Polygon(polygon) for polygon in scene.solids])
    tight = shapely.union_all([merged, _thin_walls(merged, cell), *_narrow_gaps(scene, cell)])
    return _points_in(shapely.get_parts(tight), x, y, cell, (scene.box.width, scene.box.height))


def _thin_walls(solid: shapely.Geometry, cell: float) -> shapely.Geometry:
    """Walls that are thinner than points can tell, as thick as they can."""
    half = 0.5 * _LEAST_WALL * cell
    core = shapely.buffer(solid, -half, join_style="mitre")
    thick = shapely.buffer(core, 1.01 * half, join_style="mitre")
    return shapely.buffer(shapely.difference(solid, thick), half)


def _narrow_gaps(scene: Scene, cell: float) -> list[shapely.Geometry]:
    """What is so narrow between two solids, or between one and a side of the box."""
    solids = [shapely.Polygon(polygon) for polygon in scene.solids]
    box = shapely.box(0.0, 0.0, scene.box.width, scene.box.height)
    outside = box.buffer(cell, join_style="mitre").difference(box)
    grown = [one.buffer(0.5 * _LEAST_GAP * cell) for one in (*solids, outside)]
    first, second = shapely.STRtree(grown).query(grown, predicate="intersects")
    return [grown[i].intersection(grown[j]) for i, j in zip(first, second, strict=True) if i < j]


def _points_in(
    shapes: Iterable[shapely.Geometry],
    x: Array,
    y: Array,
    cell: float,
    box: tuple[float, float] | None = None,
) -> NDArray[np.bool_]:
    """Which points are in any of some shapes, shape [nx * SUBCELLS, ny * SUBCELLS].

    Of points beyond a box's sides (a grid is wider by parts of a cell) that says what is beside
    them in the box: shapes that end there go on.
    """
    steps = ((np.arange(SUBCELLS) + 0.5) / SUBCELLS - 0.5) * cell
    along, up = (x[:, 0, None] + steps).ravel(), (y[0, :, None] + steps).ravel()
    if box is not None:
        rim = 1e-6 * cell
        along, up = (np.clip(p, rim, side - rim) for p, side in zip((along, up), box, strict=True))
    inside = np.zeros((len(along), len(up)), dtype=bool)
    for shape in shapes:
        left, low, right, high = shapely.bounds(shape)
        columns = slice(*np.searchsorted(along, (left, right)))
        rows = slice(*np.searchsorted(up, (low, high)))
        points = np.meshgrid(along[columns], up[rows], indexing="ij")
        inside[columns, rows] |= shapely.contains_xy(shape, *points)
    return inside


def _by_cell(points: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Points of each cell, shape [nx, ny, SUBCELLS, SUBCELLS]; a view."""
    shape = (points.shape[0] // SUBCELLS, SUBCELLS, points.shape[1] // SUBCELLS, SUBCELLS)
    return points.reshape(shape).swapaxes(1, 2)


def _goal_share(
    scene: Scene, open_points: NDArray[np.bool_], x: Array, y: Array, cell: float
) -> Array:
    """Share of each cell's open part that counts towards the judgment."""
    holds = np.vectorize(scene.goal.holds, otypes=[bool])
    corners = [holds(x + dx * cell, y + dy * cell) for dx in (-0.5, 0.5) for dy in (-0.5, 0.5)]
    share: Array = np.mean([holds(x, y), *corners], axis=0)
    steps = ((np.arange(SUBCELLS) + 0.5) / SUBCELLS - 0.5) * cell
    dx, dy = np.meshgrid(steps, steps, indexing="ij")
    within = _by_cell(open_points)
    for i, j in np.argwhere((share > 0.0) & (share < 1.0)):
        if within[i, j].any():
            share[i, j] = holds(x[i, j] + dx, y[i, j] + dy)[within[i, j]].mean()
    return share


def _passing(open_points: NDArray[np.bool_], dx: int, dy: int) -> NDArray[np.bool_]:
    """Points from which a move by (dx, dy) cells meets no solid; outside of the grid is none."""
    width, height = open_points.shape
    padded = np.pad(open_points, SUBCELLS, constant_values=True)
    passing = open_points.copy()
    for k in range(1, SUBCELLS + 1) if (dx, dy) != (0, 0) else ():
        i, j = SUBCELLS + k * dx, SUBCELLS + k * dy
        passing &= padded[i : i + width, j : j + height]
    return passing


def _through(plane: NDArray[Any], depth: int) -> NDArray[Any]:
    """The same plane of cells all through the depth."""
    return np.repeat(plane[:, :, None], depth, axis=2)


def _planes(solid: NDArray[np.bool_], depth: int) -> NDArray[np.bool_]:
    """Front and back, where no solid goes on behind them."""
    plane = np.zeros((*(side + 2 for side in solid.shape), depth + 2), dtype=bool)
    plane[1:-1, 1:-1, [0, -1]] = ~solid[:, :, None]
    return plane


def _normals(
    scene: Scene, solid: NDArray[np.bool_], wall: NDArray[np.bool_], x: Array, y: Array, depth: int
) -> NDArray[np.float32]:
    """Across the surface of each solid or cut cell: that of the nearest edge.

    Solids that touch are one: the edge between two of them is no surface. Walls and solids go on
    in front and behind, as in a mirror.
    """
    normal = wall_normals((*solid.shape, depth), periodic=(False, False, True))
    edges = _edges(scene)
    i, j = np.nonzero(wall)
    points = np.stack([x[i, j], y[i, j]], axis=1)
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    squares = (along**2).sum(axis=1)
    # Nearest point of each edge to each cell.
    gaps = points[:, None] - start[None]
    place = np.clip((gaps * along).sum(axis=2) / squares, 0.0, 1.0)
    distances = np.linalg.norm(gaps - place[..., None] * along, axis=2)
    tangent = _mean_direction(along / np.sqrt(squares)[:, None], distances)
    across = np.stack([tangent[:, 1], -tangent[:, 0]])
    normal[:2, i + 1, j + 1] = across[..., None]
    normal[2, i + 1, j + 1] = 0.0
    # What is open of a cut cell goes on in front and behind, too.
    for end in (0, -1):
        normal[:, 1:-1, 1:-1, end] *= solid
        normal[2, 1:-1, 1:-1, end] += ~solid
    return normal


def _mean_direction(along: Array, distances: Array) -> Array:
    """Direction of the nearest edge to each cell; of two as near, the one between them.

    A cell in the divider's tip must not favour one side of it.

    Parameters
    ----------
    along
        Directions of the edges, of length 1, shape [edge_count, 2].
    distances
        Shape [cell_count, edge_count].
    """
    nearest, second = np.argsort(distances, axis=1, kind="stable")[:, :2].T
    cells = np.arange(len(distances))
    tied = distances[cells, second] - distances[cells, nearest] < _TOUCHING
    first, other = along[nearest], along[second]
    aligned = np.where((first * other).sum(axis=1) < 0.0, -1.0, 1.0)[:, None] * other
    mean = np.where(tied[:, None], first + aligned, first)
    direction: Array = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    return direction


def _edges(scene: Scene) -> Array:
    """Edges of all solids together [m], shape [edge_count, 2, 2]."""
    merged = shapely.union_all([shapely.Polygon(p) for p in scene.solids], grid_size=_TOUCHING)
    rings = shapely.get_rings(shapely.get_parts(merged))
    corners = [shapely.get_coordinates(ring) for ring in rings]
    return np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in corners])
