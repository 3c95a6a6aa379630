"""One step of the liquid: populations move, are reflected, and relax.

Populations are pulled from the neighbours. Where a neighbour is gas, they are reconstructed from
the gas's pressure (Koerner et al. 2005, J. Stat. Phys. 121, eq. 4). A wall across an axis that lets
liquid slip is a mirror. From any other they bounce back, as from a wall that moves along with the
liquid as far as it lets it slip: with free slip, an even motion along a surface is kept exactly,
whatever cells stand for the slope. Without slip it is half-way bounce-back.

Cells may be solid in part (volumetric boundaries after Chen, Teixeira & Molvig 1998, Int. J. Mod.
Phys. C 9). Of the populations that come to a cell, what the room of both cells and all on the way
lets through is streamed, and the rest comes back from the wall; the share that passes is the same
area from both ends, so that mass is kept.

Relaxation is regularised (Latt & Chopard 2006, Math. Comput. Simul. 72), with the force F of Guo,
Zheng & Shi (2002, Phys. Rev. E 65) and Smagorinsky's sub-grid viscosity in the closed form of
Hou et al. (1996). With Pi the non-equilibrium part of the second moment,

    f_i = w_i [rho + 3 c_i . (rho u + F / 2) + 9/2 (c_i c_i - I / 3) : A],
    A   = rho u u + (1 - 1 / tau) Pi + (u F + F u) / 2.

Pi is without its trace: compression relaxes at once, or sound would ring on in a liquid like water.
In thick liquid, odd moments of the third order relax by a time of their own (two-relaxation-time,
Ginzburg, Verhaeghe & d'Humieres 2008), so that walls stay where they are however long tau is.

Mass moves with the populations (Koerner et al. 2005, eq. 3): between two interface cells in
proportion to the mean of their fill, and only one way where one of them touches no full cell or no
empty one (Thuerey 2007, table 4.1), so that none is left behind.

Populations are stored less their weights, so that float32 is enough.
"""

from typing import Any

import numpy as np

from pourcast.engine.compile import kernel
from pourcast.engine.simd import LANES, load, maximum, splat, sqrt, store
from pourcast.stimuli.lattice_boltzmann.lattice import (
    FLATTENED,
    FLUID,
    GAS,
    INTERFACE,
    MIRRORED,
    N_DIRECTIONS,
    NO_FLUID,
    NO_GAS,
    OPPOSITE,
    SOLID,
    VELOCITY,
    WEIGHT,
)

TOP_SPEED = 0.3
"""No cell's speed goes beyond this [cells per step]; the time step is chosen to stay well below."""

_LEAVING = 0.1
"""Sine of the angle to a no-slip wall from which on liquid leaves it."""

MOMENTS = N_DIRECTIONS
FORCE = MOMENTS + 4
LIMIT = FORCE + 3
LINKS = LIMIT + 1
STOPPED = LINKS + N_DIRECTIONS
WAYS = STOPPED + N_DIRECTIONS
SCRATCH_ROWS = WAYS + N_DIRECTIONS
"""Rows of scratch: populations, density and velocity, push, greatest speed, links to walls,
how much of each a wall stops, and the passage that it would have taken."""

_C = VELOCITY.astype(np.float32)
_W = WEIGHT.astype(np.float32)


@kernel
def equilibrium(i: int, density: float, ux: float, uy: float, uz: float) -> Any:
    """Population of direction `i` in a liquid that moves evenly, less its weight."""
    along = _C[i, 0] * ux + _C[i, 1] * uy + _C[i, 2] * uz
    square = ux * ux + uy * uy + uz * uz
    return WEIGHT[i] * (density * (1.0 + 3.0 * along + 4.5 * along * along - 1.5 * square) - 1.0)


@kernel
def speed_limit(cell: int, cells: Any, flow: Any) -> Any:
    """Speed of a body that fell to a cell from the liquid's highest point at the start.

    Populations weigh alike in full cells and in nearly empty ones; without a bound, a splash that
    the grid can't resolve may hand most of the liquid's energy to a few drops.
    """
    return min(TOP_SPEED, np.sqrt(flow.head * (cells.fallen[cell] + 1.0)))


@kernel
def _exchanged(i: int, kind: int, other: int, received: float, given: float) -> Any:
    """Mass that an interface cell gains from another, were both full."""
    if kind == other:
        return received - given
    if kind == NO_GAS or other == NO_FLUID:
        return received + WEIGHT[i]
    return -given - WEIGHT[i]


@kernel
def _pull(cell: int, lane: int, cells: Any, before: Any, scratch: Any, flow: Any) -> None:
    """Gather what moves into a cell; count what an interface cell gains."""
    scratch[FORCE, lane] = flow.gravity_x
    scratch[FORCE + 1, lane] = flow.gravity_y
    scratch[FORCE + 2, lane] = flow.gravity_z
    scratch[LIMIT, lane] = speed_limit(cell, cells, flow)
    if cells.walled[cell]:
        _pull_at_wall(cell, lane, cells, before, scratch, flow)
    elif cells.flags[cell] == INTERFACE:
        _pull_at_surface(cell, lane, cells, before, scratch)
    else:
        for i in range(N_DIRECTIONS):
            scratch[i, lane] = before[cell - cells.offsets[i], i]


@kernel
def _pull_at_surface(cell: int, lane: int, cells: Any, before: Any, scratch: Any) -> None:
    """Gather what moves into an interface cell far from walls."""
    ux, uy, uz = cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell]
    square = ux * ux + uy * uy + uz * uz
    fill, kind = cells.fill[cell], cells.kinds[cell]
    scratch[0, lane] = before[cell, 0]
    gained = 0.0
    for i in range(1, N_DIRECTIONS):
        other = cell - cells.offsets[i]
        leaving = before[cell, OPPOSITE[i]]
        if cells.flags[other] == GAS:
            scratch[i, lane] = _from_gas(i, ux, uy, uz, square) - leaving
        else:
            arriving = before[other, i]
            scratch[i, lane] = arriving
            gained += _gained(i, fill, kind, other, cells, arriving, leaving)
    cells.mass[cell] += gained


@kernel
def _pull_at_wall(cell: int, lane: int, cells: Any, before: Any, scratch: Any, flow: Any) -> None:
    """Gather what moves into a cell that touches a wall."""
    flags = cells.flags
    ux, uy, uz = cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell]
    square = ux * ux + uy * uy + uz * uz
    fill, kind = cells.fill[cell], cells.kinds[cell]
    at_surface = flags[cell] == INTERFACE
    gained = 0.0
    links = 0
    for i in range(N_DIRECTIONS):
        other, source, way = _source(i, cell, cells)
        leaving = before[cell, OPPOSITE[i]]
        free = 0.0 if flags[other] == SOLID else cells.passage[cells.links[cell], way]
        found = 0.0
        if free < 1.0:
            if at_surface and leaves(i, wall_of(way, cell, cells), cell, cells):
                found = (1.0 - free) * (_from_gas(i, ux, uy, uz, square) - leaving)
            else:
                found = (1.0 - free) * leaving
                scratch[LINKS + links, lane] = i
                scratch[STOPPED + links, lane] = 1.0 - free
                scratch[WAYS + links, lane] = way
                links += 1
        if free > 0.0 and flags[other] == GAS:
            found += free * (_from_gas(i, ux, uy, uz, square) - leaving)
        elif free > 0.0:
            arriving = before[other, source]
            found += free * arriving
            if at_surface and other != cell:
                gained += free * _gained(i, fill, kind, other, cells, arriving, leaving)
        scratch[i, lane] = found
    if at_surface:
        cells.mass[cell] += gained * cells.room[cell]
    _drag(cell, lane, cells, scratch, flow)
    if links > 0:
        _slide(cell, lane, cells, links, scratch, flow)
    if flow.adhesion > 0.0:
        _adhere(cell, lane, cells, scratch, flow.adhesion)


@kernel
def _source(i: int, cell: int, cells: Any) -> Any:
    """Where a population comes from, which it was there, and the passage that it took.

    A wall across an axis that lets liquid slip is a mirror: what comes from it has come from the
    neighbour along it. Where two meet, it has come from the cell itself.
    """
    axis = mirror_of(i, cell, cells)
    if axis == 0:
        return cell - cells.offsets[i], i, i
    way, source = FLATTENED[axis - 1, i], MIRRORED[axis - 1, i]
    second = mirror_of(way, cell, cells)
    if second > 0:
        way, source = FLATTENED[second - 1, way], MIRRORED[second - 1, source]
    return cell - cells.offsets[way], source, way


@kernel
def mirror_of(i: int, cell: int, cells: Any) -> int:
    """Axis of the mirror that population `i` comes out of, from 1; 0 where there is none."""
    other = cell - cells.offsets[i]
    axis = int(cells.axis[other]) if cells.flags[other] == SOLID else 0
    if axis > 0 and VELOCITY[i, axis - 1] != 0:
        step = VELOCITY[i, axis - 1] * cells.offsets[2 * axis - 1]
        beside = other + step
        open_beside = cells.flags[beside] != SOLID or cells.axis[beside] > 0
        if cells.axis[cell - step] == axis and open_beside:
            return axis
    return 0


@kernel
def _from_gas(i: int, ux: float, uy: float, uz: float, square: float) -> Any:
    """Populations `i` and its opposite in a liquid as dense as at rest, together."""
    along = _C[i, 0] * ux + _C[i, 1] * uy + _C[i, 2] * uz
    return 2.0 * _W[i] * (4.5 * along * along - 1.5 * square)


@kernel
def _gained(
    i: int, fill: float, kind: int, other: int, cells: Any, arriving: float, leaving: float
) -> Any:
    """Mass that an interface cell gains from a neighbour."""
    if cells.flags[other] == FLUID:
        return arriving - leaving
    share = 0.5 * (fill + cells.fill[other])
    return share * _exchanged(i, kind, cells.kinds[other], arriving, leaving)


@kernel
def wall_of(i: int, cell: int, cells: Any) -> Any:
    """Cell whose surface stops what takes passage `i`: a solid one, or that with less room."""
    other = cell - cells.offsets[i]
    return other if cells.room[other] < cells.room[cell] else cell


@kernel
def leaves(i: int, wall: int, cell: int, cells: Any) -> Any:
    """Whether liquid moves away from the wall that stops population `i`.

    A wall has no hold on it then, once the gas gets between (`interface.ventilates`). Else the wall
    would suck: water that shoots over an edge would turn round it, and honey creep along undersides
    that it never wetted.
    """
    nx, ny, nz = cells.normal[0, wall], cells.normal[1, wall], cells.normal[2, wall]
    ux, uy, uz = cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell]
    across = nx * ux + ny * uy + nz * uz
    outwards = nx * _C[i, 0] + ny * _C[i, 1] + nz * _C[i, 2]
    # Beside a wall that holds liquid, what moves along it is not taken for leaving.
    least = _LEAVING * (1.0 - cells.slip[wall]) * np.sqrt(ux * ux + uy * uy + uz * uz)
    return across * outwards > least * abs(outwards)


@kernel
def _slide(cell: int, lane: int, cells: Any, links: int, scratch: Any, flow: Any) -> None:
    """Let walls move along with the liquid, as far as they let it slip.

    Along a slope, each link takes what another gives; both are noted, so that none is lost or won
    (`interface.settle`).
    """
    for k in range(links):
        i = int(scratch[LINKS + k, lane])
        wall = wall_of(int(scratch[WAYS + k, lane]), cell, cells)
        # Freely falling populations have been pushed by half a step more than the velocity tells;
        # where a wall holds them, the push is soon in balance with its drag.
        push = 0.5 if cells.slip[wall] == 1.0 else 0.0
        ux = cells.velocity[0, cell] + push * flow.gravity_x
        uy = cells.velocity[1, cell] + push * flow.gravity_y
        uz = cells.velocity[2, cell] + push * flow.gravity_z
        nx, ny, nz = cells.normal[0, wall], cells.normal[1, wall], cells.normal[2, wall]
        across = ux * nx + uy * ny + uz * nz
        along = (
            _C[i, 0] * (ux - across * nx)
            + _C[i, 1] * (uy - across * ny)
            + _C[i, 2] * (uz - across * nz)
        )
        gain = 6.0 * WEIGHT[i] * cells.density[cell] * cells.slip[wall] * along
        gain *= scratch[STOPPED + k, lane]
        scratch[i, lane] += gain
        cells.leaked[cell] += gain * cells.room[cell]


@kernel
def wall_stress(speed: float, viscosity: float) -> Any:
    """Stress over density at a wall, of liquid that moves at a speed half a cell from it.

    The power law of the wall, u+ = 8.3 (y+)^(1/7), and the viscous sublayer below it (Werner &
    Wengle 1991, 8th Symposium on Turbulent Shear Flows).
    """
    viscous = 2.0 * viscosity * speed
    friction_speed = (speed / 8.3) ** 0.875 * (2.0 * viscosity) ** 0.125
    return max(viscous, friction_speed * friction_speed)


@kernel
def _drag(cell: int, lane: int, cells: Any, scratch: Any, flow: Any) -> None:
    """Slow a cell by the boundary layers of the rough walls beside it."""
    nx, ny, nz = cells.face[0, cell], cells.face[1, cell], cells.face[2, cell]
    area = np.sqrt(nx * nx + ny * ny + nz * nz)
    if area < 1e-3:
        return
    nx, ny, nz = nx / area, ny / area, nz / area
    ux, uy, uz = cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell]
    across = ux * nx + uy * ny + uz * nz
    ux, uy, uz = ux - across * nx, uy - across * ny, uz - across * nz
    speed = np.sqrt(ux * ux + uy * uy + uz * uz)
    if speed < 1e-7:
        return
    # No more than what stops it; a cell that is not full has less to be slowed.
    held = max(cells.fill[cell], 0.1)
    rate = min(area * wall_stress(speed, flow.viscosity) / (held * speed), 0.5)
    scratch[FORCE, lane] -= rate * ux
    scratch[FORCE + 1, lane] -= rate * uy
    scratch[FORCE + 2, lane] -= rate * uz


@kernel
def _adhere(cell: int, lane: int, cells: Any, scratch: Any, adhesion: float) -> None:
    """Accelerate a cell towards the walls beside it."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(1, N_DIRECTIONS):
        stopped = 1.0 - cells.passage[cells.links[cell], i]
        if cells.flags[cell - cells.offsets[i]] == SOLID:
            stopped = 1.0
        x -= stopped * WEIGHT[i] * _C[i, 0]
        y -= stopped * WEIGHT[i] * _C[i, 1]
        z -= stopped * WEIGHT[i] * _C[i, 2]
    factor = adhesion / np.sqrt(x * x + y * y + z * z + 1e-12)
    scratch[FORCE, lane] += factor * x
    scratch[FORCE + 1, lane] += factor * y
    scratch[FORCE + 2, lane] += factor * z


@kernel
def _relax(scratch: Any, flow: Any) -> None:
    """Relax `LANES` cells side by side, in place; leaves their density and velocity in scratch."""
    zero = splat(0.0)
    excess, jx, jy, jz = zero, zero, zero, zero
    pxx, pyy, pzz, pxy, pxz, pyz = zero, zero, zero, zero, zero, zero
    for i in range(N_DIRECTIONS):
        f = load(scratch, i)
        cx, cy, cz = _C[i, 0], _C[i, 1], _C[i, 2]
        excess = excess + f
        jx, jy, jz = jx + cx * f, jy + cy * f, jz + cz * f
        pxx, pyy, pzz = pxx + cx * cx * f, pyy + cy * cy * f, pzz + cz * cz * f
        pxy, pxz, pyz = pxy + cx * cy * f, pxz + cx * cz * f, pyz + cy * cz * f
    density = excess + 1.0
    gx, gy, gz = load(scratch, FORCE), load(scratch, FORCE + 1), load(scratch, FORCE + 2)
    ux, uy, uz = jx / density + 0.5 * gx, jy / density + 0.5 * gy, jz / density + 0.5 * gz
    speed = sqrt(ux * ux + uy * uy + uz * uz)
    limit = load(scratch, LIMIT)
    slowed = limit / maximum(speed, limit)
    ux, uy, uz = ux * slowed, uy * slowed, uz * slowed
    mx, my, mz = density * ux, density * uy, density * uz
    fx, fy, fz = 0.5 * density * gx, 0.5 * density * gy, 0.5 * density * gz
    # (u F + F u) / 2
    wxx, wyy, wzz = 2.0 * ux * fx, 2.0 * uy * fy, 2.0 * uz * fz
    wxy, wxz, wyz = ux * fy + uy * fx, ux * fz + uz * fx, uy * fz + uz * fy
    pressure = excess / 3.0
    qxx = pxx - pressure - mx * ux + wxx
    qyy = pyy - pressure - my * uy + wyy
    qzz = pzz - pressure - mz * uz + wzz
    mean = (qxx + qyy + qzz) / 3.0
    qxx, qyy, qzz = qxx - mean, qyy - mean, qzz - mean
    qxy, qxz, qyz = pxy - mx * uy + wxy, pxz - mx * uz + wxz, pyz - my * uz + wyz
    stress = sqrt(qxx * qxx + qyy * qyy + qzz * qzz + 2.0 * (qxy * qxy + qxz * qxz + qyz * qyz))
    tau = flow.relaxation_time
    turbulent = 0.5 * (tau + sqrt(tau * tau + flow.smagorinsky * stress / density))
    kept = 1.0 - 1.0 / turbulent
    axx, ayy, azz = (
        mx * ux + kept * qxx + wxx,
        my * uy + kept * qyy + wyy,
        mz * uz + kept * qzz + wzz,
    )
    axy, axz, ayz = (
        mx * uy + kept * qxy + wxy,
        mx * uz + kept * qxz + wxz,
        my * uz + kept * qyz + wyz,
    )
    store(scratch, MOMENTS, density)
    store(scratch, MOMENTS + 1, ux)
    store(scratch, MOMENTS + 2, uy)
    store(scratch, MOMENTS + 3, uz)
    kx, ky, kz = mx + fx, my + fy, mz + fz
    even = excess - 1.5 * (axx + ayy + azz)
    store(scratch, 0, _W[0] * even)
    for i in range(1, N_DIRECTIONS, 2):
        cx, cy, cz = _C[i, 0], _C[i, 1], _C[i, 2]
        form = cx * cx * axx + cy * cy * ayy + cz * cz * azz
        form = form + 2.0 * (cx * cy * axy + cx * cz * axz + cy * cz * ayz)
        alike = _W[i] * (even + 4.5 * form)
        beyond = 0.5 * (load(scratch, i) - load(scratch, i + 1))
        beyond = beyond - 3.0 * _W[i] * (cx * jx + cy * jy + cz * jz)
        unlike = 3.0 * _W[i] * (cx * kx + cy * ky + cz * kz) + flow.odd_kept * beyond
        store(scratch, i, alike + unlike)
        store(scratch, i + 1, alike - unlike)


@kernel
def update(
    first: int, last: int, active: Any, cells: Any, here: int, scratch: Any, flow: Any
) -> None:
    """Step the cells `active[first:last]`: from populations `here` to the others.

    Each cell writes to itself alone, so that ranges can be stepped side by side.
    """
    before, after = cells.populations[here], cells.populations[1 - here]
    for start in range(first, last, LANES):
        count = min(LANES, last - start)
        for lane in range(count):
            _pull(active[start + lane], lane, cells, before, scratch, flow)
        for lane in range(count, LANES):
            for row in range(LINKS):
                scratch[row, lane] = 0.0
            scratch[LIMIT, lane] = TOP_SPEED
        _relax(scratch, flow)
        for lane in range(count):
            cell = active[start + lane]
            for i in range(N_DIRECTIONS):
                after[cell, i] = scratch[i, lane]
            cells.density[cell] = scratch[MOMENTS, lane]
            for axis in range(3):
                cells.velocity[axis, cell] = scratch[MOMENTS + 1 + axis, lane]
