"""Liquid in pieces smaller than a cell: it flies, slides along walls, and joins what it meets.

A droplet is a point with a mass. It loses the part of its velocity across a wall that it meets, as
the liquid would. Where walls hold the liquid, it is a film of its own mass spread over a cell, and
creeps as Nusselt's film does (drag rate 3 nu / (h (h + 3 L)), with the slip length L). Droplets in
one cell are one; once they fill it, it is fluid.
"""

from typing import Any

import numpy as np

from pourcast.engine.compile import kernel
from pourcast.stimuli.lattice_boltzmann.collide import equilibrium, speed_limit
from pourcast.stimuli.lattice_boltzmann.interface import hand_out, is_joined, move_evenly
from pourcast.stimuli.lattice_boltzmann.lattice import (
    FLUID,
    GAS,
    INTERFACE,
    N_DIRECTIONS,
)

_OPEN = 0.5
"""Room from which on a cell is open to droplets."""

_STEPS_ASIDE = (0.0, 0.5, -0.5, 1.0, -1.0)
"""How far beside its path [cells] a droplet looks for room along a staircase of cells."""


@kernel
def fly(cells: Any, parts: Any, there: int, flow: Any) -> None:
    """Move all droplets by a step."""
    drops = parts.droplets
    kept = 0
    for k in range(parts.counts[1]):
        _move(k, cells, drops, flow)
        cell = _cell(drops[0, k], drops[1, k], drops[2, k], cells)
        flag = cells.flags[cell]
        if flag in (INTERFACE, FLUID):
            _join(k, cell, cells, parts, there)
        elif cells.slots[cell] > 0:
            _merge(k, cells.slots[cell] - 1, drops)
        else:
            for row in range(7):
                drops[row, kept] = drops[row, k]
            kept += 1
            cells.slots[cell] = kept
    left = 0
    for k in range(kept):
        cell = _cell(drops[0, k], drops[1, k], drops[2, k], cells)
        cells.slots[cell] = 0
        if drops[6, k] >= cells.room[cell] and cells.flags[cell] == GAS:
            _condense(k, cell, cells, parts, there, flow)
            continue
        for row in range(7):
            drops[row, left] = drops[row, k]
        left += 1
    parts.counts[1] = left


@kernel
def _cell(x: float, y: float, z: float, cells: Any) -> Any:
    return int(x) * cells.offsets[1] + int(y) * cells.offsets[3] + int(z)


@kernel
def _move(k: int, cells: Any, drops: Any, flow: Any) -> None:
    """Fall, and slide along what is in the way."""
    vx = drops[3, k] + flow.gravity_x
    vy = drops[4, k] + flow.gravity_y
    vz = drops[5, k] + flow.gravity_z
    x, y, z = drops[0, k], drops[1, k], drops[2, k]
    here = _cell(x, y, z, cells)
    limit = speed_limit(here, cells, flow)
    slowed = min(1.0, limit / np.sqrt(vx * vx + vy * vy + vz * vz + 1e-30))
    vx, vy, vz = vx * slowed, vy * slowed, vz * slowed
    wall = _cell(x + vx, y + vy, z + vz, cells)
    if _is_open(here, wall, cells):
        _place(k, drops, x + vx, y + vy, z + vz, vx, vy, vz)
        return
    nx, ny, nz = cells.normal[0, wall], cells.normal[1, wall], cells.normal[2, wall]
    across = vx * nx + vy * ny + vz * nz
    thickness = min(max(drops[6, k], 1e-3), 1.0)
    held = 1.0 if cells.rough[wall] else 1.0 - cells.slip[wall]
    drag = 3.0 * flow.viscosity * held / (thickness * (held * thickness + 1.5 * (1.0 - held)))
    drag += 1.0
    vx, vy, vz = (vx - across * nx) / drag, (vy - across * ny) / drag, (vz - across * nz) / drag
    for aside in _STEPS_ASIDE:
        px, py, pz = x + vx + aside * nx, y + vy + aside * ny, z + vz + aside * nz
        if _is_open(here, _cell(px, py, pz, cells), cells):
            _place(k, drops, px, py, pz, vx, vy, vz)
            return
    _place(k, drops, x, y, z, 0.0, 0.0, 0.0)


@kernel
def _is_open(here: int, there: int, cells: Any) -> Any:
    """Whether a droplet can go from one cell to another beside it."""
    if cells.room[there] < _OPEN:
        return False
    if here == there:
        return True
    for i in range(1, N_DIRECTIONS):
        if here + cells.offsets[i] == there:
            return is_joined(i, here, cells)
    # No link leads across a corner.
    return cells.room[here] == 1.0 and cells.room[there] == 1.0


@kernel
def _place(
    k: int, drops: Any, x: float, y: float, z: float, vx: float, vy: float, vz: float
) -> None:
    drops[0, k], drops[1, k], drops[2, k] = x, y, z
    drops[3, k], drops[4, k], drops[5, k] = vx, vy, vz


@kernel
def _merge(k: int, into: int, drops: Any) -> None:
    """Let one droplet join another: mass, momentum and centre of mass stay."""
    mass = drops[6, k] + drops[6, into]
    share = drops[6, k] / mass
    for row in range(6):
        drops[row, into] += share * (drops[row, k] - drops[row, into])
    drops[6, into] = mass


@kernel
def _join(k: int, cell: int, cells: Any, parts: Any, there: int) -> None:
    """Let a droplet join the liquid of a cell, with its momentum."""
    drops = parts.droplets
    mass = drops[6, k]
    share = mass / (max(cells.mass[cell], 0.0) + mass)
    density = cells.density[cell]
    ux, uy, uz = cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell]
    vx = ux + share * (drops[3, k] - ux)
    vy = uy + share * (drops[4, k] - uy)
    vz = uz + share * (drops[5, k] - uz)
    for i in range(N_DIRECTIONS):
        change = equilibrium(i, density, vx, vy, vz) - equilibrium(i, density, ux, uy, uz)
        cells.populations[there, cell, i] += change
    cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell] = vx, vy, vz
    if cells.flags[cell] == INTERFACE:
        cells.mass[cell] += mass
    else:
        hand_out(mass, cell, 0.0, cells, parts)


@kernel
def _condense(k: int, cell: int, cells: Any, parts: Any, there: int, flow: Any) -> None:
    """Make fluid of droplets that fill a cell, and interface of the empty cells around it."""
    drops = parts.droplets
    vx, vy, vz = drops[3, k], drops[4, k], drops[5, k]
    cells.flags[cell] = FLUID
    _activate(cell, cells, parts, there, flow, 1.0, vx, vy, vz)
    for i in range(1, N_DIRECTIONS):
        other = cell + cells.offsets[i]
        if cells.flags[other] == GAS and is_joined(i, cell, cells):
            cells.flags[other] = INTERFACE
            _activate(other, cells, parts, there, flow, 0.0, vx, vy, vz)
    hand_out(drops[6, k] - cells.room[cell], cell, 0.0, cells, parts)


@kernel
def _activate(
    cell: int, cells: Any, parts: Any, there: int, flow: Any, fill: float,
    vx: float, vy: float, vz: float,
) -> None:  # fmt: skip
    move_evenly(cell, cells, there, flow, 1.0, vx, vy, vz)
    cells.mass[cell] = fill * cells.room[cell]
    cells.fill[cell] = fill
    cells.kinds[cell] = 0
    parts.active[parts.counts[0]] = cell
    parts.counts[0] += 1
