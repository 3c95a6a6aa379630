"""SPH for one simulation of few particles: clusters of particles against their partners.

In lockstep (`sph`) a single simulation would leave all lanes but one empty. Here the lanes are
particles: a cluster is `LANES` of them that are near one another, and the sums of all of them run
over one list of partners, those near any of them (cluster pair lists: Pall & Hess 2013, Comput.
Phys. Commun. 184). Each pair is looked at from both sides, so that nobody's sum is touched by
another's.

A list holds its partners in the order of their numbers. So every particle's sum is taken in the
order in which lockstep takes it, and lacks only what is 0: the same bits.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.density import divide_by_rest_density, start_density
from pourcast.engine.integrator import integrate
from pourcast.engine.momentum import pair_push, start_forces
from pourcast.engine.simd import (
    LANES,
    any_less,
    bits_less,
    fma,
    gather,
    load,
    load_from,
    lowest_bit,
    maximum,
    scatter,
    splat,
    store,
    sum_lanes,
)
from pourcast.engine.smoothing import dot, one_minus_q_of, weight
from pourcast.engine.solids import grid_index

SKIN = 0.2
"""Extra reach of the lists, in support radii."""

_MARGIN = 0.999
"""Share of the skin that may be used up, for rounding errors."""


class Clusters(NamedTuple):
    """Clusters of the particles of one simulation, and the partners of each."""

    order: NDArray[np.int32]
    """Particles, cluster by cluster, shape [cluster_count * LANES]."""
    key: NDArray[np.int64]
    """What they are sorted by: where each is on a curve that fills space, same shape."""
    partner_count: NDArray[np.int64]
    """Number of partners of each cluster, shape [cluster_count]."""
    partner: NDArray[np.int32]
    """Partners, in the order of their numbers, shape [cluster_count, particle_count]."""
    near_count: NDArray[np.int64]
    """Number of partners within the support radius of any particle of the cluster."""
    near_partner: NDArray[np.int32]
    """Those, when the density was last summed, shape [cluster_count, particle_count]."""
    listed: NDArray[np.float32]
    """Positions when the lists were made [m], shape [3, cluster_count, LANES]."""
    low: NDArray[np.float32]
    """Least coordinates of each cluster's particles [m], shape [3, at least cluster_count]."""
    high: NDArray[np.float32]
    """Greatest ones; an entry without a cluster is infinitely far from all."""
    marked: NDArray[np.int64]
    """Room for a bit for each particle, 64 to an entry; 0 between calls."""


def empty_clusters(count: int) -> Clusters:
    """Clusters of `count` particles, in the order of their numbers, without partners."""
    rows = -(-count // LANES)
    padded = -(-rows // LANES) * LANES
    return Clusters(
        order=np.arange(rows * LANES, dtype=np.int32),
        key=np.zeros(rows * LANES, np.int64),
        partner_count=np.zeros(rows, np.int64),
        partner=np.zeros((rows, count), np.int32),
        near_count=np.zeros(rows, np.int64),
        near_partner=np.zeros((rows, count), np.int32),
        listed=np.zeros((3, rows, LANES), np.float32),
        low=np.full((3, padded), np.inf, np.float32),
        high=np.full((3, padded), -np.inf, np.float32),
        marked=np.zeros(-(-count // 64), np.int64),
    )


@kernel
def sort_along_curve(state: Any, clusters: Any, cell: float) -> None:
    """Sort particles along a Morton curve, on which what is near in space is mostly near.

    Parameters
    ----------
    state
        The particles.
    clusters
        Their order is written; that of the last call is a good start.
    cell
        Edge of the cells that the curve runs through [m].
    """
    position = state.position.reshape(3, state.density.size)
    order, key = clusters.order, clusters.key
    for i in range(len(order)):
        key[i] = (
            _spread(position[0, order[i]] / cell)
            | (_spread(position[1, order[i]] / cell) << 1)
            | (_spread(position[2, order[i]] / cell) << 2)
        )
    # Insertion: few have changed their place since the last frame.
    for i in range(1, len(order)):
        moving, particle = key[i], order[i]
        k = i
        while k > 0 and key[k - 1] > moving:
            key[k], order[k] = key[k - 1], order[k - 1]
            k -= 1
        key[k], order[k] = moving, particle


@kernel
def _spread(along: float) -> int:
    """The ten bits of a cell's number along an axis, two places apart."""
    bits = grid_index(along, 1024)
    bits = (bits | (bits << 16)) & 0x030000FF
    bits = (bits | (bits << 8)) & 0x0300F00F
    bits = (bits | (bits << 4)) & 0x030C30C3
    return (bits | (bits << 2)) & 0x09249249


@kernel
def list_partners(state: Any, parameters: Any, clusters: Any) -> None:
    """List each cluster's partners: what is within reach and skin of any of its particles."""
    position = state.position.reshape(3, state.density.size)
    x, y, z = position[0], position[1], position[2]
    order, marked = clusters.order, clusters.marked
    reach = (1.0 + SKIN) / parameters.inverse_support[0]
    squared_reach = splat(reach * reach)
    _bound(position, clusters)
    for cluster in range(len(clusters.partner_count)):
        _mark_near_clusters(clusters, cluster, squared_reach)
        first, count = cluster * LANES, 0
        xi, yi, zi = gather(x, order, first), gather(y, order, first), gather(z, order, first)
        for word in range(len(marked)):
            bits, marked[word] = marked[word], 0
            while bits != 0:
                j = 64 * word + lowest_bit(bits)
                bits &= bits - 1
                dx, dy, dz = xi - splat(x[j]), yi - splat(y[j]), zi - splat(z[j])
                clusters.partner[cluster, count] = j
                count += any_less(dot(dx, dy, dz, dx, dy, dz), squared_reach)
        clusters.partner_count[cluster] = count
    for axis in range(3):
        for row in range(state.density.shape[0]):
            store(clusters.listed[axis], row, load(state.position[axis], row))


@kernel
def _bound(position: Any, clusters: Any) -> None:
    """Put a box around the particles of each cluster."""
    for cluster in range(len(clusters.partner_count)):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(cluster * LANES, (cluster + 1) * LANES):
                along = position[axis, clusters.order[k]]
                low, high = min(low, along), max(high, along)
            clusters.low[axis, cluster], clusters.high[axis, cluster] = low, high


@kernel
def _mark_near_clusters(clusters: Any, cluster: int, squared_reach: Any) -> None:
    """Mark the particles of all clusters whose boxes are within reach of a cluster's."""
    count, zero = clusters.partner.shape[1], splat(0.0)
    for first in range(0, len(clusters.partner_count), LANES):
        squared_gap = zero
        for axis in range(3):
            below = clusters.low[axis, cluster] - load_from(clusters.high[axis], first)
            above = load_from(clusters.low[axis], first) - clusters.high[axis, cluster]
            gap = maximum(maximum(below, above), zero)
            squared_gap = fma(gap, gap, squared_gap)
        bits = bits_less(squared_gap, squared_reach)
        while bits != 0:
            near = first + lowest_bit(bits)
            bits &= bits - 1
            for k in range(near * LANES, (near + 1) * LANES):
                if clusters.order[k] < count:
                    particle = np.int64(clusters.order[k])
                    clusters.marked[particle >> 6] |= np.int64(1) << (particle & 63)


@kernel
def have_moved(state: Any, parameters: Any, clusters: Any) -> bool:
    """Whether two particles may have come nearer to each other by more than the skin.

    What all have moved in common is left out: a blob in free fall keeps its lists.
    """
    rows, size = state.density.shape[0], state.density.size
    sum_x, sum_y, sum_z = splat(0.0), splat(0.0), splat(0.0)
    for row in range(rows):
        moved_x, moved_y, moved_z = _moved(state, clusters, row)
        sum_x, sum_y, sum_z = sum_x + moved_x, sum_y + moved_y, sum_z + moved_z
    mean_x, mean_y, mean_z = (
        splat(sum_lanes(sum_x) / size),
        splat(sum_lanes(sum_y) / size),
        splat(sum_lanes(sum_z) / size),
    )
    farthest = splat(0.0)
    for row in range(rows):
        moved_x, moved_y, moved_z = _moved(state, clusters, row)
        dx, dy, dz = moved_x - mean_x, moved_y - mean_y, moved_z - mean_z
        farthest = maximum(farthest, dot(dx, dy, dz, dx, dy, dz))
    allowed = _MARGIN * 0.5 * SKIN / parameters.inverse_support[0]
    return any_less(splat(allowed * allowed), farthest)


@kernel
def _moved(state: Any, clusters: Any, row: int) -> Any:
    """Displacements of a row's particles since the lists were made [m]."""
    return (
        load(state.position[0], row) - load(clusters.listed[0], row),
        load(state.position[1], row) - load(clusters.listed[1], row),
        load(state.position[2], row) - load(clusters.listed[2], row),
    )


@kernel
def add_cluster_density(state: Any, parameters: Any, clusters: Any) -> None:
    """Add the weights of its partners and its own to each particle's density; note who is near."""
    size = state.density.size
    position, density = state.position.reshape(3, size), state.density.reshape(size)
    x, y, z = position[0], position[1], position[2]
    order, partner, near_partner = clusters.order, clusters.partner, clusters.near_partner
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    for cluster in range(len(clusters.partner_count)):
        first, near_count = cluster * LANES, 0
        xi, yi, zi = gather(x, order, first), gather(y, order, first), gather(z, order, first)
        total = gather(density, order, first)
        for k in range(clusters.partner_count[cluster]):
            j = partner[cluster, k]
            dx, dy, dz = xi - splat(x[j]), yi - splat(y[j]), zi - splat(z[j])
            near = one_minus_q_of(dot(dx, dy, dz, dx, dy, dz), inverse_support, zero)
            total = total + weight(near)
            near_partner[cluster, near_count] = j
            near_count += any_less(zero, near)
        clusters.near_count[cluster] = near_count
        scatter(density, order, first, total)


@kernel
def add_cluster_forces(state: Any, parameters: Any, clusters: Any) -> None:
    """Pressure and artificial viscosity by the partners that are near."""
    size = state.density.size
    position, velocity = state.position.reshape(3, size), state.velocity.reshape(3, size)
    acceleration = state.acceleration.reshape(3, size)
    density, pressure = state.density.reshape(size), state.pressure.reshape(size)
    x, y, z = position[0], position[1], position[2]
    u, v, w = velocity[0], velocity[1], velocity[2]
    ax, ay, az = acceleration[0], acceleration[1], acceleration[2]
    order, near_partner = clusters.order, clusters.near_partner
    inverse_support = load(parameters.inverse_support, 0)
    pressure_factor = load(parameters.pressure_factor, 0)
    viscosity_factor = load(parameters.viscosity_factor, 0)
    separation_floor = load(parameters.separation_floor, 0)
    for cluster in range(len(clusters.near_count)):
        first = cluster * LANES
        xi, yi, zi = gather(x, order, first), gather(y, order, first), gather(z, order, first)
        ui, vi, wi = gather(u, order, first), gather(v, order, first), gather(w, order, first)
        density_i, pressure_i = gather(density, order, first), gather(pressure, order, first)
        axi, ayi, azi = gather(ax, order, first), gather(ay, order, first), gather(az, order, first)
        for k in range(clusters.near_count[cluster]):
            j = near_partner[cluster, k]
            dx, dy, dz = xi - splat(x[j]), yi - splat(y[j]), zi - splat(z[j])
            du, dv, dw = ui - splat(u[j]), vi - splat(v[j]), wi - splat(w[j])
            push = pair_push(
                dx, dy, dz, du, dv, dw,
                density_i + splat(density[j]), pressure_i + splat(pressure[j]),
                inverse_support, pressure_factor, viscosity_factor, separation_floor,
            )  # fmt: skip
            axi, ayi, azi = fma(push, dx, axi), fma(push, dy, ayi), fma(push, dz, azi)
        scatter(ax, order, first, axi)
        scatter(ay, order, first, ayi)
        scatter(az, order, first, azi)


@kernel
def find_density(state: Any, parameters: Any, clusters: Any) -> None:
    """Density of one simulation, over that at rest."""
    sort_along_curve(state, clusters, parameters.radius[0])
    list_partners(state, parameters, clusters)
    start_density(state, parameters)
    add_cluster_density(state, parameters, clusters)
    divide_by_rest_density(state, parameters)


@kernel
def advance_one(
    state: Any,
    parameters: Any,
    solids: Any,
    broad_phase: Any,
    step: float,
    steps: int,
    clusters: Any,
) -> None:
    """Move one simulation on by a number of steps.

    Parameters
    ----------
    state
        The particles, particle i in row i // LANES, lane i % LANES; changed in place. Slots
        beyond the last particle hold copies of it.
    parameters
        Parameters, the same in every lane.
    solids, broad_phase
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    clusters
        Clusters of the particles; made anew.
    """
    sort_along_curve(state, clusters, parameters.radius[0])
    list_partners(state, parameters, clusters)
    for _ in range(steps):
        if have_moved(state, parameters, clusters):
            list_partners(state, parameters, clusters)
        start_density(state, parameters)
        add_cluster_density(state, parameters, clusters)
        divide_by_rest_density(state, parameters)
        start_forces(state, parameters)
        add_cluster_forces(state, parameters, clusters)
        integrate(state, parameters, step)
        collide_with_box(state, parameters)
        collide_with_polygons(state, parameters, solids, broad_phase)
