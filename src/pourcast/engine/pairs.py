"""Lists of the pairs of particles that are near in any of the simulations in lockstep.

All lanes run over the same pairs. One that is far in every lane adds nothing to any sum and is left
out; the others keep their order, and with it the bits of the sums.

A list holds until a particle has moved by half the skin, what all particles of its simulation have
moved in common left out (Verlet 1967, Phys. Rev. 159).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import kernel
from pourcast.engine.simd import any_less, load, maximum, splat, store
from pourcast.engine.smoothing import dot
from pourcast.engine.state import vectors

SKIN = 0.15
"""Extra reach of the list, in support radii."""

FULL = 0.9
"""Share of all pairs from which on a list is better made of all of them, and kept."""

MARGIN = 0.999
"""Share of a skin that may be used up, for rounding errors."""


class Pairs(NamedTuple):
    """Pairs of a particle and an earlier one, by the later one.

    Those of particle i are ``earlier[start[i]:start[i + 1]]``; of these,
    ``near_earlier[near_start[i]:near_start[i + 1]]`` were within the support radius in any lane
    when the density was last summed.
    """

    start: NDArray[np.int64]
    earlier: NDArray[np.int32]
    near_start: NDArray[np.int64]
    near_earlier: NDArray[np.int32]
    slope: NDArray[np.float32]
    """(1 - q)^3 of the near pairs, shape [pair_count, LANES]."""
    listed: NDArray[np.float32]
    """Positions when the list was made [m], shape [3, particle_count, LANES]."""


def empty_pairs(count: int) -> Pairs:
    """Room for the pairs of `count` particles."""
    pairs = count * (count - 1) // 2
    return Pairs(
        start=np.zeros(count + 1, np.int64),
        earlier=np.zeros(pairs, np.int32),
        near_start=np.zeros(count + 1, np.int64),
        near_earlier=np.zeros(pairs, np.int32),
        slope=vectors(pairs),
        listed=vectors(3, count),
    )


@kernel
def list_pairs(state: Any, parameters: Any, pairs: Any) -> None:
    """List the pairs within reach and skin of each other in any lane."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    reach = (1.0 + SKIN) / load(parameters.inverse_support, 0)
    squared_reach, count = reach * reach, 0
    for i in range(state.density.shape[0]):
        pairs.start[i] = count
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        for j in range(i):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            pairs.earlier[count] = j
            count += any_less(dot(dx, dy, dz, dx, dy, dz), squared_reach)
        for axis in range(3):
            store(pairs.listed[axis], i, load(state.position[axis], i))
    pairs.start[state.density.shape[0]] = count
    if count > FULL * _pair_count(state):
        _list_all(state, pairs)


@kernel
def _list_all(state: Any, pairs: Any) -> None:
    """List all pairs, a list that never gets old."""
    count = 0
    for i in range(state.density.shape[0]):
        pairs.start[i] = count
        for j in range(i):
            pairs.earlier[count] = j
            count += 1
    pairs.start[state.density.shape[0]] = count


@kernel
def _pair_count(state: Any) -> int:
    count = int(state.density.shape[0])
    return count * (count - 1) // 2


@kernel
def have_moved(state: Any, parameters: Any, pairs: Any) -> bool:
    """Whether two particles of a simulation may have come nearer to each other by the skin."""
    rows = state.density.shape[0]
    if pairs.start[rows] == _pair_count(state):
        return False
    sum_x, sum_y, sum_z = summed_motion(state, pairs.listed)
    share = 1.0 / rows
    farthest = farthest_from(state, pairs.listed, sum_x * share, sum_y * share, sum_z * share)
    allowed = 0.5 * MARGIN * SKIN / load(parameters.inverse_support, 0)
    return any_less(allowed * allowed, farthest)


@kernel
def summed_motion(state: Any, listed: Any) -> Any:
    """Displacements since a list was made [m], summed over the rows, along the three axes."""
    sum_x, sum_y, sum_z = splat(0.0), splat(0.0), splat(0.0)
    for row in range(state.density.shape[0]):
        moved_x, moved_y, moved_z = _moved_since(state, listed, row)
        sum_x, sum_y, sum_z = sum_x + moved_x, sum_y + moved_y, sum_z + moved_z
    return sum_x, sum_y, sum_z


@kernel
def farthest_from(state: Any, listed: Any, mean_x: Any, mean_y: Any, mean_z: Any) -> Any:
    """Square of the largest displacement of each lane [m^2], less a common one [m]."""
    farthest = splat(0.0)
    for row in range(state.density.shape[0]):
        moved_x, moved_y, moved_z = _moved_since(state, listed, row)
        dx, dy, dz = moved_x - mean_x, moved_y - mean_y, moved_z - mean_z
        farthest = maximum(farthest, dot(dx, dy, dz, dx, dy, dz))
    return farthest


@kernel
def _moved_since(state: Any, listed: Any, row: int) -> Any:
    """Displacements of a row's particles since a list was made [m]."""
    return (
        load(state.position[0], row) - load(listed[0], row),
        load(state.position[1], row) - load(listed[1], row),
        load(state.position[2], row) - load(listed[2], row),
    )
