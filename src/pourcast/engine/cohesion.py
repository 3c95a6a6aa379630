"""Cohesion: what holds a liquid together, as forces between pairs.

Particles that are farther apart than a neutral distance r0 attract one another, nearer ones repel:

    dv_i/dt = sum_j k ((1 - q)^3 - (1 - q0)^3) (1 - q)^3 r_vec,  q = r / H, q0 = r0 / H

in the manner of Tartakovsky & Meakin (2005), Phys. Rev. E 72, 026301, and Akinci, Akinci & Teschner
(2013), ACM Trans. Graph. 32, with the smoothing kernel's gradient for a shape. With r0 the particle
spacing, the repulsion keeps particles apart that tension alone would let fall together (the tensile
instability: Swegle, Hicks & Attaway 1995, J. Comput. Phys. 116; Monaghan 2000, J. Comput. Phys.
159). The force follows from a potential of the distance, so that it can neither make energy nor
lose any:

    phi = k H^2 (u^7 / 7 - u^8 / 8 - (1 - q0)^3 (u^4 / 4 - u^5 / 5)),  u = max(1 - q, 0)

for each pair, per unit of a particle's mass.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from pourcast.engine.compile import kernel
from pourcast.engine.simd import LANES, first_lanes, load, splat
from pourcast.engine.smoothing import dot, one_minus_q_of


def _potential(u: Any, neutral_slope: Any) -> Any:
    """Potential of a pair over k H^2, from u = max(1 - q, 0) and (1 - q0)^3."""
    cube = u * u * u
    repulsion = cube * cube * u * (1.0 / 7.0 - u * 0.125)
    return repulsion - neutral_slope * (cube * u * (0.25 - u * 0.2))


pair_potential = kernel(_potential)


@lru_cache(maxsize=64)
def strength(neutral_in_supports: float) -> float:
    """Surface tension over density that k = 1 / s^2 gives [m^3 / s^2], over H^2 r0.

    Half the energy of all pairs that a cut through a cubic lattice of spacing r0 parts, per area
    of the cut (Rowlinson & Widom 1982, Molecular Theory of Capillarity, section 1.4).

    Parameters
    ----------
    neutral_in_supports
        q0 = r0 / H, below 1.

    Examples
    --------
    >>> round(strength(1 / 2.3), 4)
    0.002
    """
    reach = int(np.ceil(1.0 / neutral_in_supports))
    axis = np.arange(-reach, reach + 1)
    x, y, z = np.meshgrid(axis, axis, np.arange(1, reach + 1))
    near = np.maximum(1.0 - np.sqrt(x**2 + y**2 + z**2) * neutral_in_supports, 0.0)
    potential = _potential(near, (1.0 - neutral_in_supports) ** 3)
    return float(-0.5 * np.sum(z * potential))


def cohesion_factor(surface_tension: float, neutral_distance: float, support: float) -> float:
    """Factor k [1/s^2] of a surface tension over density.

    Parameters
    ----------
    surface_tension
        Surface tension over density [m^3/s^2].
    neutral_distance
        Distance r0 at which a pair neither attracts nor repels [m]: the particle spacing.
    support
        Support radius H of the kernel [m], more than r0.
    """
    ratio = neutral_distance / support
    return surface_tension / (strength(round(ratio, 9)) * support**2 * neutral_distance)


@kernel
def add_pair_energy(state: Any, parameters: Any, count: int, large: bool, energy: Any) -> Any:
    """Energy of all pairs per unit of a particle's mass [J/kg], added to a sum.

    Parameters
    ----------
    state, parameters
        The particles and the parameters of their lanes.
    count
        Number of particles of a simulation.
    large
        Whether the lanes are one simulation. Each pair is then seen twice, and counts half.
    energy
        The sum.
    """
    x, y, z = state.position[0], state.position[1], state.position[2]
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    neutral = load(parameters.neutral_slope, 0)
    scale = load(parameters.cohesion_factor, 0) / (inverse_support * inverse_support)
    total = zero
    for i in range(count):
        if large:
            row, lane = divmod(i, LANES)
            xi, yi, zi = splat(x[row, lane]), splat(y[row, lane]), splat(z[row, lane])
        else:
            xi, yi, zi = load(x, i), load(y, i), load(z, i)
        for j in range(state.density.shape[0] if large else i):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            near = one_minus_q_of(dot(dx, dy, dz, dx, dy, dz), inverse_support, zero)
            pair = pair_potential(near, neutral)
            total = total + (0.5 * first_lanes(pair, count - LANES * j) if large else pair)
        if large:  # less what the particle has with itself
            total = total - 0.5 * first_lanes(pair_potential(splat(1.0), neutral), 1)
    return energy + scale * total


@kernel
def is_cohesive(parameters: Any) -> bool:
    """Whether any lane has cohesion."""
    most = 0.0
    for lane in range(LANES):
        most = max(most, float(parameters.cohesion_factor[lane]))
    return most > 0.0
