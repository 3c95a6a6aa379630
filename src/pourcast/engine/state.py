"""Arrays that the kernels work on: the state of a block and the parameters of its lanes.

The last axis of every array has `simd.LANES` values. A block holds either
so many simulations of N particles in lockstep (row = particle, lane = simulation)
or one simulation (row * LANES + lane = particle). Everything that happens
to a particle by itself is the same code in both.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.simd import LANES

Floats = NDArray[np.float32]

NEAR_POLYGONS = 4
"""Polygons that a sphere's list has room for."""

NEAR_EDGES = 3
"""Edges by which a polygon is listed."""


class State(NamedTuple):
    """Particles of a block; `row_count` rows of `LANES`."""

    position: Floats
    """Particle positions [m], shape [3, row_count, LANES]."""
    velocity: Floats
    """Particle velocities [m/s], shape [3, row_count, LANES]."""
    acceleration: Floats
    """Accelerations by pressure and viscosity [m/s^2], shape [3, row_count, LANES]."""
    density: Floats
    """Density over rest density, shape [row_count, LANES]."""
    pressure: Floats
    """Pressure's part of the momentum equation, p / rho^2, times that of grad W [1/s^2]."""
    squared_top_speed: Floats
    """Square of the greatest speed that a particle of each lane has had since this was last set
    to 0, before contact [m^2/s^2], shape [LANES]."""
    previous: Floats
    """x and y before the last step [m], shape [2, row_count, LANES]."""
    touched: Floats
    """1 if a particle ever met an obstacle, else 0; shape [row_count, LANES]."""
    listed_at: Floats
    """x and y where a particle's list of near solids was made [m], shape [2, row_count, LANES]."""
    squared_slack: Floats
    """Square of the distance that it may move from there before the list is old [m^2]."""
    near_count: Floats
    """Number of polygons in the list, shape [row_count, LANES]."""
    most_near: NDArray[np.int64]
    """Greatest `near_count` of each row, shape [row_count]."""
    near_edges: Floats
    """Edges of the listed polygons: start x and y [m], outward normal x and y, length [m];
    shape [NEAR_POLYGONS * NEAR_EDGES, 5, row_count, LANES]."""
    near_distance: Floats
    """Distance of each listed polygon when it was listed [m], [NEAR_POLYGONS, row_count, LANES]."""
    near_is_obstacle: Floats
    """1 for an obstacle, 0 for a part of the goal, shape [NEAR_POLYGONS, row_count, LANES]."""


class LaneParameters(NamedTuple):
    """Parameters of the lanes of a block, each of shape [LANES]."""

    scene: NDArray[np.int64]
    """Index of the scene whose polygons are met; -1 for an empty lane."""
    width: Floats
    depth: Floats
    ceiling: Floats
    """Height of the lid [m]; infinite for an open box."""
    radius: Floats
    """Contact radius of the particles [m]."""
    inverse_support: Floats
    """1 / support radius [1/m]."""
    reference_density: Floats
    """Kernel sum that counts as rest density (`packing`)."""
    pressure_factor: Floats
    """20 c^2 / (H^2 reference density) [1/s^2]."""
    viscosity_factor: Floats
    """Artificial viscosity's factor, see `sph` [m^2/s^2 / m^2 * m * m/s]."""
    separation_floor: Floats
    """0.01 h^2 [m^2], keeps the viscosity finite for touching particles."""
    least_pressure: Floats
    """Least pressure over c^2 rho0: minus the tension."""
    fastest_parting: Floats
    """Most that viscosity sees of v_ij . r_ij [m^2/s]: 0 if it acts on approaching pairs only,
    infinite if on all."""
    cohesion_factor: Floats
    """Factor k of cohesion [1/s^2]."""
    neutral_slope: Floats
    """(1 - q)^3 at the distance at which a pair neither attracts nor repels."""
    touch: Floats
    """Distance of a centre from a solid within which the particle touches it [m]."""
    gravity: Floats
    damping: Floats
    keep_normal: Floats
    """Share of the normal speed that adhesion leaves after one step."""
    keep_tangential: Floats


def vectors(*shape: int, value: float = 0.0) -> Floats:
    """Array [..., LANES] of a value, each vector of it in one line of the processor's cache.

    NumPy's own arrays may begin anywhere, and a vector in two lines takes twice as long to load.
    """
    count, line = int(np.prod(shape)) * LANES, 16
    room = np.empty(count + line, np.float32)
    begin = -(room.ctypes.data // room.itemsize) % line
    array = room[begin : begin + count].reshape(*shape, LANES)
    array[:] = value
    return array


def empty_state(row_count: int) -> State:
    """Arrays of a block, all zero."""
    return State(
        position=vectors(3, row_count),
        velocity=vectors(3, row_count),
        acceleration=vectors(3, row_count),
        density=vectors(row_count, value=1.0),
        pressure=vectors(row_count),
        squared_top_speed=vectors(),
        previous=vectors(2, row_count),
        touched=vectors(row_count),
        listed_at=vectors(2, row_count),
        squared_slack=vectors(row_count, value=-1.0),
        near_count=vectors(row_count, value=NEAR_POLYGONS),
        most_near=np.zeros(row_count, np.int64),
        near_edges=vectors(NEAR_POLYGONS * NEAR_EDGES, 5, row_count),
        near_distance=vectors(NEAR_POLYGONS, row_count),
        near_is_obstacle=vectors(NEAR_POLYGONS, row_count),
    )


def empty_parameters() -> LaneParameters:
    """Parameters of a block without simulations; harmless values, no scene."""
    ones = {name: vectors(value=1.0) for name in LaneParameters._fields if name != "scene"}
    ones |= {"least_pressure": vectors(), "cohesion_factor": vectors()}
    return LaneParameters(scene=np.full(LANES, -1, np.int64), **ones)
