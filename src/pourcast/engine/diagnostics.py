"""Diagnostics between frames: speed, head, energy, and whether a simulation can be trusted.

A simulation is broken as soon as

- a position or a velocity is no finite number,
- a centre is beyond a wall of the box,
- a particle has moved by more than its radius in one step, and may have passed through a solid,
- or the liquid has more energy than before, which nothing in the model can give it.

Energy is kinetic, potential and elastic, on average over the particles, and is compared with
the least so far. `ALLOWED_SHARE` and the constants beside it say how much of a gain is an
error of the method.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.cohesion import add_pair_energy, is_cohesive
from pourcast.engine.compile import kernel
from pourcast.engine.equation_of_state import elastic_energy
from pourcast.engine.simd import (
    LANES,
    first_lanes,
    load,
    maximum,
    minimum,
    splat,
    store,
    where_less,
)
from pourcast.engine.smoothing import GRADIENT_FACTOR

ALLOWED_SHARE = 0.01
"""Energy that a simulation may gain, over that at its start (potential energy from the floor).

Measured: 0.1 % at most in 15 to 2000 particles, over 1000 pours of both families with water,
honey and marbles, steps from half to ten times ours and sound speeds from 10 to 60 m/s."""

ALLOWED_SHARE_OF_ONE = 0.5
"""The same over the number of particles, for each of few particles is bounced by a wall or a
corner as one. Measured: 20 % for a single one that bounces without damping for 10 s, 0.7 % for
four."""

ALLOWED_LIFT = 0.4
"""Gain in height, in radii: a particle may start so deep in the floor (`packing`'s margin of
0.3 spacings), and contact lifts it out."""

_ROUNDING = 5e-7
"""Rounding error of the elastic energy, over c^2: four units in the last place."""

_MARGIN = 0.1
"""How far, in radii, a centre may be beyond a wall of the box and still count as inside."""

SOUND, NOT_FINITE, OUTSIDE, TOO_FAST, GAINS_ENERGY = range(5)
"""What `check` finds of a simulation."""


class Diagnostics(NamedTuple):
    """Of each lane, shape [LANES] each. Of one large simulation, the same in all of them."""

    squared_speed: NDArray[np.float32]
    """Of the fastest particle [m^2/s^2]."""
    head: NDArray[np.float32]
    """Greatest head (kinetic and elevation) of a particle, y + v^2 / (2 g) [m]: the height to
    which its speed could carry it."""
    energy: NDArray[np.float32]
    """Kinetic, potential and elastic, on average over the particles [J/kg]."""
    outside: NDArray[np.float32]
    """Number of particles whose centre is beyond a wall of the box, or no finite number."""
    least_energy: NDArray[np.float64]
    """Least energy so far [J/kg]."""
    allowed_gain: NDArray[np.float64]
    """Energy above `least_energy` that is an error of the method [J/kg]."""
    verdict: NDArray[np.int64]
    """`SOUND`, or what is wrong."""


def empty_diagnostics() -> Diagnostics:
    """Arrays for `measure` and `check` to write to."""
    return Diagnostics(
        squared_speed=np.zeros(LANES, np.float32),
        head=np.zeros(LANES, np.float32),
        energy=np.zeros(LANES, np.float32),
        outside=np.zeros(LANES, np.float32),
        least_energy=np.zeros(LANES),
        allowed_gain=np.zeros(LANES),
        verdict=np.zeros(LANES, np.int64),
    )


def allowed_gain(energy: float, count: int, gravity: float, radius: float, sound: float) -> float:
    """Gain of energy [J/kg] that is an error of the method.

    Parameters
    ----------
    energy
        Energy at the start, on average over the particles [J/kg].
    count
        Number of particles.
    gravity
        Acceleration [m/s^2].
    radius
        Contact radius of a particle [m].
    sound
        Speed of sound [m/s].

    Examples
    --------
    >>> round(allowed_gain(9.81 * 1.3, 50, 9.81, 0.0185, 30.0), 2)  # water of the paper
    0.33
    """
    share = ALLOWED_SHARE + ALLOWED_SHARE_OF_ONE / count
    return share * energy + ALLOWED_LIFT * gravity * radius + _ROUNDING * sound**2


@kernel
def measure(
    state: Any, parameters: Any, step: float, count: int, large: bool, diagnostics: Any
) -> None:
    """Write the diagnostics of all lanes, but for what `check` writes.

    Parameters
    ----------
    state, parameters
        The particles and the parameters of their lanes; densities are those before the last step.
    step
        Length of that step [s]; 0 before the first.
    count
        Number of particles of a simulation.
    large
        Whether the lanes are one large simulation.
    diagnostics
        Receives the diagnostics.
    """
    fastest, highest, energy, outside = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    zero, one, half_step = splat(0.0), splat(1.0), splat(0.5 * step)
    least = load(parameters.least_pressure, 0)
    gravity, radius = load(parameters.gravity, 0), load(parameters.radius, 0)
    half_over_g = 0.5 / maximum(gravity, splat(1e-6))
    inverse_support = load(parameters.inverse_support, 0)
    squared_sound_speed = (
        load(parameters.pressure_factor, 0)
        * load(parameters.reference_density, 0)
        / (GRADIENT_FACTOR * inverse_support * inverse_support)
    )
    width, depth, ceiling = (
        load(parameters.width, 0),
        load(parameters.depth, 0),
        load(parameters.ceiling, 0),
    )
    # A box narrower than a particle holds its centre beyond a wall.
    margin = _MARGIN * radius
    left, right = minimum(zero, width - radius) - margin, maximum(width, radius) + margin
    front, back = minimum(zero, depth - radius) - margin, maximum(depth, radius) + margin
    floor, top = zero - margin, ceiling + margin
    rows = state.density.shape[0]
    for row in range(rows):
        x, y = load(state.position[0], row), load(state.position[1], row)
        z = load(state.position[2], row)
        u, v = load(state.velocity[0], row), load(state.velocity[1], row)
        w = load(state.velocity[2], row)
        speed = u * u + v * v + w * w
        fastest = maximum(fastest, speed)
        highest = maximum(highest, y + speed * half_over_g)
        # Velocities of symplectic Euler are half a step ahead of the density.
        u = u - half_step * load(state.acceleration[0], row)
        v = v - half_step * load(state.acceleration[1], row)
        w = w - half_step * load(state.acceleration[2], row)
        elastic = squared_sound_speed * elastic_energy(load(state.density, row), least)
        of_row = 0.5 * (u * u + v * v + w * w) + gravity * y + elastic
        # Comparisons that are false for what is no number.
        inside = where_less(left, x, where_less(x, right, one, zero), zero)
        inside = where_less(floor, y, where_less(y, top, inside, zero), zero)
        inside = where_less(front, z, where_less(z, back, inside, zero), zero)
        in_row = count - LANES * row if large else LANES
        energy = energy + first_lanes(of_row, in_row)
        outside = outside + first_lanes(one - inside, in_row)
    if is_cohesive(parameters):
        energy = add_pair_energy(state, parameters, count, large, energy)
    store(diagnostics.squared_speed, 0, fastest)
    store(diagnostics.head, 0, highest)
    store(diagnostics.energy, 0, energy)
    store(diagnostics.outside, 0, outside)
    if large:
        _join_lanes(diagnostics)
    for lane in range(LANES):
        diagnostics.energy[lane] /= count


@kernel
def _join_lanes(diagnostics: Any) -> None:
    """Write the diagnostics of all lanes together into each of them."""
    for lane in range(1, LANES):
        diagnostics.squared_speed[0] = max(
            diagnostics.squared_speed[0], diagnostics.squared_speed[lane]
        )
        diagnostics.head[0] = max(diagnostics.head[0], diagnostics.head[lane])
        diagnostics.energy[0] += diagnostics.energy[lane]
        diagnostics.outside[0] += diagnostics.outside[lane]
    for values in (
        diagnostics.squared_speed,
        diagnostics.head,
        diagnostics.energy,
        diagnostics.outside,
    ):
        values[1:] = values[0]


@kernel
def check(state: Any, parameters: Any, step: float, diagnostics: Any) -> bool:
    """Look for broken simulations, and begin the next frame's account.

    Parameters
    ----------
    state, parameters
        The particles and the parameters of their lanes.
    step
        Time step [s].
    diagnostics
        What `measure` has found; verdicts and least energies are written.

    Returns
    -------
    bool
        Whether all simulations are sound.
    """
    sound = True
    for lane in range(LANES):
        diagnostics.verdict[lane] = SOUND
        if parameters.scene[lane] < 0:
            continue
        energy, squared_top_speed = float(diagnostics.energy[lane]), state.squared_top_speed[lane]
        radius = float(parameters.radius[lane])
        if not (np.isfinite(energy) and np.isfinite(squared_top_speed)):
            diagnostics.verdict[lane] = NOT_FINITE
        elif diagnostics.outside[lane] > 0.0:
            diagnostics.verdict[lane] = OUTSIDE
        elif step * step * squared_top_speed > radius * radius:
            diagnostics.verdict[lane] = TOO_FAST
        elif energy - diagnostics.least_energy[lane] > diagnostics.allowed_gain[lane]:
            diagnostics.verdict[lane] = GAINS_ENERGY
        sound = sound and diagnostics.verdict[lane] == SOUND
        diagnostics.least_energy[lane] = min(diagnostics.least_energy[lane], energy)
        state.squared_top_speed[lane] = 0.0
    return sound


@kernel
def measure_and_check(
    state: Any, parameters: Any, step: float, count: int, large: bool, diagnostics: Any
) -> bool:
    """`measure` and `check` in one call; see there."""
    measure(state, parameters, step, count, large, diagnostics)
    return bool(check(state, parameters, step, diagnostics))
