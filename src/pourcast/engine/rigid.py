"""Rigid spheres with perfectly inelastic, frictionless collisions.

Spheres of equal mass. A step moves them freely, then resolves contacts in
`PASSES` Gauss-Seidel sweeps over the pairs: touching spheres that approach
lose their relative normal velocity (restitution 0, momentum kept), and
overlap is undone by moving both apart. Contact with solids is `contact`'s,
the same as for the liquid.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.integrator import integrate
from pourcast.engine.simd import (
    any_less,
    fma,
    fnma,
    load,
    maximum,
    minimum,
    splat,
    sqrt,
    store,
    where_less,
)
from pourcast.engine.smoothing import dot

PASSES = 4


@kernel
def collide_spheres(state: Any, parameters: Any) -> None:
    """One sweep over all pairs: no approach and no overlap along the line of centres."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    u, v, w = state.velocity[0], state.velocity[1], state.velocity[2]
    diameter = 2.0 * load(parameters.radius, 0)
    touching = diameter * diameter
    zero, tiny = splat(0.0), splat(1e-12)
    for i in range(1, state.density.shape[0]):
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        for j in range(i):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            r2 = dot(dx, dy, dz, dx, dy, dz)
            if not any_less(r2, touching):
                continue
            inverse = 1.0 / sqrt(maximum(r2, tiny))
            dx, dy, dz = dx * inverse, dy * inverse, dz * inverse
            du, dv, dw = load(u, i) - load(u, j), load(v, i) - load(v, j), load(w, i) - load(w, j)
            approach = minimum(dot(du, dv, dw, dx, dy, dz), zero)
            impulse = where_less(r2, touching, -0.5 * approach, zero)
            store(u, i, fma(impulse, dx, load(u, i)))
            store(v, i, fma(impulse, dy, load(v, i)))
            store(w, i, fma(impulse, dz, load(w, i)))
            store(u, j, fnma(impulse, dx, load(u, j)))
            store(v, j, fnma(impulse, dy, load(v, j)))
            store(w, j, fnma(impulse, dz, load(w, j)))
            shift = where_less(r2, touching, 0.5 * fnma(r2, inverse, diameter), zero)
            xi, yi, zi = fma(shift, dx, xi), fma(shift, dy, yi), fma(shift, dz, zi)
            store(x, j, fnma(shift, dx, load(x, j)))
            store(y, j, fnma(shift, dy, load(y, j)))
            store(z, j, fnma(shift, dz, load(z, j)))
        store(x, i, xi)
        store(y, i, yi)
        store(z, i, zi)


@kernel
def advance(
    state: Any, parameters: Any, solids: Any, broad_phase: Any, step: float, steps: int
) -> None:
    """Move simulations of spheres in lockstep on by a number of steps.

    Parameters
    ----------
    state
        The spheres; changed in place. Their acceleration must be zero.
    parameters
        Parameters of the lanes.
    solids, broad_phase
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    """
    for _ in range(steps):
        integrate(state, parameters, step)
        for _ in range(PASSES):
            collide_spheres(state, parameters)
            collide_with_box(state, parameters)
            collide_with_polygons(state, parameters, solids, broad_phase)
