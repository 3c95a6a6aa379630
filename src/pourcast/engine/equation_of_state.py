"""Equation of state: pressure and elastic energy from density.

p = c^2 (rho - rho0), clamped at 0: a free surface has no tension. With the
density over that at rest, d = rho / rho0, the term of the momentum equation is
p / rho^2 = c^2 / rho0 (d - 1) / d^2, and the work that compression takes, the
integral of p / rho^2 over rho, is e = c^2 (ln d + 1 / d - 1) per unit of mass.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import maximum


@kernel
def pressure_term(density: Any, zero: Any) -> Any:
    """Pressure term p / rho^2 over c^2 / rho0: (d - 1) / d^2, at least 0, from d."""
    return maximum(density - 1.0, zero) / (density * density)


@kernel
def elastic_energy(density: Any, one: Any) -> Any:
    """Elastic energy per unit of mass over c^2, ln d + 1 / d - 1, from d; 0 below d = 1.

    The logarithm is the series 2 (z + z^3 / 3 + z^5 / 5 + z^7 / 7), z = (d - 1) / (d + 1):
    good to 2e-6 of it at d = 1.5, to 0.2 % at d = 4.
    """
    compressed = maximum(density, one)
    z = (compressed - 1.0) / (compressed + 1.0)
    square = z * z
    logarithm = z * (2.0 + square * (2.0 / 3.0 + square * (0.4 + square * (2.0 / 7.0))))
    return logarithm + 1.0 / compressed - 1.0
