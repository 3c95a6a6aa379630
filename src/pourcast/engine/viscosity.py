"""Artificial viscosity of Monaghan (1992), eqs 4.1-4.2 with beta = 0.

    Pi_ij = - alpha c h (v_ij . r_ij) / ((r_ij^2 + 0.01 h^2) rho_mean)

for approaching pairs, 0 otherwise.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import minimum


@kernel
def approach_rate(
    approach: Any, squared_distance: Any, densities: Any, separation_floor: Any, zero: Any
) -> Any:
    """Pi_ij over - 2 alpha c h: negative for approaching pairs, 0 for others.

    From v_ij . r_ij, r_ij^2, the sum of the two densities and 0.01 h^2.
    """
    return minimum(approach, zero) / ((squared_distance + separation_floor) * densities)
