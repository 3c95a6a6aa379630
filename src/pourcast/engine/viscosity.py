"""Artificial viscosity of Monaghan (1992), eqs 4.1-4.2 with beta = 0.

    Pi_ij = - alpha c h (v_ij . r_ij) / ((r_ij^2 + 0.01 h^2) rho_mean)

for approaching pairs, 0 otherwise; or for all pairs, those that part too, which makes it the
viscosity of a liquid in shear (Monaghan 2005, Rep. Prog. Phys. 68, section 8). It always brakes.
"""

from typing import Any

from pourcast.engine.compile import kernel


@kernel
def approach_rate(approach: Any, squared_distance: Any, densities: Any) -> Any:
    """Pi_ij over - 2 alpha c h.

    From v_ij . r_ij, bounded above by 0 or not, r_ij^2 + 0.01 h^2 and the sum of the two densities.
    """
    return approach / (squared_distance * densities)
