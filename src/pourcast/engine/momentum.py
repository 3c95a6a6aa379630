"""Momentum equation: pressure, viscosity, cohesion and the walls' push, in the symmetric form.

Monaghan (1992), Annu. Rev. Astron. Astrophys. 30, eq. 3.3:

    dv_i/dt = - sum_j m (p_i / rho_i^2 + p_j / rho_j^2 + Pi_ij) grad W_ij

The sum is taken in the order of the particles' numbers, as that for the density.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.equation_of_state import pressure_term
from pourcast.engine.simd import fma, fnma, load, minimum, store
from pourcast.engine.smoothing import dot
from pourcast.engine.viscosity import approach_rate
from pourcast.engine.walls import wall_push


@kernel
def start_forces(state: Any, parameters: Any) -> None:
    """Pressure of each particle, and the walls' part of its acceleration."""
    least, factor = load(parameters.least_pressure, 0), load(parameters.pressure_factor, 0)
    for row in range(state.density.shape[0]):
        pressure = factor * pressure_term(load(state.density, row), least)
        store(state.pressure, row, pressure)
        x, y = load(state.position[0], row), load(state.position[1], row)
        z = load(state.position[2], row)
        push_x, push_y, push_z = wall_push(pressure, x, y, z, parameters)
        store(state.acceleration[0], row, push_x)
        store(state.acceleration[1], row, push_y)
        store(state.acceleration[2], row, push_z)


@kernel
def pair_push(
    dx: Any, dy: Any, dz: Any, du: Any, dv: Any, dw: Any, slope: Any,
    densities: Any, pressures: Any, viscosity_factor: Any, separation_floor: Any,
    fastest_parting: Any, cohesion_factor: Any, neutral_slope: Any,
) -> Any:  # fmt: skip
    """Acceleration of a particle by another, over the vector from the other to it.

    From that vector, the relative velocity, (1 - q)^3 and the sums of the two densities and
    pressures. Viscosity sees no pair part faster than `fastest_parting`, in v . r [m^2/s].
    """
    squared_distance = fma(dz, dz, fma(dy, dy, fma(dx, dx, separation_floor)))
    approach = minimum(dot(du, dv, dw, dx, dy, dz), fastest_parting)
    friction = approach_rate(approach, squared_distance, densities)
    pull = fma(cohesion_factor, slope - neutral_slope, pressures)
    return fnma(viscosity_factor, friction, pull) * slope


@kernel
def add_pair_forces(state: Any, parameters: Any, pairs: Any) -> None:
    """Pressure, viscosity and cohesion over the near pairs of simulations in lockstep."""
    x, y, z = state.position[0], state.position[1], state.position[2]
    u, v, w = state.velocity[0], state.velocity[1], state.velocity[2]
    ax, ay, az = state.acceleration[0], state.acceleration[1], state.acceleration[2]
    density, pressure = state.density, state.pressure
    viscosity_factor = load(parameters.viscosity_factor, 0)
    separation_floor = load(parameters.separation_floor, 0)
    fastest_parting = load(parameters.fastest_parting, 0)
    cohesion_factor = load(parameters.cohesion_factor, 0)
    neutral_slope = load(parameters.neutral_slope, 0)
    for i in range(density.shape[0]):
        xi, yi, zi = load(x, i), load(y, i), load(z, i)
        ui, vi, wi = load(u, i), load(v, i), load(w, i)
        density_i, pressure_i = load(density, i), load(pressure, i)
        axi, ayi, azi = load(ax, i), load(ay, i), load(az, i)
        first, end = pairs.near_start[i], pairs.near_start[i + 1]
        earlier, slope = pairs.near_earlier[first:end], pairs.slope[first:end]
        for k in range(len(earlier)):
            j = earlier[k]
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            du, dv, dw = ui - load(u, j), vi - load(v, j), wi - load(w, j)
            push = pair_push(
                dx, dy, dz, du, dv, dw, load(slope, k),
                density_i + load(density, j), pressure_i + load(pressure, j),
                viscosity_factor, separation_floor, fastest_parting, cohesion_factor, neutral_slope,
            )  # fmt: skip
            axi, ayi, azi = fma(push, dx, axi), fma(push, dy, ayi), fma(push, dz, azi)
            store(ax, j, fnma(push, dx, load(ax, j)))
            store(ay, j, fnma(push, dy, load(ay, j)))
            store(az, j, fnma(push, dz, load(az, j)))
        store(ax, i, axi)
        store(ay, i, ayi)
        store(az, i, azi)
