"""Density by summation: a particle's own weight, its mirror images', and those of all pairs.

rho_i = sum_j m W_ij (Monaghan 1992, eq. 3.2). Sums are over the rest density's in the end,
so that masses cancel.

The sum is taken in the order of the particles' numbers, the particle's own weight where its number
comes. Another path that keeps to this order, and leaves out what is 0, has the same bits.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import any_less, load, splat, store
from pourcast.engine.smoothing import add_weight, dot, gradient, one_minus_q_of
from pourcast.engine.walls import wall_density


@kernel
def start_density(state: Any, parameters: Any) -> None:
    """What each particle's mirror images in the walls add to its density."""
    for row in range(state.density.shape[0]):
        x, y = load(state.position[0], row), load(state.position[1], row)
        z = load(state.position[2], row)
        store(state.density, row, wall_density(x, y, z, parameters))


@kernel
def add_pair_density(state: Any, parameters: Any, pairs: Any) -> None:
    """Add a particle's own weight and those of listed pairs, in lockstep; note which are near."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    density, slope = state.density, pairs.slope
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    near_count = 0
    for i in range(density.shape[0]):
        pairs.near_start[i] = near_count
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        total = load(density, i)
        earlier = pairs.earlier[pairs.start[i] : pairs.start[i + 1]]
        for k in range(len(earlier)):
            j = earlier[k]
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            near = one_minus_q_of(dot(dx, dy, dz, dx, dy, dz), inverse_support, zero)
            pairs.near_earlier[near_count] = j
            store(slope, near_count, gradient(near))
            near_count += any_less(zero, near)
            total = add_weight(total, near)
            store(density, j, add_weight(load(density, j), near))
        store(density, i, total + 1.0)
    pairs.near_start[density.shape[0]] = near_count


@kernel
def divide_by_rest_density(state: Any, parameters: Any) -> None:
    """Turn the sums into densities over that at rest."""
    scale = 1.0 / load(parameters.reference_density, 0)
    for row in range(state.density.shape[0]):
        store(state.density, row, load(state.density, row) * scale)
