"""Perfectly inelastic contact of spheres with convex polygons and with the box.

A polygon stands for a prism through the whole depth of the box, so contact
with it is a problem in the x-y plane. A sphere that overlaps a solid is moved
out along the direction to the solid's closest point and loses the velocity
component into the solid; the component along it stays (no friction). With
adhesion, the two components decay at given rates while the sphere touches.

The closest point is taken on the edges, with the sign from the inside test. A
largest-half-plane-distance test would treat a sharp corner as a long mitre.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import allocating_kernel, kernel
from pourcast.engine.simd import LANES, load, maximum, minimum, splat, store, where_less

TOUCH_SKIN = 0.1
"""A sphere touches a solid while its centre is within (1 + TOUCH_SKIN) radii."""

MIN_CLEARANCE = 1e-4
"""Least distance [m] of a centre from a solid; below it the last position is kept."""

CELLS_X, CELLS_Y = 50, 75
_PASSES = 4


class Solids(NamedTuple):
    """Convex polygons of many scenes in flat arrays, counter-clockwise.

    Polygon p owns the vertices ``polygon_start[p]:polygon_start[p + 1]``; scene
    s owns the polygons ``scene_start[s]:scene_start[s + 1]``. Vertex k also
    stands for the edge from it to the next vertex of its polygon.
    """

    vertices: NDArray[np.float64]
    """Vertices [m], shape [vertex_count, 2]."""
    normals: NDArray[np.float64]
    """Outward unit normals of the edges, shape [vertex_count, 2]."""
    lengths: NDArray[np.float64]
    """Lengths of the edges [m], shape [vertex_count]."""
    polygon_start: NDArray[np.int64]
    scene_start: NDArray[np.int64]
    is_goal: NDArray[np.bool_]
    """Whether a polygon belongs to the goal (divider, cup), shape [polygon_count]."""


class Cells(NamedTuple):
    """Which polygons a sphere in a cell of the x-y plane may touch (broad phase)."""

    inverse_size: NDArray[np.float64]
    """Cells per metre along x and y, shape [scene_count, 2]."""
    start: NDArray[np.int64]
    """Offsets into `polygons`, shape [scene_count * CELLS_X * CELLS_Y + 1]."""
    polygons: NDArray[np.int64]


def pack_solids(scenes: list[list[tuple[NDArray[np.float64], bool]]]) -> Solids:
    """Flatten polygons into the arrays that the kernels read.

    Parameters
    ----------
    scenes
        For each scene a list of (vertices [m], shape [k, 2], counter-clockwise;
        whether the polygon is part of the goal).

    Returns
    -------
    Solids
        The same polygons, with edge normals and lengths.
    """
    polygons = [polygon for scene in scenes for polygon in scene]
    vertices = [np.asarray(v, dtype=np.float64) for v, _ in polygons]
    edges = [np.roll(v, -1, axis=0) - v for v in vertices]
    flat_edges = np.concatenate([*edges, np.zeros((0, 2))])
    lengths = np.hypot(flat_edges[:, 0], flat_edges[:, 1])
    outward = np.stack([flat_edges[:, 1], -flat_edges[:, 0]], axis=1)
    return Solids(
        vertices=np.concatenate([*vertices, np.zeros((0, 2))]),
        normals=outward / lengths[:, None],
        lengths=lengths,
        polygon_start=np.cumsum([0] + [len(v) for v in vertices]),
        scene_start=np.cumsum([0] + [len(scene) for scene in scenes]),
        is_goal=np.array([goal for _, goal in polygons], dtype=np.bool_),
    )


@kernel
def signed_distance(x: float, y: float, polygon: int, reach: float, solids: Any) -> Any:
    """Signed distance of a point from a convex polygon, and the direction away from it.

    Parameters
    ----------
    x, y
        The point [m].
    polygon
        Index of the polygon.
    reach
        Distances beyond this [m] need not be exact: a lower bound is returned.
    solids
        The polygons.

    Returns
    -------
    distance
        Distance [m], negative inside.
    normal_x, normal_y
        Unit vector from the closest point to (x, y), reversed inside.
    """
    first, last = solids.polygon_start[polygon], solids.polygon_start[polygon + 1]
    highest, face = -np.inf, first
    for k in range(first, last):
        height = (x - solids.vertices[k, 0]) * solids.normals[k, 0]
        height += (y - solids.vertices[k, 1]) * solids.normals[k, 1]
        if height > reach:
            return height, 0.0, 0.0
        if height > highest:
            highest, face = height, k
    normal_x, normal_y = solids.normals[face, 0], solids.normals[face, 1]
    if highest <= 0.0:
        return highest, normal_x, normal_y
    # Outside: the closest point is on an edge that the point is in front of.
    nearest, nearest_x, nearest_y = np.inf, 0.0, 0.0
    for k in range(first, last):
        edge_x, edge_y = solids.normals[k, 0], solids.normals[k, 1]
        from_x, from_y = x - solids.vertices[k, 0], y - solids.vertices[k, 1]
        if from_x * edge_x + from_y * edge_y < 0.0:
            continue
        along = min(max(from_y * edge_x - from_x * edge_y, 0.0), solids.lengths[k])
        gap_x, gap_y = from_x + along * edge_y, from_y - along * edge_x
        squared = gap_x * gap_x + gap_y * gap_y
        if squared < nearest:
            nearest, nearest_x, nearest_y = squared, gap_x, gap_y
    distance = np.sqrt(nearest)
    if distance > 1e-9:
        normal_x, normal_y = nearest_x / distance, nearest_y / distance
    return distance, normal_x, normal_y


@allocating_kernel
def build_cells(solids: Any, extents: Any, reach: float) -> Any:
    """List, for each cell of each scene, the polygons within reach of it.

    Parameters
    ----------
    solids
        The polygons.
    extents
        Width and height of each scene's box [m], shape [scene_count, 2].
    reach
        Largest distance [m] at which a polygon matters.

    Returns
    -------
    Cells
        The broad phase.
    """
    scene_count = len(solids.scene_start) - 1
    inverse_size = np.empty((scene_count, 2))
    start = np.zeros(scene_count * CELLS_X * CELLS_Y + 1, dtype=np.int64)
    found = [np.int64(0) for _ in range(0)]
    cell = 0
    for scene in range(scene_count):
        size_x, size_y = extents[scene, 0] / CELLS_X, extents[scene, 1] / CELLS_Y
        inverse_size[scene, 0], inverse_size[scene, 1] = 1.0 / size_x, 1.0 / size_y
        far = reach + 0.5 * np.sqrt(size_x * size_x + size_y * size_y)
        for row in range(CELLS_Y):
            for column in range(CELLS_X):
                x, y = (column + 0.5) * size_x, (row + 0.5) * size_y
                for polygon in range(solids.scene_start[scene], solids.scene_start[scene + 1]):
                    if signed_distance(x, y, polygon, far, solids)[0] <= far:
                        found.append(np.int64(polygon))
                cell += 1
                start[cell] = len(found)
    polygons = np.empty(len(found), dtype=np.int64)
    for k in range(len(found)):
        polygons[k] = found[k]
    return Cells(inverse_size, start, polygons)


@kernel
def cell_of(x: float, y: float, scene: int, cells: Any) -> int:
    """Index of the cell that holds a point; points outside belong to the nearest cell."""
    column = min(max(int(x * cells.inverse_size[scene, 0]), 0), CELLS_X - 1)
    row = min(max(int(y * cells.inverse_size[scene, 1]), 0), CELLS_Y - 1)
    return (scene * CELLS_Y + row) * CELLS_X + column


@kernel
def nearest_solid(x: float, y: float, scene: int, reach: float, solids: Any, cells: Any) -> Any:
    """Signed distance [m] to the nearest polygon within reach (infinite if none), and its index."""
    cell = cell_of(x, y, scene, cells)
    nearest, which = np.inf, -1
    for k in range(cells.start[cell], cells.start[cell + 1]):
        distance = signed_distance(x, y, cells.polygons[k], reach, solids)[0]
        if distance < nearest:
            nearest, which = distance, cells.polygons[k]
    return nearest, which


@allocating_kernel
def obstacle_distances(places: Any, scene: int, solids: Any) -> Any:
    """Distance of points from a scene's nearest obstacle, the goal's parts left out.

    Parameters
    ----------
    places
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
    nearest = np.full(len(places), np.inf)
    for polygon in range(solids.scene_start[scene], solids.scene_start[scene + 1]):
        if solids.is_goal[polygon]:
            continue
        for k in range(len(places)):
            gap = signed_distance(places[k, 0], places[k, 1], polygon, np.inf, solids)[0]
            nearest[k] = min(nearest[k], gap)
    return nearest


@kernel
def collide_with_polygons(state: Any, lanes: Any, solids: Any, cells: Any, slots: int) -> None:
    """Push spheres out of polygons, stop their motion into them, let them stick.

    Parameters
    ----------
    state
        Positions, velocities, last positions and contact flags; changed in place.
    lanes
        Parameters of the 16 lanes.
    solids, cells
        The polygons and the broad phase.
    slots
        Number of (row, lane) slots that hold a particle, counted row by row.
    """
    for slot in range(slots):
        row, lane = slot // LANES, slot % LANES
        scene = lanes.scene[lane]
        if scene < 0:
            continue
        cell = cell_of(state.position[0, row, lane], state.position[1, row, lane], scene, cells)
        if cells.start[cell] != cells.start[cell + 1]:
            _collide_one(state, lanes, solids, cells, row, lane)


@kernel
def _collide_one(state: Any, lanes: Any, solids: Any, cells: Any, row: int, lane: int) -> None:
    scene = lanes.scene[lane]
    radius = float(lanes.radius[lane])
    reach = radius * (1.0 + TOUCH_SKIN)
    keep_normal, keep_tangential = lanes.keep_normal[lane], lanes.keep_tangential[lane]
    width = float(lanes.width[lane])
    x, y = float(state.position[0, row, lane]), float(state.position[1, row, lane])
    u, v = float(state.velocity[0, row, lane]), float(state.velocity[1, row, lane])
    w = float(state.velocity[2, row, lane])
    contacts = 0
    for attempt in range(_PASSES):
        cell = cell_of(x, y, scene, cells)
        moved = False
        for k in range(cells.start[cell], cells.start[cell + 1]):
            polygon = cells.polygons[k]
            distance, normal_x, normal_y = signed_distance(x, y, polygon, reach, solids)
            if distance > reach:
                continue
            contacts += 1
            if not solids.is_goal[polygon]:
                state.touched[row, lane] = 1
            speed_out = u * normal_x + v * normal_y
            speed_along = v * normal_x - u * normal_y
            if distance < radius:
                x += (radius - distance) * normal_x
                y += (radius - distance) * normal_y
                speed_out = max(speed_out, 0.0)
                moved = moved or radius - distance > 1e-3 * radius
            if attempt == 0:
                speed_out *= keep_normal
                speed_along *= keep_tangential
                w *= keep_tangential
            u = speed_out * normal_x - speed_along * normal_y
            v = speed_out * normal_y + speed_along * normal_x
        if x < radius or x > width - radius or y < radius:
            x, y = min(max(x, radius), width - radius), max(y, radius)
            contacts += 1
        if not moved or contacts == 1:
            break
    # A single contact has been undone; several may have pushed the sphere into one another.
    if contacts > 1 and nearest_solid(x, y, scene, reach, solids, cells)[0] < MIN_CLEARANCE:
        # Wedged between solids: no place to go. The last position was free of all of them.
        x, y = state.previous[0, row, lane], state.previous[1, row, lane]
        u, v, w = 0.0, 0.0, 0.0
    state.position[0, row, lane], state.position[1, row, lane] = x, y
    state.velocity[0, row, lane], state.velocity[1, row, lane] = u, v
    state.velocity[2, row, lane] = w


@kernel
def collide_with_box(state: Any, lanes: Any) -> None:
    """Keep spheres inside the box; side walls and floor are sticky, front and back are not.

    The front and back panes are the plane of the picture rather than things in
    the scene: a liquid that stuck to them would never leave its start.
    """
    radius = load(lanes.radius, 0)
    touching = radius * (1.0 + TOUCH_SKIN)
    keep_normal, keep_tangential = load(lanes.keep_normal, 0), load(lanes.keep_tangential, 0)
    right, top = load(lanes.width, 0) - radius, load(lanes.ceiling, 0) - radius
    back = load(lanes.depth, 0) - radius
    width = load(lanes.width, 0)
    zero, one = splat(0.0), splat(1.0)
    for row in range(state.position.shape[1]):
        x, y = load(state.position[0], row), load(state.position[1], row)
        z = load(state.position[2], row)
        u, v = load(state.velocity[0], row), load(state.velocity[1], row)
        w = load(state.velocity[2], row)
        u = where_less(x, radius, maximum(u, zero), where_less(right, x, minimum(u, zero), u))
        v = where_less(y, radius, maximum(v, zero), where_less(top, y, minimum(v, zero), v))
        w = where_less(z, radius, maximum(w, zero), where_less(back, z, minimum(w, zero), w))
        from_side = minimum(x, width - x)
        side_normal = where_less(from_side, touching, keep_normal, one)
        side_along = where_less(from_side, touching, keep_tangential, one)
        floor_normal = where_less(y, touching, keep_normal, one)
        floor_along = where_less(y, touching, keep_tangential, one)
        store(state.velocity[0], row, u * side_normal * floor_along)
        store(state.velocity[1], row, v * side_along * floor_normal)
        store(state.velocity[2], row, w * side_along * floor_along)
        store(state.position[0], row, minimum(maximum(x, radius), right))
        store(state.position[1], row, minimum(maximum(y, radius), top))
        store(state.position[2], row, minimum(maximum(z, radius), back))
