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
    LANES,
    any_less,
    bits_less,
    first_lane,
    fma,
    fnma,
    load,
    load_from,
    lowest_bit,
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
def collision(dx: Any, dy: Any, dz: Any, du: Any, dv: Any, dw: Any, r2: Any, diameter: Any) -> Any:
    """Change of speed and place of a sphere that meets another, and the direction of both.

    From the vector from the other to it, the relative velocity and the squared distance; the
    other's changes are the opposite. Both are 0 where the spheres don't touch.
    """
    zero, touching = splat(0.0), diameter * diameter
    inverse = 1.0 / sqrt(maximum(r2, splat(1e-12)))
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    approach = minimum(dot(du, dv, dw, nx, ny, nz), zero)
    impulse = where_less(r2, touching, -0.5 * approach, zero)
    shift = where_less(r2, touching, 0.5 * fnma(r2, inverse, diameter), zero)
    return impulse, shift, nx, ny, nz


@kernel
def collide_spheres(state: Any, parameters: Any) -> None:
    """One sweep over all pairs: no approach and no overlap along the line of centres."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    u, v, w = state.velocity[0], state.velocity[1], state.velocity[2]
    diameter = 2.0 * load(parameters.radius, 0)
    touching = diameter * diameter
    for i in range(1, state.density.shape[0]):
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        for j in range(i):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            r2 = dot(dx, dy, dz, dx, dy, dz)
            if not any_less(r2, touching):
                continue
            du, dv, dw = load(u, i) - load(u, j), load(v, i) - load(v, j), load(w, i) - load(w, j)
            impulse, shift, nx, ny, nz = collision(dx, dy, dz, du, dv, dw, r2, diameter)
            store(u, i, fma(impulse, nx, load(u, i)))
            store(v, i, fma(impulse, ny, load(v, i)))
            store(w, i, fma(impulse, nz, load(w, i)))
            store(u, j, fnma(impulse, nx, load(u, j)))
            store(v, j, fnma(impulse, ny, load(v, j)))
            store(w, j, fnma(impulse, nz, load(w, j)))
            xi, yi, zi = fma(shift, nx, xi), fma(shift, ny, yi), fma(shift, nz, zi)
            store(x, j, fnma(shift, nx, load(x, j)))
            store(y, j, fnma(shift, ny, load(y, j)))
            store(z, j, fnma(shift, nz, load(z, j)))
        store(x, i, xi)
        store(y, i, yi)
        store(z, i, zi)


@kernel
def collide_spheres_of_one(state: Any, parameters: Any, count: int) -> None:
    """`collide_spheres` for one simulation: the same pairs in the same order.

    Which of `LANES` spheres touch a sphere is seen at once; after each that does, anew.
    """
    size = state.density.size
    position, velocity = state.position.reshape(3, size), state.velocity.reshape(3, size)
    x, y, z = position[0], position[1], position[2]
    diameter = 2.0 * load(parameters.radius, 0)
    touching = diameter * diameter
    for i in range(1, count):
        for first in range(0, i, LANES):
            # The lanes that are left: partners before i, and after the last that touched.
            left = (1 << min(i - first, LANES)) - 1
            while left != 0:
                dx = splat(x[i]) - load_from(x, first)
                dy = splat(y[i]) - load_from(y, first)
                dz = splat(z[i]) - load_from(z, first)
                left &= bits_less(dot(dx, dy, dz, dx, dy, dz), touching)
                if left == 0:
                    break
                lane = lowest_bit(left)
                _collide_two(position, velocity, i, first + lane, diameter)
                left = ((1 << min(i - first, LANES)) - 1) & ~((2 << lane) - 1)
    # Slots beyond the last sphere hold copies of it.
    for axis in range(3):
        for slot in range(count, size):
            position[axis, slot] = position[axis, count - 1]
            velocity[axis, slot] = velocity[axis, count - 1]


@kernel
def _collide_two(position: Any, velocity: Any, i: int, j: int, diameter: Any) -> None:
    """Collide two spheres of one simulation, the same numbers in all lanes."""
    dx = splat(position[0, i]) - splat(position[0, j])
    dy = splat(position[1, i]) - splat(position[1, j])
    dz = splat(position[2, i]) - splat(position[2, j])
    du = splat(velocity[0, i]) - splat(velocity[0, j])
    dv = splat(velocity[1, i]) - splat(velocity[1, j])
    dw = splat(velocity[2, i]) - splat(velocity[2, j])
    r2 = dot(dx, dy, dz, dx, dy, dz)
    impulse, shift, nx, ny, nz = collision(dx, dy, dz, du, dv, dw, r2, diameter)
    for axis, normal in enumerate((nx, ny, nz)):
        velocity[axis, i] = first_lane(fma(impulse, normal, splat(velocity[axis, i])))
        velocity[axis, j] = first_lane(fnma(impulse, normal, splat(velocity[axis, j])))
        position[axis, i] = first_lane(fma(shift, normal, splat(position[axis, i])))
        position[axis, j] = first_lane(fnma(shift, normal, splat(position[axis, j])))


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
    rows = state.density.shape[0]
    for _ in range(steps):
        integrate(state, parameters, step, 0, rows)
        for _ in range(PASSES):
            collide_spheres(state, parameters)
            collide_with_box(state, parameters, 0, rows)
            collide_with_polygons(state, parameters, solids, broad_phase, 0, rows)


@kernel
def advance_one(
    state: Any,
    parameters: Any,
    solids: Any,
    broad_phase: Any,
    step: float,
    steps: int,
    count: int,
) -> None:
    """Move one simulation of `count` spheres on, sphere i in row i // LANES, lane i % LANES.

    For the other parameters see `advance`; every lane's are the same. Slots beyond the last
    sphere hold copies of it.
    """
    rows = state.density.shape[0]
    for _ in range(steps):
        integrate(state, parameters, step, 0, rows)
        for _ in range(PASSES):
            collide_spheres_of_one(state, parameters, count)
            collide_with_box(state, parameters, 0, rows)
            collide_with_polygons(state, parameters, solids, broad_phase, 0, rows)
