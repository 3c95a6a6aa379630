"""SPH for one large simulation: sums over a neighbour list instead of all pairs.

A Verlet list holds every pair closer than the support radius plus a skin, and
is rebuilt from a grid of cells once a particle has moved half the skin, the
motion that all have in common left out: a blob in free fall keeps its list.
The sum for the density notes which of the listed pairs are within reach, and
the forces run over those. The physics is that of `sph`; only the pair loops
differ.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import allocating_kernel, kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.kernel import shape, slope
from pourcast.engine.sph import finish_density, integrate, start_density

ALL_PAIRS_LIMIT = 600
"""Above this number of particles the neighbour list takes over. There, one simulation by
the list takes as long as 16 in lockstep take, divided by 16."""

SKIN = 0.2
"""Extra reach of the list, in support radii."""


class Pairs(NamedTuple):
    """Pairs of particles, by the one that comes later in the order of the cells.

    The partners of particle ``order[k]`` are ``partner[start[k]:start[k + 1]]``; of
    these, ``near_partner[near_start[k]:near_start[k + 1]]`` were within the support
    radius when the density was last summed.
    """

    order: NDArray[np.int64]
    """Particles, sorted by cell, shape [count]."""
    start: NDArray[np.int64]
    partner: NDArray[np.int32]
    near_start: NDArray[np.int64]
    near_partner: NDArray[np.int32]
    one_minus_q: NDArray[np.float32]
    """1 - r / H of each near pair."""


@allocating_kernel
def sort_into_cells(position: Any, count: int, size: float) -> Any:
    """Sort particles into the cells of a grid around them.

    Parameters
    ----------
    position
        Positions [m], shape [3, at least count].
    count
        Number of particles.
    size
        Edge of a cell [m].

    Returns
    -------
    order, first, grid, cell
        The particles in cell c are ``order[first[c]:first[c + 1]]``, where the cell at
        column x, row y, layer z of a grid of ``grid`` cells is
        ``c = (x * grid[1] + y) * grid[2] + z``; ``cell[i]`` is that of particle i.
    """
    low, grid = np.empty(3), np.empty(3, np.int64)
    for axis in range(3):
        low[axis] = position[axis, :count].min()
        grid[axis] = int((position[axis, :count].max() - low[axis]) / size) + 1
    cell = np.empty(count, np.int64)
    first = np.zeros(grid[0] * grid[1] * grid[2] + 1, np.int64)
    for i in range(count):
        index = 0
        for axis in range(3):
            index = index * grid[axis] + int((position[axis, i] - low[axis]) / size)
        cell[i] = index
        first[index + 1] += 1
    first = np.cumsum(first)
    place, order = first.copy(), np.empty(count, np.int64)
    for i in range(count):
        order[place[cell[i]]] = i
        place[cell[i]] += 1
    return order, first, grid, cell


@allocating_kernel
def list_pairs(position: Any, count: int, reach: float) -> Any:
    """Pairs of particles within reach of each other.

    Parameters
    ----------
    position
        Positions [m], shape [3, at least count].
    count
        Number of particles.
    reach
        Largest distance [m].

    Returns
    -------
    Pairs
        With room for the near pairs, of which there are none yet.
    """
    order, first, grid, cell = sort_into_cells(position, count, reach)
    sorted_position = np.empty((count, 3), position.dtype)
    for k in range(count):
        for axis in range(3):
            sorted_position[k, axis] = position[axis, order[k]]
    start = np.zeros(count + 1, np.int64)
    partner = np.empty(64 * count, np.int32)
    found = 0
    for k in range(count):
        index = cell[order[k]]
        cx, cy, cz = index // (grid[1] * grid[2]), index // grid[2] % grid[1], index % grid[2]
        if found + count > len(partner):
            longer = np.empty(2 * len(partner) + count, np.int32)
            longer[:found] = partner[:found]
            partner = longer
        # Earlier in the order: in the columns before, and in this one up to the particle.
        for nx in range(max(cx - 1, 0), cx + 1):
            for ny in range(max(cy - 1, 0), min(cy + 2, grid[1])):
                line = (nx * grid[1] + ny) * grid[2]
                begin = first[line + max(cz - 1, 0)]
                end = min(first[line + min(cz + 2, grid[2])], k)
                found += _append_near(sorted_position, order, k, begin, end, reach, partner[found:])
        start[k + 1] = found
    return Pairs(
        order,
        start,
        partner[:found].copy(),
        np.zeros(count + 1, np.int64),
        np.empty(found + 1, np.int32),
        np.empty(found + 1, np.float32),
    )


@kernel
def _append_near(
    place: Any, order: Any, k: int, begin: int, end: int, reach: float, partner: Any
) -> int:
    """Write those particles of a range that are within reach of the k-th; returns how many."""
    x, y, z = place[k, 0], place[k, 1], place[k, 2]
    found, squared_reach = 0, np.float32(reach * reach)
    for m in range(begin, end):
        dx, dy, dz = x - place[m, 0], y - place[m, 1], z - place[m, 2]
        # Written always, kept or written over: a branch here is mispredicted half the time.
        partner[found] = order[m]
        found += dx * dx + dy * dy + dz * dz < squared_reach
    return found


@kernel
def add_listed_density(state: Any, lanes: Any, pairs: Any) -> None:
    """Kernel sum over the listed pairs; notes which of them are near."""
    position = state.position.reshape(3, state.density.size)
    density = state.density.reshape(state.density.size)
    inverse_support = lanes.inverse_support[0]
    one, zero = np.float32(1.0), np.float32(0.0)
    found = 0
    for k in range(len(pairs.order)):
        i = pairs.order[k]
        x, y, z = position[0, i], position[1, i], position[2, i]
        total = density[i]
        for entry in range(pairs.start[k], pairs.start[k + 1]):
            j = pairs.partner[entry]
            dx, dy, dz = x - position[0, j], y - position[1, j], z - position[2, j]
            near = max(one - np.sqrt(dx * dx + dy * dy + dz * dz) * inverse_support, zero)
            share = np.float32(shape(near))
            total += share
            density[j] += share
            # Written always, kept or written over, as in `_append_near`.
            pairs.near_partner[found] = j
            pairs.one_minus_q[found] = near
            found += near > zero
        density[i] = total
        pairs.near_start[k + 1] = found


@kernel
def add_listed_forces(state: Any, lanes: Any, pairs: Any) -> None:
    """Pressure and artificial viscosity over the near pairs."""
    size = state.density.size
    position, velocity = state.position.reshape(3, size), state.velocity.reshape(3, size)
    acceleration = state.acceleration.reshape(3, size)
    density, pressure = state.density.reshape(size), state.pressure.reshape(size)
    pressure_factor, viscosity_factor = lanes.pressure_factor[0], lanes.viscosity_factor[0]
    floor, zero = lanes.separation_floor[0], np.float32(0.0)
    for k in range(len(pairs.order)):
        i = pairs.order[k]
        x, y, z = position[0, i], position[1, i], position[2, i]
        u, v, w = velocity[0, i], velocity[1, i], velocity[2, i]
        ax, ay, az = acceleration[0, i], acceleration[1, i], acceleration[2, i]
        for entry in range(pairs.near_start[k], pairs.near_start[k + 1]):
            j = pairs.near_partner[entry]
            dx, dy, dz = x - position[0, j], y - position[1, j], z - position[2, j]
            r2 = dx * dx + dy * dy + dz * dz
            du, dv, dw = u - velocity[0, j], v - velocity[1, j], w - velocity[2, j]
            approach = min(du * dx + dv * dy + dw * dz, zero)
            friction = approach / ((r2 + floor) * (density[i] + density[j]))
            push = pressure_factor * (pressure[i] + pressure[j]) - viscosity_factor * friction
            push *= slope(pairs.one_minus_q[entry])
            fx, fy, fz = push * dx, push * dy, push * dz
            ax, ay, az = ax + fx, ay + fy, az + fz
            acceleration[0, j] -= fx
            acceleration[1, j] -= fy
            acceleration[2, j] -= fz
        acceleration[0, i], acceleration[1, i], acceleration[2, i] = ax, ay, az


@kernel
def farthest_from_common_motion(position: Any, listed: Any) -> float:
    """Largest displacement since the list was made, less the mean one [m].

    Parameters
    ----------
    position
        Positions [m], shape [3, at least count].
    listed
        Positions when the list was made [m], shape [3, count].
    """
    count = listed.shape[1]
    mean_x, mean_y, mean_z = 0.0, 0.0, 0.0
    for i in range(count):
        mean_x += position[0, i] - listed[0, i]
        mean_y += position[1, i] - listed[1, i]
        mean_z += position[2, i] - listed[2, i]
    mean_x, mean_y, mean_z = mean_x / count, mean_y / count, mean_z / count
    farthest = 0.0
    for i in range(count):
        dx = position[0, i] - listed[0, i] - mean_x
        dy = position[1, i] - listed[1, i] - mean_y
        dz = position[2, i] - listed[2, i] - mean_z
        farthest = max(farthest, dx * dx + dy * dy + dz * dz)
    return float(np.sqrt(farthest))


@allocating_kernel
def _permute(state: Any, order: Any) -> None:
    """Let the particle in place ``order[k]`` be in place k; lists of near solids are void."""
    size, count = state.density.size, len(order)
    for moved in (state.position, state.velocity):
        rows = moved.reshape(3, size)
        for axis in range(3):
            rows[axis, :count] = rows[axis][order]
    touched = state.touched.reshape(size)
    touched[:count] = touched[order]
    state.squared_slack[:] = -1.0


@allocating_kernel
def advance_one(
    state: Any, lanes: Any, solids: Any, cells: Any, step: float, steps: int, count: int
) -> None:
    """Move one simulation of many particles on by a number of steps.

    Parameters
    ----------
    state
        The particles, particle i in row i // 16, lane i % 16; changed in place.
    lanes
        Parameters, the same in every lane.
    solids, cells
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    count
        Number of particles; the slots beyond it are padding.
    """
    position = state.position.reshape(3, state.density.size)
    support = 1.0 / lanes.inverse_support[0]
    reach, allowed = (1.0 + SKIN) * support, 0.5 * SKIN * support
    # Neighbours in space become neighbours in memory, to be found in the cache.
    order = sort_into_cells(position, count, reach)[0]
    _permute(state, order)
    pairs = list_pairs(position, count, reach)
    listed = position[:, :count].copy()
    for _ in range(steps):
        if farthest_from_common_motion(position, listed) > allowed:
            pairs = list_pairs(position, count, reach)
            listed[:] = position[:, :count]
        start_density(state, lanes)
        add_listed_density(state, lanes, pairs)
        finish_density(state, lanes)
        add_listed_forces(state, lanes, pairs)
        integrate(state, lanes, step)
        collide_with_box(state, lanes)
        collide_with_polygons(state, lanes, solids, cells)
    _permute(state, np.argsort(order))
