"""SPH for one large simulation: sums over a neighbour list instead of all pairs.

A Verlet list holds every pair closer than the support radius plus a skin, and
is rebuilt from a grid of cells once a particle has moved half the skin, the
motion that all have in common left out: a blob in free fall keeps its list.
The physics is that of `sph`; only the pair loops differ.
"""

from typing import Any

import numpy as np

from pourcast.engine.compile import allocating_kernel, kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.kernel import shape, slope
from pourcast.engine.sph import finish_density, integrate, start_density

ALL_PAIRS_LIMIT = 300
"""Above this number of particles the neighbour list takes over."""

SKIN = 0.2
"""Extra reach of the list, in support radii."""


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
    start, partner
        The partners j < i of particle i are ``partner[start[i]:start[i + 1]]``.
    """
    low = np.empty(3)
    shape_of_grid = np.empty(3, np.int64)
    for axis in range(3):
        low[axis] = position[axis, :count].min()
        extent = position[axis, :count].max() - low[axis]
        shape_of_grid[axis] = int(extent / reach) + 1
    nx, ny, nz = shape_of_grid
    cell = np.empty((count, 3), np.int64)
    first = np.zeros(nx * ny * nz + 1, np.int64)
    for i in range(count):
        for axis in range(3):
            cell[i, axis] = int((position[axis, i] - low[axis]) / reach)
        first[(cell[i, 0] * ny + cell[i, 1]) * nz + cell[i, 2] + 1] += 1
    first = np.cumsum(first)
    place = first.copy()
    member = np.empty(count, np.int64)
    for i in range(count):
        index = (cell[i, 0] * ny + cell[i, 1]) * nz + cell[i, 2]
        member[place[index]] = i
        place[index] += 1
    start = np.zeros(count + 1, np.int64)
    partner = np.empty(64 * count, np.int64)
    found = 0
    for i in range(count):
        for cx in range(max(cell[i, 0] - 1, 0), min(cell[i, 0] + 2, nx)):
            for cy in range(max(cell[i, 1] - 1, 0), min(cell[i, 1] + 2, ny)):
                cz0, cz1 = max(cell[i, 2] - 1, 0), min(cell[i, 2] + 2, nz)
                line = (cx * ny + cy) * nz
                for k in range(first[line + cz0], first[line + cz1]):
                    j = member[k]
                    if j >= i:
                        continue
                    dx = position[0, i] - position[0, j]
                    dy = position[1, i] - position[1, j]
                    dz = position[2, i] - position[2, j]
                    if dx * dx + dy * dy + dz * dz >= reach * reach:
                        continue
                    if found == len(partner):
                        longer = np.empty(2 * found, np.int64)
                        longer[:found] = partner
                        partner = longer
                    partner[found] = j
                    found += 1
        start[i + 1] = found
    return start, partner[:found].copy()


@kernel
def add_listed_density(state: Any, lanes: Any, start: Any, partner: Any) -> None:
    """Kernel sum over the listed pairs."""
    position = state.position.reshape(3, state.density.size)
    density = state.density.reshape(state.density.size)
    inverse_support = lanes.inverse_support[0]
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(len(start) - 1):
        total = density[i]
        for k in range(start[i], start[i + 1]):
            j = partner[k]
            dx = position[0, i] - position[0, j]
            dy = position[1, i] - position[1, j]
            dz = position[2, i] - position[2, j]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            share = np.float32(shape(max(one - distance * inverse_support, zero)))
            total += share
            density[j] += share
        density[i] = total


@kernel
def add_listed_forces(state: Any, lanes: Any, start: Any, partner: Any) -> None:
    """Pressure and artificial viscosity over the listed pairs."""
    size = state.density.size
    position, velocity = state.position.reshape(3, size), state.velocity.reshape(3, size)
    acceleration = state.acceleration.reshape(3, size)
    density, pressure = state.density.reshape(size), state.pressure.reshape(size)
    inverse_support, pressure_factor = lanes.inverse_support[0], lanes.pressure_factor[0]
    viscosity_factor, floor = lanes.viscosity_factor[0], lanes.separation_floor[0]
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(len(start) - 1):
        for k in range(start[i], start[i + 1]):
            j = partner[k]
            dx = position[0, i] - position[0, j]
            dy = position[1, i] - position[1, j]
            dz = position[2, i] - position[2, j]
            r2 = dx * dx + dy * dy + dz * dz
            near = max(one - np.sqrt(r2) * inverse_support, zero)
            if near == zero:
                continue
            approach = (
                dx * (velocity[0, i] - velocity[0, j])
                + dy * (velocity[1, i] - velocity[1, j])
                + dz * (velocity[2, i] - velocity[2, j])
            )
            friction = min(approach, zero) / ((r2 + floor) * (density[i] + density[j]))
            push = pressure_factor * (pressure[i] + pressure[j]) - viscosity_factor * friction
            push *= slope(near)
            acceleration[0, i] += push * dx
            acceleration[1, i] += push * dy
            acceleration[2, i] += push * dz
            acceleration[0, j] -= push * dx
            acceleration[1, j] -= push * dy
            acceleration[2, j] -= push * dz


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
    start, partner = list_pairs(position, count, reach)
    listed = position[:, :count].copy()
    for _ in range(steps):
        if farthest_from_common_motion(position, listed) > allowed:
            start, partner = list_pairs(position, count, reach)
            listed[:] = position[:, :count]
        start_density(state, lanes)
        add_listed_density(state, lanes, start, partner)
        finish_density(state, lanes)
        add_listed_forces(state, lanes, start, partner)
        integrate(state, lanes, step)
        collide_with_box(state, lanes)
        collide_with_polygons(state, lanes, solids, cells)
