"""Weakly compressible SPH: density, pressure, artificial viscosity, integration.

Density by summation; equation of state p = c^2 (rho - rho0), clamped at 0 (a
free surface has no tension); momentum in the symmetric form of Monaghan
(1992), Annu. Rev. Astron. Astrophys. 30, eqs 3.3 and 4.1-4.2 with beta = 0:

    dv_i/dt = - sum_j m (p_i / rho_i^2 + p_j / rho_j^2 + Pi_ij) grad W_ij
    Pi_ij   = - alpha c h (v_ij . r_ij) / ((r_ij^2 + 0.01 h^2) rho_mean)

for approaching pairs, 0 otherwise. Densities are divided by rho0 throughout,
so that masses cancel. Walls of the box carry pressure: a particle near one
sees its own mirror image, which pushes a stack of particles off a wall on
which contact alone would let it stand for ever.

Integration is symplectic Euler; the damping zeta lowers the acceleration by
zeta times the velocity.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.contact import collide_with_box, collide_with_polygons
from pourcast.engine.kernel import shape, slope
from pourcast.engine.simd import load, maximum, minimum, splat, sqrt, store, where_less


@kernel
def one_minus_q(squared_distance: Any, inverse_support: Any, zero: Any) -> Any:
    """max(1 - r / H, 0) from r^2."""
    return maximum(1.0 - sqrt(squared_distance) * inverse_support, zero)


@kernel
def start_density(state: Any, lanes: Any) -> None:
    """Each particle's own share of its density, and its mirror images' in the walls."""
    inverse_support, zero = load(lanes.inverse_support, 0), splat(0.0)
    width, depth, ceiling = load(lanes.width, 0), load(lanes.depth, 0), load(lanes.ceiling, 0)
    for row in range(state.density.shape[0]):
        total = splat(1.0)
        x, y = load(state.position[0], row), load(state.position[1], row)
        z = load(state.position[2], row)
        for gap in (minimum(x, width - x), minimum(y, ceiling - y), minimum(z, depth - z)):
            total = total + shape(maximum(1.0 - 2.0 * gap * inverse_support, zero))
        store(state.density, row, total)


@kernel
def add_pair_density(state: Any, lanes: Any) -> None:
    """Kernel sum over all pairs of 16 simulations in lockstep."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    density = state.density
    inverse_support, zero = load(lanes.inverse_support, 0), splat(0.0)
    for i in range(density.shape[0]):
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        total = load(density, i)
        for j in range(i):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            share = shape(one_minus_q(dx * dx + dy * dy + dz * dz, inverse_support, zero))
            total = total + share
            store(density, j, load(density, j) + share)
        store(density, i, total)


@kernel
def wall_push(pressure: Any, below: Any, above: Any, inverse_support: Any, zero: Any) -> Any:
    """Acceleration by the mirror image in the nearer of two walls, over the pressure factor."""
    gap = minimum(below, above)
    size = 4.0 * pressure * gap * slope(maximum(1.0 - 2.0 * gap * inverse_support, zero))
    return where_less(above, below, zero - size, size)


@kernel
def finish_density(state: Any, lanes: Any) -> None:
    """Density over rest density, pressure, and the walls' part of the acceleration."""
    zero = splat(0.0)
    scale = 1.0 / load(lanes.reference_density, 0)
    inverse_support, factor = load(lanes.inverse_support, 0), load(lanes.pressure_factor, 0)
    width, depth, ceiling = load(lanes.width, 0), load(lanes.depth, 0), load(lanes.ceiling, 0)
    for row in range(state.density.shape[0]):
        density = load(state.density, row) * scale
        pressure = maximum(density - 1.0, zero) / (density * density)
        store(state.density, row, density)
        store(state.pressure, row, pressure)
        x, y = load(state.position[0], row), load(state.position[1], row)
        z = load(state.position[2], row)
        push_x = wall_push(pressure, x, width - x, inverse_support, zero)
        push_y = wall_push(pressure, y, ceiling - y, inverse_support, zero)
        push_z = wall_push(pressure, z, depth - z, inverse_support, zero)
        store(state.acceleration[0], row, factor * push_x)
        store(state.acceleration[1], row, factor * push_y)
        store(state.acceleration[2], row, factor * push_z)


@kernel
def pair_push(
    dx: Any, dy: Any, dz: Any, du: Any, dv: Any, dw: Any, densities: Any, pressures: Any,
    inverse_support: Any, pressure_factor: Any, viscosity_factor: Any, separation_floor: Any,
) -> Any:  # fmt: skip
    """Acceleration of a particle by another, over the vector from the other to it.

    From that vector, the relative velocity and the sums of the two densities and pressures.
    """
    zero = splat(0.0)
    r2 = dx * dx + dy * dy + dz * dz
    approach = minimum(du * dx + dv * dy + dw * dz, zero)
    friction = approach / ((r2 + separation_floor) * densities)
    push = pressure_factor * pressures - viscosity_factor * friction
    return push * slope(one_minus_q(r2, inverse_support, zero))


@kernel
def add_pair_forces(state: Any, lanes: Any) -> None:
    """Pressure and artificial viscosity over all pairs of 16 simulations in lockstep."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    u, v, w = state.velocity[0], state.velocity[1], state.velocity[2]
    ax, ay, az = state.acceleration[0], state.acceleration[1], state.acceleration[2]
    density, pressure = state.density, state.pressure
    inverse_support = load(lanes.inverse_support, 0)
    pressure_factor = load(lanes.pressure_factor, 0)
    viscosity_factor = load(lanes.viscosity_factor, 0)
    separation_floor = load(lanes.separation_floor, 0)
    for i in range(density.shape[0]):
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        ui, vi, wi = load(u, i), load(v, i), load(w, i)
        density_i, pressure_i = load(density, i), load(pressure, i)
        axi, ayi, azi = load(ax, i), load(ay, i), load(az, i)
        for j in range(i):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            du, dv, dw = ui - load(u, j), vi - load(v, j), wi - load(w, j)
            push = pair_push(
                dx, dy, dz, du, dv, dw,
                density_i + load(density, j), pressure_i + load(pressure, j),
                inverse_support, pressure_factor, viscosity_factor, separation_floor,
            )  # fmt: skip
            fx, fy, fz = push * dx, push * dy, push * dz
            axi, ayi, azi = axi + fx, ayi + fy, azi + fz
            store(ax, j, load(ax, j) - fx)
            store(ay, j, load(ay, j) - fy)
            store(az, j, load(az, j) - fz)
        store(ax, i, axi)
        store(ay, i, ayi)
        store(az, i, azi)


@kernel
def integrate(state: Any, lanes: Any, step: float) -> None:
    """One symplectic Euler step under the forces found, gravity and damping."""
    gravity, damping = load(lanes.gravity, 0), load(lanes.damping, 0)
    dt, zero = splat(step), splat(0.0)
    for row in range(state.density.shape[0]):
        for axis in range(3):
            rate = load(state.acceleration[axis], row)
            speed = load(state.velocity[axis], row)
            rate = rate - damping * speed
            rate = rate - (gravity if axis == 1 else zero)
            speed = speed + dt * rate
            place = load(state.position[axis], row)
            if axis < 2:
                store(state.previous[axis], row, place)
            store(state.velocity[axis], row, speed)
            store(state.position[axis], row, place + dt * speed)


@kernel
def find_forces(state: Any, lanes: Any) -> None:
    """Density, pressure and forces of 16 simulations in lockstep."""
    start_density(state, lanes)
    add_pair_density(state, lanes)
    finish_density(state, lanes)
    add_pair_forces(state, lanes)


@kernel
def advance(state: Any, lanes: Any, solids: Any, cells: Any, step: float, steps: int) -> None:
    """Move 16 simulations on by a number of steps.

    Parameters
    ----------
    state
        The particles; changed in place.
    lanes
        Parameters of the lanes.
    solids, cells
        Polygons and broad phase (`contact`).
    step
        Time step [s].
    steps
        How many.
    """
    for _ in range(steps):
        find_forces(state, lanes)
        integrate(state, lanes, step)
        collide_with_box(state, lanes)
        collide_with_polygons(state, lanes, solids, cells)


@kernel
def measure(state: Any, lanes: Any, squared_speed: Any, head: Any) -> None:
    """Write the fastest particle's squared speed and the greatest head of each lane.

    The (kinetic and elevation) head of a particle, y + v^2 / (2 g), is the
    height to which its speed could carry it.

    Parameters
    ----------
    state, lanes
        The particles and the parameters of their lanes.
    squared_speed
        Receives the largest squared speed [m^2/s^2], shape [16].
    head
        Receives the largest head [m], shape [16].
    """
    fastest, highest = splat(0.0), splat(0.0)
    half_over_g = 0.5 / maximum(load(lanes.gravity, 0), splat(1e-6))
    for row in range(state.density.shape[0]):
        u, v = load(state.velocity[0], row), load(state.velocity[1], row)
        w = load(state.velocity[2], row)
        speed = u * u + v * v + w * w
        fastest = maximum(fastest, speed)
        highest = maximum(highest, load(state.position[1], row) + speed * half_over_g)
    store(squared_speed, 0, fastest)
    store(head, 0, highest)
