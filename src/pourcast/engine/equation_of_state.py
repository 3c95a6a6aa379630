"""Equation of state: pressure and elastic energy from density.

p = c^2 (rho - rho0), bounded below: p >= - k c^2 rho0, k being the cohesion, 0 to 1. With k = 0 a
free surface has no tension; with k = 1 the equation is Monaghan's (1994, J. Comput. Phys. 110)
without a bound, and a liquid that is drawn out pulls itself together. With the density over that
at rest, d = rho / rho0, the term of the momentum equation is
p / rho^2 = c^2 / rho0 max(d - 1, - k) / d^2, and the work that a change of density takes, the
integral of p / rho^2 over rho from rest, is

    e = c^2 (ln d + 1 / d - 1)                          for d >= 1 - k
    e = c^2 (ln m + 1 / m - 1 + k (1 / d - 1 / m))      below, with m = 1 - k

per unit of mass: at least 0, and larger the farther a liquid is from rest on either side.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import maximum


@kernel
def pressure_term(density: Any, least: Any) -> Any:
    """Pressure term p / rho^2 over c^2 / rho0: (d - 1) / d^2 from d, p no less than `least`.

    `least` is that pressure over c^2 rho0, - k.
    """
    return maximum(density - 1.0, least) / (density * density)


@kernel
def elastic_energy(density: Any, least: Any) -> Any:
    """Elastic energy per unit of mass over c^2, from d and the least pressure over c^2 rho0.

    The logarithm is the series 2 (z + z^3 / 3 + z^5 / 5 + z^7 / 7), z = (d - 1) / (d + 1):
    good to 2e-6 of it at d = 1.5, to 0.2 % at d = 4 and at d = 1 / 4.
    """
    followed = maximum(density, least + 1.0)
    z = (followed - 1.0) / (followed + 1.0)
    square = z * z
    logarithm = z * (2.0 + square * (2.0 / 3.0 + square * (0.4 + square * (2.0 / 7.0))))
    bound = least * (1.0 / followed - 1.0 / density)
    return logarithm + 1.0 / followed - 1.0 + bound
