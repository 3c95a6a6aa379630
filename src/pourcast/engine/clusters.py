"""SPH for one simulation of few particles: clusters of particles against their partners.

In lockstep (`sph`) a single simulation would leave all lanes but one empty. Here the lanes are
particles: a cluster is `LANES` of them that are near one another, and the sums of all of them run
over one list of partners, those near any of them (cluster pair lists: Pall & Hess 2013, Comput.
Phys. Commun. 184). Each pair is looked at from both sides, so that nobody's sum is touched by
another's.

A list holds its partners in the order of their numbers. So every particle's sum is taken in the
order in which lockstep takes it, and lacks only what is 0: the same bits.

Several threads can share a simulation, a team: each has clusters and rows of its own, and all wait
for one another where a phase of the step needs the whole of the last.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.equation_of_state import pressure_term
from pourcast.engine.integrator import integrate
from pourcast.engine.momentum import pair_push
from pourcast.engine.pairs import MARGIN, farthest_from, summed_motion
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
from pourcast.engine.smoothing import add_weight, dot, gradient, one_minus_q_of
from pourcast.engine.solids import grid_index
from pourcast.engine.state import vectors
from pourcast.engine.team import add_one, read, yield_processor
from pourcast.engine.walls import wall_density, wall_push

SKIN = 0.2
"""Extra reach of the lists, in support radii."""

PARTICLES_A_MEMBER = 150
"""Particles that a further thread takes to be worth its while."""

_LOOKS = 200
"""Looks for the others before the processor is left to them."""


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
    slope: NDArray[np.float32]
    """(1 - q)^3 of them, shape [cluster_count, particle_count, LANES]."""
    listed: NDArray[np.float32]
    """Positions when the lists were made [m], shape [3, cluster_count, LANES]."""
    low: NDArray[np.float32]
    """Least coordinates of each cluster's particles [m], shape [3, at least cluster_count]."""
    high: NDArray[np.float32]
    """Greatest ones; an entry without a cluster is infinitely far from all."""
    marked: NDArray[np.int64]
    """Room for a bit for each particle, 64 to an entry, for each thread of a team; 0 between calls,
    shape [members, at least particle_count / 64]."""
    arrived: NDArray[np.int64]
    """How often a thread of the team has come to where all wait, shape [1]."""


def most_members(count: int) -> int:
    """Threads for which there is work enough in a simulation of `count` particles.

    With fewer particles to each, they would wait for one another more than they compute.
    """
    return 1 + count // PARTICLES_A_MEMBER


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
        slope=vectors(rows, count),
        listed=vectors(3, rows),
        low=np.full((3, padded), np.inf, np.float32),
        high=np.full((3, padded), -np.inf, np.float32),
        marked=np.zeros((most_members(count), -(-count // 64)), np.int64),
        arrived=np.zeros(1, np.int64),
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
def list_partners(
    state: Any, parameters: Any, clusters: Any, member: int, begin: int, end: int
) -> None:
    """List partners of some clusters: what is within reach and skin of any of their particles.

    Parameters
    ----------
    state, parameters
        The particles and their parameters.
    clusters
        Their partners are written; boxes are around all of them.
    member
        Which thread of a team this is.
    begin, end
        Clusters ``begin:end`` are looked at.
    """
    position = state.position.reshape(3, state.density.size)
    x, y, z = position[0], position[1], position[2]
    order, marked = clusters.order, clusters.marked[member]
    reach = (1.0 + SKIN) / parameters.inverse_support[0]
    squared_reach = splat(reach * reach)
    for cluster in range(begin, end):
        _mark_near_clusters(clusters, marked, cluster, squared_reach)
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


@kernel
def bound(state: Any, clusters: Any, begin: int, end: int) -> None:
    """Put a box around the particles of clusters ``begin:end``; note where those rows are."""
    position = state.position.reshape(3, state.density.size)
    for cluster in range(begin, end):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(cluster * LANES, (cluster + 1) * LANES):
                along = position[axis, clusters.order[k]]
                low, high = min(low, along), max(high, along)
            clusters.low[axis, cluster], clusters.high[axis, cluster] = low, high
            store(clusters.listed[axis], cluster, load(state.position[axis], cluster))


@kernel
def _mark_near_clusters(clusters: Any, marked: Any, cluster: int, squared_reach: Any) -> None:
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
                    marked[particle >> 6] |= np.int64(1) << (particle & 63)


@kernel
def have_moved(state: Any, parameters: Any, clusters: Any) -> bool:
    """Whether two particles may have come nearer to each other by more than the skin.

    What all have moved in common is left out: a blob in free fall keeps its lists.
    """
    sum_x, sum_y, sum_z = summed_motion(state, clusters.listed)
    size = state.density.size
    mean_x, mean_y, mean_z = (
        splat(sum_lanes(sum_x) / size),
        splat(sum_lanes(sum_y) / size),
        splat(sum_lanes(sum_z) / size),
    )
    farthest = farthest_from(state, clusters.listed, mean_x, mean_y, mean_z)
    allowed = 0.5 * MARGIN * SKIN / parameters.inverse_support[0]
    return any_less(splat(allowed * allowed), farthest)


@kernel
def find_cluster_density(state: Any, parameters: Any, clusters: Any, begin: int, end: int) -> None:
    """Density over rest density, and pressure, of clusters ``begin:end``; notes who is near."""
    size = state.density.size
    position = state.position.reshape(3, size)
    density, pressure = state.density.reshape(size), state.pressure.reshape(size)
    x, y, z = position[0], position[1], position[2]
    order, partner, near_partner = clusters.order, clusters.partner, clusters.near_partner
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    scale = 1.0 / load(parameters.reference_density, 0)
    pressure_factor = load(parameters.pressure_factor, 0)
    least_pressure = load(parameters.least_pressure, 0)
    for cluster in range(begin, end):
        first, near_count = cluster * LANES, 0
        xi, yi, zi = gather(x, order, first), gather(y, order, first), gather(z, order, first)
        total = wall_density(xi, yi, zi, parameters)
        for k in range(clusters.partner_count[cluster]):
            j = np.uint64(partner[cluster, k])  # no test for an index below 0
            dx, dy, dz = xi - splat(x[j]), yi - splat(y[j]), zi - splat(z[j])
            near = one_minus_q_of(dot(dx, dy, dz, dx, dy, dz), inverse_support, zero)
            total = add_weight(total, near)
            near_partner[cluster, near_count] = partner[cluster, k]
            store(clusters.slope[cluster], near_count, gradient(near))
            near_count += any_less(zero, near)
        clusters.near_count[cluster] = near_count
        total = total * scale
        scatter(density, order, first, total)
        scatter(pressure, order, first, pressure_factor * pressure_term(total, least_pressure))


@kernel
def find_cluster_forces(state: Any, parameters: Any, clusters: Any, begin: int, end: int) -> None:
    """Acceleration of clusters ``begin:end`` by the walls and by the partners that are near."""
    size = state.density.size
    position, velocity = state.position.reshape(3, size), state.velocity.reshape(3, size)
    acceleration = state.acceleration.reshape(3, size)
    density, pressure = state.density.reshape(size), state.pressure.reshape(size)
    x, y, z = position[0], position[1], position[2]
    u, v, w = velocity[0], velocity[1], velocity[2]
    order, near_partner = clusters.order, clusters.near_partner
    viscosity_factor = load(parameters.viscosity_factor, 0)
    separation_floor = load(parameters.separation_floor, 0)
    fastest_parting = load(parameters.fastest_parting, 0)
    cohesion_factor = load(parameters.cohesion_factor, 0)
    neutral_slope = load(parameters.neutral_slope, 0)
    for cluster in range(begin, end):
        first = cluster * LANES
        xi, yi, zi = gather(x, order, first), gather(y, order, first), gather(z, order, first)
        ui, vi, wi = gather(u, order, first), gather(v, order, first), gather(w, order, first)
        density_i, pressure_i = gather(density, order, first), gather(pressure, order, first)
        axi, ayi, azi = wall_push(pressure_i, xi, yi, zi, parameters)
        for k in range(clusters.near_count[cluster]):
            j = np.uint64(near_partner[cluster, k])
            dx, dy, dz = xi - splat(x[j]), yi - splat(y[j]), zi - splat(z[j])
            du, dv, dw = ui - splat(u[j]), vi - splat(v[j]), wi - splat(w[j])
            push = pair_push(
                dx, dy, dz, du, dv, dw, load(clusters.slope[cluster], k),
                density_i + splat(density[j]), pressure_i + splat(pressure[j]),
                viscosity_factor, separation_floor, fastest_parting, cohesion_factor, neutral_slope,
            )  # fmt: skip
            axi, ayi, azi = fma(push, dx, axi), fma(push, dy, ayi), fma(push, dz, azi)
        scatter(acceleration[0], order, first, axi)
        scatter(acceleration[1], order, first, ayi)
        scatter(acceleration[2], order, first, azi)


@kernel
def find_density(state: Any, parameters: Any, clusters: Any) -> None:
    """Density of one simulation, over that at rest."""
    count = len(clusters.partner_count)
    sort_along_curve(state, clusters, parameters.radius[0])
    bound(state, clusters, 0, count)
    list_partners(state, parameters, clusters, 0, 0, count)
    find_cluster_density(state, parameters, clusters, 0, count)


@kernel
def advance_one(
    state: Any,
    parameters: Any,
    solids: Any,
    broad_phase: Any,
    step: float,
    steps: int,
    clusters: Any,
    member: int,
    members: int,
) -> None:
    """Move one simulation on by a number of steps; each thread of a team calls it.

    Parameters
    ----------
    state
        The particles, particle i in row i // LANES, lane i % LANES; changed in place. Slots
        beyond the last particle hold copies of it. Threads of a team share it, but for
        `squared_top_speed`.
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
    member, members
        Which thread of the team this is, and how many there are: 0 and 1 alone. `arrived` must
        be 0 before the first of them calls.
    """
    arrived, count = clusters.arrived, len(clusters.partner_count)
    begin, end = count * member // members, count * (member + 1) // members
    if member == 0:
        sort_along_curve(state, clusters, parameters.radius[0])
    meetings, stale = 0, True
    for _ in range(steps):
        stale = stale or have_moved(state, parameters, clusters)
        if stale:
            meetings = meet(arrived, members, meetings)
            bound(state, clusters, begin, end)
            meetings = meet(arrived, members, meetings)
            list_partners(state, parameters, clusters, member, begin, end)
            stale = False
        find_cluster_density(state, parameters, clusters, begin, end)
        meetings = meet(arrived, members, meetings)
        find_cluster_forces(state, parameters, clusters, begin, end)
        meetings = meet(arrived, members, meetings)
        integrate(state, parameters, step, begin, end)
        collide_with_box(state, parameters, begin, end)
        collide_with_polygons(state, parameters, solids, broad_phase, begin, end)
        meetings = meet(arrived, members, meetings)


@kernel
def meet(arrived: Any, members: int, meetings: int) -> int:
    """Wait until all threads of a team have come here; returns how often they have met by then.

    They wait by looking again and again, for another thread is there within microseconds; where
    it isn't running, the processor is left to it.
    """
    if members == 1:
        return 0
    meetings += 1
    add_one(arrived)
    looks = 0
    while read(arrived) < meetings * members:
        looks += 1
        if looks % _LOOKS == 0:
            yield_processor()
    return meetings
