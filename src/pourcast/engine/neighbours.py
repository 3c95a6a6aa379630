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
from pourcast.engine.density import divide_by_rest_density, start_density
from pourcast.engine.integrator import integrate
from pourcast.engine.momentum import pair_push, start_forces
from pourcast.engine.simd import (
    LANES,
    append_less,
    first_lanes,
    fma,
    fnma,
    gather,
    load,
    load_from,
    scatter,
    splat,
    sum_lanes,
)
from pourcast.engine.smoothing import dot, one_minus_q_of, weight
from pourcast.engine.solids import grid_index

ALL_PAIRS_LIMIT = 300
"""Above this number of particles the neighbour list takes over. There, one simulation by
the list takes as long as 16 in lockstep take, divided by 16."""

LAYERS = 4
"""Cells within one reach along z. Across it there is one: what lies in a row of cells along z is
looked at in vectors of 16, and more rows would leave more of them half empty."""

MOST_CELLS = 1024
"""Along each axis; what lies beyond is in the last of them, so that a particle that is far off in
a broken simulation takes no memory."""

SKIN = 0.25
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
        Edge of a cell in x and y [m]; in z there are `LAYERS` in it.

    Returns
    -------
    order, first, grid
        The particles in cell c are ``order[first[c]:first[c + 1]]``, where the cell at
        column x, row y, layer z of a grid of ``grid`` cells is
        ``c = (x * grid[1] + y) * grid[2] + z``.
    """
    low, grid = np.empty(3), np.empty(3, np.int64)
    sizes = np.array([size, size, size / LAYERS])
    for axis in range(3):
        low[axis] = position[axis, :count].min()
        extent = position[axis, :count].max() - low[axis]
        grid[axis] = grid_index(extent / sizes[axis], MOST_CELLS) + 1
    cell = np.empty(count, np.int64)
    first = np.zeros(grid[0] * grid[1] * grid[2] + 1, np.int64)
    for i in range(count):
        index = 0
        for axis in range(3):
            along = grid_index((position[axis, i] - low[axis]) / sizes[axis], grid[axis])
            index = index * grid[axis] + along
        cell[i] = index
        first[index + 1] += 1
    first = np.cumsum(first)
    next_free, order = first.copy(), np.empty(count, np.int64)
    for i in range(count):
        order[next_free[cell[i]]] = i
        next_free[cell[i]] += 1
    return order, first, grid


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
    order, first, grid = sort_into_cells(position, count, reach)
    # With room for a whole vector at the end of each array.
    particle = np.zeros(count + LANES, np.int32)
    sorted_position = np.zeros((3, count + LANES), position.dtype)
    for k in range(count):
        particle[k] = order[k]
        for axis in range(3):
            sorted_position[axis, k] = position[axis, order[k]]
    start = np.zeros(count + 1, np.int64)
    partner = np.empty(40 * count + LANES, np.int32)
    pair_count = 0
    for cx, cy, cz in np.ndindex(grid[0], grid[1], grid[2]):
        cell = (cx * grid[1] + cy) * grid[2] + cz
        for k in range(first[cell], first[cell + 1]):
            if pair_count + count + LANES > len(partner):
                longer = np.empty(2 * len(partner) + count, np.int32)
                longer[:pair_count] = partner[:pair_count]
                partner = longer
            # Earlier in the order: in the columns before, and in this one up to the particle.
            for nx in range(max(cx - 1, 0), cx + 1):
                for ny in range(max(cy - 1, 0), min(cy + 2, grid[1])):
                    line = (nx * grid[1] + ny) * grid[2]
                    begin = first[line + max(cz - LAYERS, 0)]
                    end = min(first[line + min(cz + LAYERS + 1, grid[2])], k)
                    pair_count = _append_near(
                        sorted_position, particle, k, begin, end, reach, partner, pair_count
                    )
            start[k + 1] = pair_count
    partner[pair_count : pair_count + LANES] = 0
    return Pairs(
        order,
        start,
        partner,
        np.zeros(count + 1, np.int64),
        np.zeros(pair_count + LANES, np.int32),
    )


@kernel
def _append_near(
    sorted_position: Any,
    particle: Any,
    k: int,
    begin: int,
    end: int,
    reach: float,
    partner: Any,
    pair_count: int,
) -> int:
    """Add what is within reach of the k-th of a range; returns how many there are by then."""
    x, y, z = (
        splat(sorted_position[0, k]),
        splat(sorted_position[1, k]),
        splat(sorted_position[2, k]),
    )
    squared_reach = splat(reach * reach)
    for m in range(begin, end, LANES):
        dx = x - load_from(sorted_position[0], m)
        dy = y - load_from(sorted_position[1], m)
        dz = z - load_from(sorted_position[2], m)
        r2 = dot(dx, dy, dz, dx, dy, dz)
        pair_count += append_less(r2, squared_reach, particle, m, end - m, partner, pair_count)
    return pair_count


@kernel
def add_listed_density(state: Any, parameters: Any, pairs: Any) -> None:
    """Kernel sum over the listed pairs; notes which of them are near."""
    size = state.density.size
    position = state.position.reshape(3, size)
    x, y, z = position[0], position[1], position[2]
    density = state.density.reshape(size)
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    squared_support = 1.0 / (inverse_support * inverse_support)
    near_count = 0
    for k in range(len(pairs.order)):
        i = pairs.order[k]
        xi, yi, zi, total = splat(x[i]), splat(y[i]), splat(z[i]), splat(0.0)
        for first in range(pairs.start[k], pairs.start[k + 1], LANES):
            count = pairs.start[k + 1] - first
            dx, dy, dz = (
                xi - gather(x, pairs.partner, first),
                yi - gather(y, pairs.partner, first),
                zi - gather(z, pairs.partner, first),
            )
            r2 = dot(dx, dy, dz, dx, dy, dz)
            share = first_lanes(weight(one_minus_q_of(r2, inverse_support, zero)), count)
            total = total + share
            scatter(
                density, pairs.partner, first, count, gather(density, pairs.partner, first) + share
            )
            near_count += append_less(
                r2, squared_support, pairs.partner, first, count, pairs.near_partner, near_count
            )
        density[i] += sum_lanes(total) + 1.0
        pairs.near_start[k + 1] = near_count


@allocating_kernel
def find_density(state: Any, parameters: Any, count: int) -> None:
    """Density of one simulation of many particles, over that at rest."""
    position = state.position.reshape(3, state.density.size)
    pairs = list_pairs(position, count, 1.0 / parameters.inverse_support[0])
    start_density(state, parameters)
    add_listed_density(state, parameters, pairs)
    divide_by_rest_density(state, parameters)


@kernel
def add_listed_forces(state: Any, parameters: Any, pairs: Any) -> None:
    """Pressure and artificial viscosity over the near pairs."""
    size = state.density.size
    position = state.position.reshape(3, size)
    x, y, z = position[0], position[1], position[2]
    velocity = state.velocity.reshape(3, size)
    u, v, w = velocity[0], velocity[1], velocity[2]
    acceleration = state.acceleration.reshape(3, size)
    ax, ay, az = acceleration[0], acceleration[1], acceleration[2]
    density, pressure = state.density.reshape(size), state.pressure.reshape(size)
    zero, inverse_support = splat(0.0), load(parameters.inverse_support, 0)
    pressure_factor = load(parameters.pressure_factor, 0)
    viscosity_factor = load(parameters.viscosity_factor, 0)
    separation_floor = load(parameters.separation_floor, 0)
    near = pairs.near_partner
    for k in range(len(pairs.order)):
        i = pairs.order[k]
        xi, yi, zi = splat(x[i]), splat(y[i]), splat(z[i])
        ui, vi, wi = splat(u[i]), splat(v[i]), splat(w[i])
        density_i, pressure_i = splat(density[i]), splat(pressure[i])
        axi, ayi, azi = zero, zero, zero
        for first in range(pairs.near_start[k], pairs.near_start[k + 1], LANES):
            count = pairs.near_start[k + 1] - first
            dx, dy, dz = (
                xi - gather(x, near, first),
                yi - gather(y, near, first),
                zi - gather(z, near, first),
            )
            du, dv, dw = (
                ui - gather(u, near, first),
                vi - gather(v, near, first),
                wi - gather(w, near, first),
            )
            densities = density_i + gather(density, near, first)
            pressures = pressure_i + gather(pressure, near, first)
            push = pair_push(
                dx, dy, dz, du, dv, dw, densities, pressures,
                inverse_support, pressure_factor, viscosity_factor, separation_floor,
            )  # fmt: skip
            push = first_lanes(push, count)
            axi, ayi, azi = fma(push, dx, axi), fma(push, dy, ayi), fma(push, dz, azi)
            scatter(ax, near, first, count, fnma(push, dx, gather(ax, near, first)))
            scatter(ay, near, first, count, fnma(push, dy, gather(ay, near, first)))
            scatter(az, near, first, count, fnma(push, dz, gather(az, near, first)))
        ax[i] += sum_lanes(axi)
        ay[i] += sum_lanes(ayi)
        az[i] += sum_lanes(azi)


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
    """Move the particle at ``order[k]`` to k; lists of near solids are void."""
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
    state: Any, parameters: Any, solids: Any, broad_phase: Any, step: float, steps: int, count: int
) -> None:
    """Move one simulation of many particles on by a number of steps.

    Parameters
    ----------
    state
        The particles, particle i in row i // 16, lane i % 16; changed in place.
    parameters
        Parameters, the same in every lane.
    solids, broad_phase
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    count
        Number of particles; the slots beyond it are padding.
    """
    position = state.position.reshape(3, state.density.size)
    support = 1.0 / parameters.inverse_support[0]
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
        start_density(state, parameters)
        add_listed_density(state, parameters, pairs)
        divide_by_rest_density(state, parameters)
        start_forces(state, parameters)
        add_listed_forces(state, parameters, pairs)
        integrate(state, parameters, step)
        collide_with_box(state, parameters)
        collide_with_polygons(state, parameters, solids, broad_phase)
    _permute(state, np.argsort(order))
