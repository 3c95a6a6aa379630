"""Integration in time: symplectic Euler, with gravity and damping.

The damping zeta lowers the acceleration by zeta times the velocity.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import fma, fnma, load, maximum, splat, store


@kernel
def integrate(state: Any, parameters: Any, step: float, begin: int, end: int) -> None:
    """One step of rows ``begin:end`` under the forces found; notes the greatest speed."""
    gravity, damping = load(parameters.gravity, 0), load(parameters.damping, 0)
    dt, zero = splat(step), splat(0.0)
    fastest = load(state.squared_top_speed, 0)
    for row in range(begin, end):
        squared_speed = zero
        for axis in range(3):
            rate = load(state.acceleration[axis], row)
            speed = load(state.velocity[axis], row)
            rate = fnma(damping, speed, rate)
            rate = rate - (gravity if axis == 1 else zero)
            speed = fma(dt, rate, speed)
            position = load(state.position[axis], row)
            if axis < 2:
                store(state.previous[axis], row, position)
            store(state.velocity[axis], row, speed)
            store(state.position[axis], row, fma(dt, speed, position))
            squared_speed = fma(speed, speed, squared_speed)
        fastest = maximum(fastest, squared_speed)
    store(state.squared_top_speed, 0, fastest)
