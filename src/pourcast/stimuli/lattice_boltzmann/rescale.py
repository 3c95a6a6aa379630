"""Another time step: the same liquid in other lattice units."""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.stimuli.lattice_boltzmann.lattice import (
    FLUID,
    N_DIRECTIONS,
    QUADRATIC,
    VELOCITY,
    WEIGHT,
)


@kernel
def rescale(cells: Any, parts: Any, here: int, ratio: float, before: Any, after: Any) -> None:
    """Restate the liquid for a time step that is `ratio` times as long.

    Velocities grow by the ratio, density's deviations by its square (Thuerey 2007, section 4.3),
    stress by the ratio and with the relaxation time. What full cells lose is owed.
    """
    relaxed = before.relaxation_time - 1.0
    stretch = ratio * (after.relaxation_time - 1.0) / relaxed if abs(relaxed) > 0.05 else 0.0
    for k in range(parts.counts[0]):
        _restate(parts.active[k], cells, parts, here, ratio, stretch, before, after)
    for k in range(parts.counts[1]):
        for row in range(3, 6):
            parts.droplets[row, k] *= ratio


@kernel
def _restate(
    cell: int, cells: Any, parts: Any, here: int, ratio: float, stretch: float,
    before: Any, after: Any,
) -> None:  # fmt: skip
    """Restate a cell, from density, velocity, and what its second moment has beyond theirs."""
    populations = cells.populations[here]
    density = 1.0
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(N_DIRECTIONS):
        f = populations[cell, i]
        cx, cy, cz = VELOCITY[i, 0], VELOCITY[i, 1], VELOCITY[i, 2]
        density += f
        xx, yy, zz = xx + cx * cx * f, yy + cy * cy * f, zz + cz * cz * f
        xy, xz, yz = xy + cx * cy * f, xz + cx * cz * f, yz + cy * cz * f
    new = 1.0 + ratio * ratio * (density - 1.0)
    ux, uy, uz = cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell]
    vx, vy, vz = ratio * ux, ratio * uy, ratio * uz
    gx, gy, gz = before.gravity_x, before.gravity_y, before.gravity_z
    hx, hy, hz = after.gravity_x, after.gravity_y, after.gravity_z
    pressure = (density - 1.0) / 3.0
    xx = stretch * (xx - pressure - density * ux * (ux + gx)) + new * vx * (vx + hx)
    yy = stretch * (yy - pressure - density * uy * (uy + gy)) + new * vy * (vy + hy)
    zz = stretch * (zz - pressure - density * uz * (uz + gz)) + new * vz * (vz + hz)
    xy -= density * (ux * uy + 0.5 * (ux * gy + uy * gx))
    xz -= density * (ux * uz + 0.5 * (ux * gz + uz * gx))
    yz -= density * (uy * uz + 0.5 * (uy * gz + uz * gy))
    xy = stretch * xy + new * (vx * vy + 0.5 * (vx * hy + vy * hx))
    xz = stretch * xz + new * (vx * vz + 0.5 * (vx * hz + vz * hx))
    yz = stretch * yz + new * (vy * vz + 0.5 * (vy * hz + vz * hy))
    jx, jy, jz = new * (vx + 0.5 * hx), new * (vy + 0.5 * hy), new * (vz + 0.5 * hz)
    for i in range(N_DIRECTIONS):
        q = QUADRATIC[i]
        along = VELOCITY[i, 0] * jx + VELOCITY[i, 1] * jy + VELOCITY[i, 2] * jz
        form = q[0, 0] * xx + q[1, 1] * yy + q[2, 2] * zz
        form += 2.0 * (q[0, 1] * xy + q[0, 2] * xz + q[1, 2] * yz)
        populations[cell, i] = WEIGHT[i] * (new - 1.0 + 3.0 * along + 4.5 * form)
    cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell] = vx, vy, vz
    cells.density[cell] = new
    if cells.flags[cell] == FLUID:
        parts.owed[0] += (density - new) * cells.room[cell]
        cells.mass[cell] = new * cells.room[cell]
