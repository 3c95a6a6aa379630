"""Perfectly inelastic contact of spheres with convex polygons and with the box.

A sphere that overlaps a solid is moved out along the direction to the solid's
closest point and loses the velocity component into the solid; the component
along it stays (no friction). With adhesion, the two components decay at given
rates while the sphere touches.

Every sphere keeps a list of the edges near it, which holds until it has moved
by its `slack` (a Verlet list, here of solids). Lists are made one sphere at a
time; contact with what is listed is found for a row of spheres at once.
"""

from typing import Any

import numpy as np

from pourcast.engine.compile import kernel
from pourcast.engine.simd import (
    LANES,
    any_less,
    bits_less,
    fma,
    fnma,
    load,
    maximum,
    minimum,
    splat,
    store,
    where_less,
)
from pourcast.engine.simd import sqrt as vector_sqrt
from pourcast.engine.solids import cell_of, edge_gap
from pourcast.engine.state import NEAR_EDGES, NEAR_POLYGONS

LIST_SKIN = 0.5
"""A list holds what is nearer than where a sphere touches, and LIST_SKIN radii more."""

MIN_CLEARANCE = 1e-4
"""Least distance [m] of a centre from a solid; below it the last position is kept."""

_PASSES = 4
_NOTICED = 1e-3
"""Overlap, in radii, below which a contact needs no further pass."""
_FAR = 1e6


@kernel
def collide_with_polygons(
    state: Any, parameters: Any, solids: Any, broad_phase: Any, begin: int, end: int
) -> None:
    """Push spheres out of polygons, stop their motion into them, let them stick.

    Parameters
    ----------
    state
        Positions, velocities, last positions, contact flags and lists; changed in place.
    parameters
        Parameters of the lanes.
    solids, broad_phase
        The polygons and the broad phase.
    begin, end
        Rows ``begin:end`` are looked at.
    """
    for row in range(begin, end):
        dx = load(state.position[0], row) - load(state.listed_at[0], row)
        dy = load(state.position[1], row) - load(state.listed_at[1], row)
        if any_less(load(state.squared_slack, row), fma(dx, dx, dy * dy)):
            _renew_lists(state, parameters, solids, broad_phase, row)
        if state.most_near[row] > 0:
            _collide_row(state, parameters, row, state.most_near[row])


@kernel
def _renew_lists(state: Any, parameters: Any, solids: Any, broad_phase: Any, row: int) -> None:
    """List anew for those spheres of a row that have moved by more than their slack."""
    most = 0
    dx = load(state.position[0], row) - load(state.listed_at[0], row)
    dy = load(state.position[1], row) - load(state.listed_at[1], row)
    # The test of the caller, bit for bit: when a list is made anew is no matter of company.
    old = bits_less(load(state.squared_slack, row), fma(dx, dx, dy * dy))
    for lane in range(LANES):
        if (old >> lane) & 1:
            list_near(state, parameters, solids, broad_phase, row, lane)
        most = max(most, int(state.near_count[row, lane]))
    state.most_near[row] = most


@kernel
def list_near(
    state: Any, parameters: Any, solids: Any, broad_phase: Any, row: int, lane: int
) -> None:
    """List the polygons near one sphere, each by its nearest edges, and say how long it holds.

    Parameters
    ----------
    state
        The spheres and their lists; changed in place.
    parameters
        Parameters of the lanes.
    solids, broad_phase
        The polygons and the broad phase.
    row, lane
        Place of the sphere.
    """
    x, y = float(state.position[0, row, lane]), float(state.position[1, row, lane])
    state.listed_at[0, row, lane], state.listed_at[1, row, lane] = x, y
    for slot in range(int(state.near_count[row, lane])):
        _empty_slot(state, row, lane, slot)
    state.near_count[row, lane] = 0.0
    scene = parameters.scene[lane]
    if scene < 0:
        state.squared_slack[row, lane] = np.inf
        return
    radius = float(parameters.radius[lane])
    touch = float(parameters.touch[lane])
    reach = touch + radius * LIST_SKIN
    cell = cell_of(x, y, scene, broad_phase)
    slack = radius * LIST_SKIN
    if broad_phase.clearance[cell] > reach:
        slack = broad_phase.clearance[cell] - touch
    else:
        for k in range(broad_phase.start[cell], broad_phase.start[cell + 1]):
            slack = _list_polygon(
                state, solids, broad_phase.polygons[k], row, lane, touch, reach, slack
            )
    slack = max(slack, 0.0)
    state.squared_slack[row, lane] = slack * slack


@kernel
def _empty_slot(state: Any, row: int, lane: int, slot: int) -> None:
    """Let a slot hold an edge so far away that it is never met."""
    for edge in range(slot * NEAR_EDGES, (slot + 1) * NEAR_EDGES):
        state.near_edges[edge, 0, row, lane], state.near_edges[edge, 1, row, lane] = 0.0, -_FAR
        state.near_edges[edge, 2, row, lane], state.near_edges[edge, 3, row, lane] = 0.0, 1.0
        state.near_edges[edge, 4, row, lane] = 1.0


@kernel
def _list_polygon(
    state: Any,
    solids: Any,
    polygon: int,
    row: int,
    lane: int,
    touch: float,
    reach: float,
    slack: float,
) -> float:
    """Add a polygon to a sphere's list if it is near; returns the slack that this leaves."""
    x, y = float(state.position[0, row, lane]), float(state.position[1, row, lane])
    first, second, third, fourth = np.inf, np.inf, np.inf, np.inf
    edge_1, edge_2, edge_3 = -1, -1, -1
    for edge in range(solids.polygon_start[polygon], solids.polygon_start[polygon + 1]):
        squared = edge_gap(x, y, edge, solids)[0]
        if squared < first:
            first, second, third, fourth = squared, first, second, third
            edge_1, edge_2, edge_3 = edge, edge_1, edge_2
        elif squared < second:
            second, third, fourth = squared, second, third
            edge_2, edge_3 = edge, edge_2
        elif squared < third:
            third, fourth = squared, third
            edge_3 = edge
        else:
            fourth = min(fourth, squared)
    distance = float(np.sqrt(first))
    if distance > reach:
        return slack
    slot = int(state.near_count[row, lane])
    if slot < NEAR_POLYGONS:
        state.near_count[row, lane] = slot + 1
    else:
        # Full: the farthest of all stays out, and may not come near unnoticed.
        slot = 0
        for other in range(1, NEAR_POLYGONS):
            if state.near_distance[other, row, lane] > state.near_distance[slot, row, lane]:
                slot = other
        farthest = float(state.near_distance[slot, row, lane])
        slack = min(slack, max(farthest, distance) - touch)
        if distance >= farthest:
            return slack
    state.near_distance[slot, row, lane] = distance
    state.near_is_obstacle[slot, row, lane] = 0.0 if solids.is_goal[polygon] else 1.0
    _list_edge(state, solids, edge_1, slot * NEAR_EDGES, row, lane)
    _list_edge(state, solids, edge_2, slot * NEAR_EDGES + 1, row, lane)
    _list_edge(state, solids, edge_3, slot * NEAR_EDGES + 2, row, lane)
    # Half the difference: the sphere may come nearer to the one and farther from the other.
    return min(slack, 0.5 * (float(np.sqrt(fourth)) - distance))


@kernel
def _list_edge(state: Any, solids: Any, edge: int, slot_edge: int, row: int, lane: int) -> None:
    state.near_edges[slot_edge, 0, row, lane] = solids.vertices[edge, 0]
    state.near_edges[slot_edge, 1, row, lane] = solids.vertices[edge, 1]
    state.near_edges[slot_edge, 2, row, lane] = solids.normals[edge, 0]
    state.near_edges[slot_edge, 3, row, lane] = solids.normals[edge, 1]
    state.near_edges[slot_edge, 4, row, lane] = solids.lengths[edge]


@kernel
def _gap(state: Any, row: int, slot: int, x: Any, y: Any) -> Any:
    """Signed distances from the polygons in a slot, and unit vectors out of them."""
    nearest, gap_x, gap_y = splat(np.inf), splat(0.0), splat(0.0)
    highest, zero, one = splat(-np.inf), splat(0.0), splat(1.0)
    for edge in range(slot * NEAR_EDGES, (slot + 1) * NEAR_EDGES):
        normal_x = load(state.near_edges[edge, 2], row)
        normal_y = load(state.near_edges[edge, 3], row)
        from_x = x - load(state.near_edges[edge, 0], row)
        from_y = y - load(state.near_edges[edge, 1], row)
        along = fnma(from_x, normal_y, from_y * normal_x)
        along = minimum(maximum(along, zero), load(state.near_edges[edge, 4], row))
        to_x, to_y = fma(along, normal_y, from_x), fnma(along, normal_x, from_y)
        squared = fma(to_x, to_x, to_y * to_y)
        gap_x = where_less(squared, nearest, to_x, gap_x)
        gap_y = where_less(squared, nearest, to_y, gap_y)
        nearest = minimum(squared, nearest)
        highest = maximum(highest, fma(from_x, normal_x, from_y * normal_y))
    side = where_less(highest, zero, zero - one, one)
    distance = vector_sqrt(nearest)
    scale = side / maximum(distance, splat(1e-9))
    return side * distance, gap_x * scale, gap_y * scale


@kernel
def _collide_row(state: Any, parameters: Any, row: int, slot_count: int) -> None:
    """Contact of the spheres of a row with all that is in their lists."""
    zero, one = splat(0.0), splat(1.0)
    radius, width = load(parameters.radius, 0), load(parameters.width, 0)
    touch, right = load(parameters.touch, 0), width - radius
    x, y = load(state.position[0], row), load(state.position[1], row)
    u, v, w = (
        load(state.velocity[0], row),
        load(state.velocity[1], row),
        load(state.velocity[2], row),
    )
    touched = load(state.touched, row)
    # A single contact is undone at once; several may push a sphere into one another.
    from_wall = minimum(minimum(x, width - x), y)
    partners = load(state.near_count, row) + where_less(from_wall, 1.5 * radius, one, zero)
    several = where_less(one, partners, one, zero)
    active = one
    keep_normal, keep_tangential = (
        load(parameters.keep_normal, 0),
        load(parameters.keep_tangential, 0),
    )
    for _ in range(_PASSES):
        deepest = zero
        for slot in range(slot_count):
            distance, normal_x, normal_y = _gap(state, row, slot, x, y)
            depth = maximum(radius - distance, zero) * active
            deepest = maximum(deepest, depth)
            x, y = fma(depth, normal_x, x), fma(depth, normal_y, y)
            out, along = fma(u, normal_x, v * normal_y), fnma(u, normal_y, v * normal_x)
            kept = where_less(zero, depth, maximum(out, zero), out)
            kept = kept * where_less(distance, touch, keep_normal, one)
            share = where_less(distance, touch, keep_tangential, one)
            change, change_along = kept - out, along * share - along
            u = fnma(change_along, normal_y, fma(change, normal_x, u))
            v = fma(change_along, normal_x, fma(change, normal_y, v))
            w = w * share
            is_obstacle = load(state.near_is_obstacle[slot], row)
            touched = where_less(distance, touch, maximum(touched, is_obstacle), touched)
        x, y = minimum(maximum(x, radius), right), maximum(y, radius)
        active = where_less(_NOTICED * radius, deepest, several, zero) * active
        keep_normal, keep_tangential = one, one
        if not any_less(zero, active):
            break
    if any_less(zero, active):
        # Wedged between solids: no place to go. The last position was free of all of them.
        clearance = splat(_FAR)
        for slot in range(slot_count):
            clearance = minimum(clearance, _gap(state, row, slot, x, y)[0])
        stuck = where_less(clearance, splat(MIN_CLEARANCE), active, zero)
        x = where_less(zero, stuck, load(state.previous[0], row), x)
        y = where_less(zero, stuck, load(state.previous[1], row), y)
        u, v = where_less(zero, stuck, zero, u), where_less(zero, stuck, zero, v)
        w = where_less(zero, stuck, zero, w)
    store(state.position[0], row, x)
    store(state.position[1], row, y)
    store(state.velocity[0], row, u)
    store(state.velocity[1], row, v)
    store(state.velocity[2], row, w)
    store(state.touched, row, touched)


@kernel
def collide_with_box(state: Any, parameters: Any, begin: int, end: int) -> None:
    """Keep spheres of rows ``begin:end`` inside the box, of which side walls and floor are sticky.

    The front and back panes are the plane of the picture rather than things in
    the scene: a liquid that stuck to them would never leave its start.
    """
    radius = load(parameters.radius, 0)
    touching = load(parameters.touch, 0)
    keep_normal, keep_tangential = (
        load(parameters.keep_normal, 0),
        load(parameters.keep_tangential, 0),
    )
    right, top = load(parameters.width, 0) - radius, load(parameters.ceiling, 0) - radius
    back = load(parameters.depth, 0) - radius
    width = load(parameters.width, 0)
    zero, one = splat(0.0), splat(1.0)
    for row in range(begin, end):
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
