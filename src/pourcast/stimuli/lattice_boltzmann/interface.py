"""The surface moves: cells fill and empty, and what is too thin for the grid becomes droplets.

Cells are converted as in Koerner et al. (2005, section 3.3) and Thuerey (2007, section 4.2): an
interface cell that holds more than it can becomes fluid, and its empty neighbours interface; one
that holds less than nothing becomes gas, and its full neighbours interface; the excess goes to the
interface cells around.

A film or thread without a single full cell can't move by these rules, for only full cells open the
way to empty ones: it would hang in the air. Such cells become droplets (`droplets`), which fall as
bodies do until they meet liquid again.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.stimuli.lattice_boltzmann.collide import equilibrium, leaves, mirror_of, wall_of
from pourcast.stimuli.lattice_boltzmann.lattice import (
    FLATTENED,
    FLUID,
    GAS,
    INTERFACE,
    N_DIRECTIONS,
    NO_FLUID,
    NO_GAS,
    OPPOSITE,
    SOLID,
    STANDARD,
    VELOCITY,
)

_OVERFULL = 1e-3
"""A cell is filled, or emptied, when it is so far beyond (Koerner et al. 2005)."""
_LEFT_BEHIND = 0.1
"""Without full or empty neighbours, when it is so close to it (Thuerey 2007)."""
_DRAINED = 0.05
"""Such a debt of a cell keeps its neighbours from being filled before it is emptied."""
_EMPTIED, _NEW = 1, 2


@kernel
def convert(cells: Any, parts: Any, there: int, flow: Any) -> None:
    """Turn interface cells into fluid and gas, and back, after a step to populations `there`."""
    n_filled, n_emptied = _find_changed(cells, parts)
    for k in range(n_filled):
        _fill(parts.changed[0, k], cells, parts)
    _start_new(cells, parts, there, flow)
    for k in range(n_emptied):
        cell = parts.changed[1, k]
        if cells.marks[cell] == _EMPTIED:
            _empty(cell, cells)
    for k in range(n_filled):
        cell = parts.changed[0, k]
        hand_out(cells.mass[cell] - full_mass(cell, cells), cell, 1.0, cells, parts)
    for k in range(n_emptied):
        cell = parts.changed[1, k]
        if cells.marks[cell] == _EMPTIED:
            cells.marks[cell] = 0
            hand_out(cells.mass[cell], cell, -1.0, cells, parts)
            cells.mass[cell] = 0.0
    settle(cells, parts)


@kernel
def _find_changed(cells: Any, parts: Any) -> tuple[int, int]:
    """List the interface cells that are overfull, and mark and list those that are empty."""
    n_filled, n_emptied = 0, 0
    for k in range(parts.counts[0]):
        cell = parts.active[k]
        if cells.flags[cell] == FLUID and cells.density[cell] < 1.0 and ventilates(cell, cells):
            cells.flags[cell] = INTERFACE
            cells.mass[cell] = full_mass(cell, cells) - cells.leaked[cell]
            cells.kinds[cell] = STANDARD
        if cells.flags[cell] != INTERFACE:
            continue
        mass, full, kind = cells.mass[cell], full_mass(cell, cells), cells.kinds[cell]
        limit = 1.0 - _LEFT_BEHIND if kind == NO_GAS else 1.0 + _OVERFULL
        least = _LEFT_BEHIND if kind == NO_FLUID else -_OVERFULL
        if mass > limit * full:
            parts.changed[0, n_filled] = cell
            n_filled += 1
        elif mass < least * full:
            parts.changed[1, n_emptied] = cell
            cells.marks[cell] = _EMPTIED
            n_emptied += 1
    kept = 0
    for k in range(n_filled):
        if not _beside_drained(parts.changed[0, k], cells):
            parts.changed[0, kept] = parts.changed[0, k]
            kept += 1
    return kept, n_emptied


@kernel
def full_mass(cell: int, cells: Any) -> Any:
    """Mass that a cell holds when it is full."""
    return cells.density[cell] * cells.room[cell]


@kernel
def _way(i: int, cell: int, cells: Any) -> tuple[int, int]:
    """Direction of what is seen in direction `i`, and the axis of the mirror; 0 without one.

    What the surface does beside a mirror is what it would do without: liquid that is the same in
    front and behind stays so.
    """
    axis = mirror_of(OPPOSITE[i], cell, cells)
    return i if axis == 0 else FLATTENED[axis - 1, i], axis


@kernel
def _fill_seen(i: int, cell: int, cells: Any) -> Any:
    """Fill of a neighbour; beside a solid that of the cell itself, so that nothing leans to it."""
    other = cell + cells.offsets[i]
    return cells.fill[cell if cells.flags[other] == SOLID else other]


@kernel
def is_joined(i: int, cell: int, cells: Any) -> Any:
    """Whether liquid can move to the neighbour in direction `i`: no wall parts it from there."""
    return cells.passage[cells.links[cell], OPPOSITE[i]] > 0.0


@kernel
def is_walled(i: int, cell: int, cells: Any) -> Any:
    """Whether something in the way of population `i` is no mirror."""
    other = cell - cells.offsets[i]
    if cells.flags[other] == SOLID:
        return cells.axis[other] == 0
    return cells.passage[cells.links[cell], i] < 1.0


@kernel
def _beside_drained(cell: int, cells: Any) -> Any:
    """Whether a neighbour has given much more than it held: it must be emptied first."""
    for i in range(1, N_DIRECTIONS):
        other = cell + cells.offsets[i]
        drained = cells.mass[other] < -_DRAINED * cells.room[other]
        if drained and cells.marks[other] == _EMPTIED and is_joined(i, cell, cells):
            return True
    return False


@kernel
def ventilates(cell: int, cells: Any) -> Any:
    """Whether a cell's liquid moves away from a wall that has no hold on it: gas gets between.

    A full cell does so as soon as the wall would have to pull, its pressure below the gas's.
    """
    if cells.walled[cell]:
        for i in range(1, N_DIRECTIONS):
            wall = wall_of(i, cell, cells)
            if is_walled(i, cell, cells) and leaves(i, wall, cell, cells):
                return True
    return False


@kernel
def _fill(cell: int, cells: Any, parts: Any) -> None:
    """Make an interface cell fluid; no neighbour of it may be gas."""
    cells.flags[cell] = FLUID
    cells.leaked[cell] = 0.0  # an interface cell's mass has nothing of it
    for i in range(1, N_DIRECTIONS):
        other = cell + cells.offsets[i]
        if not is_joined(i, cell, cells):
            continue
        if cells.marks[other] == _EMPTIED:
            cells.marks[other] = 0
        if cells.flags[other] == GAS:
            cells.flags[other] = INTERFACE
            cells.mass[other] = 0.0
            cells.fill[other] = 0.0
            cells.marks[other] = _NEW
            parts.active[parts.counts[0]] = other
            parts.counts[0] += 1


@kernel
def _start_new(cells: Any, parts: Any, there: int, flow: Any) -> None:
    """Let new interface cells move as the liquid around them."""
    first = parts.counts[0]
    while first > 0 and cells.marks[parts.active[first - 1]] == _NEW:
        first -= 1
    for k in range(first, parts.counts[0]):
        cell = parts.active[k]
        density, ux, uy, uz, found = 0.0, 0.0, 0.0, 0.0, 0
        for i in range(1, N_DIRECTIONS):
            way, mirror = _way(i, cell, cells)
            other = cell + cells.offsets[way]
            if not is_joined(way, cell, cells):
                continue
            if cells.flags[other] in (FLUID, INTERFACE) and cells.marks[other] != _NEW:
                density += cells.density[other]
                ux += -cells.velocity[0, other] if mirror == 1 else cells.velocity[0, other]
                uy += -cells.velocity[1, other] if mirror == 2 else cells.velocity[1, other]
                uz += -cells.velocity[2, other] if mirror == 3 else cells.velocity[2, other]
                found += 1
        move_evenly(cell, cells, there, flow, density / found, ux / found, uy / found, uz / found)
    for k in range(first, parts.counts[0]):
        cells.marks[parts.active[k]] = 0


@kernel
def move_evenly(
    cell: int, cells: Any, there: int, flow: Any, density: float, ux: float, uy: float, uz: float
) -> None:
    """Set a cell's populations to those of a liquid in even motion that has just been pushed."""
    cells.density[cell] = density
    cells.velocity[0, cell], cells.velocity[1, cell], cells.velocity[2, cell] = ux, uy, uz
    vx, vy, vz = ux + 0.5 * flow.gravity_x, uy + 0.5 * flow.gravity_y, uz + 0.5 * flow.gravity_z
    for i in range(N_DIRECTIONS):
        cells.populations[there, cell, i] = equilibrium(i, density, vx, vy, vz)


@kernel
def _empty(cell: int, cells: Any) -> None:
    """Make an interface cell gas; no neighbour of it may be fluid."""
    cells.flags[cell] = GAS
    for i in range(1, N_DIRECTIONS):
        other = cell + cells.offsets[i]
        if cells.flags[other] == FLUID and is_joined(i, cell, cells):
            cells.flags[other] = INTERFACE
            cells.mass[other] = full_mass(other, cells) - cells.leaked[other]


@kernel
def hand_out(mass: float, cell: int, side: float, cells: Any, parts: Any) -> None:
    """Give mass to the interface cells around a cell; without any, let it fly or owe it.

    As in Thuerey (2007, section 4.2), those get it that lie outwards along the surface's normal
    (`side` 1: the surface has moved on), or inwards (`side` -1: it draws back); if there are none
    of them, all of them (as with `side` 0). Were it given all around, the surface would lag behind.
    """
    nx = side * (_fill_seen(2, cell, cells) - _fill_seen(1, cell, cells))
    ny = side * (_fill_seen(4, cell, cells) - _fill_seen(3, cell, cells))
    nz = side * (_fill_seen(6, cell, cells) - _fill_seen(5, cell, cells))
    total, found = 0.0, 0
    for i in range(1, N_DIRECTIONS):
        way, _ = _way(i, cell, cells)
        other = cell + cells.offsets[way]
        if cells.flags[other] == INTERFACE and is_joined(way, cell, cells):
            found += 1
            total += _outwards(i, nx, ny, nz)
    if found == 0:
        if mass > 0.0 and cells.flags[cell] == GAS:
            release(mass, cell, cells, parts)
        else:
            parts.owed[0] += mass
        return
    for i in range(1, N_DIRECTIONS):
        way, _ = _way(i, cell, cells)
        other = cell + cells.offsets[way]
        if cells.flags[other] == INTERFACE and is_joined(way, cell, cells):
            share = _outwards(i, nx, ny, nz) / total if total > 1e-6 else 1.0 / found
            cells.mass[other] += share * mass


@kernel
def _outwards(i: int, nx: float, ny: float, nz: float) -> Any:
    return max(0.0, VELOCITY[i, 0] * nx + VELOCITY[i, 1] * ny + VELOCITY[i, 2] * nz)


@kernel
def release(mass: float, cell: int, cells: Any, parts: Any) -> None:
    """Make a droplet in the middle of a cell, as fast as the cell."""
    count = parts.counts[1]
    if count >= parts.droplets.shape[1]:
        parts.owed[0] += mass
        return
    depth = cells.offsets[3]
    layer = cells.offsets[1]
    parts.droplets[0, count] = cell // layer + 0.5
    parts.droplets[1, count] = cell % layer // depth + 0.5
    parts.droplets[2, count] = cell % depth + 0.5
    for axis in range(3):
        parts.droplets[3 + axis, count] = cells.velocity[axis, cell]
    parts.droplets[6, count] = mass
    parts.counts[1] += 1


@kernel
def settle(cells: Any, parts: Any) -> None:
    """Renew mass, fill and kind of all cells, pay what is owed, and list those with liquid."""
    surface = 0
    for k in range(parts.counts[0]):
        cell = parts.active[k]
        if cells.flags[cell] == INTERFACE:
            surface += 1
        elif cells.flags[cell] == FLUID:
            parts.owed[0] -= cells.leaked[cell]
            cells.mass[cell] = full_mass(cell, cells)
            cells.fill[cell] = 1.0
        cells.leaked[cell] = 0.0
    gift = parts.owed[0] / surface if surface > 0 else 0.0
    if surface > 0:
        parts.owed[0] = 0.0
    for k in range(parts.counts[0]):
        cell = parts.active[k]
        if cells.flags[cell] == INTERFACE:
            cells.mass[cell] += gift
            cells.fill[cell] = min(max(cells.mass[cell] / full_mass(cell, cells), 0.0), 1.0)
            cells.kinds[cell] = _kind(cell, cells)
    _release_films(cells, parts)
    kept = 0
    for k in range(parts.counts[0]):
        cell = parts.active[k]
        if cells.flags[cell] == GAS:
            cells.fill[cell] = 0.0
            continue
        parts.active[kept] = cell
        kept += 1
    parts.counts[0] = kept


@kernel
def _kind(cell: int, cells: Any) -> int:
    fluid, gas = False, False
    for i in range(1, N_DIRECTIONS):
        if not is_joined(i, cell, cells):
            continue
        flag = cells.flags[cell + cells.offsets[i]]
        fluid = fluid or flag == FLUID
        gas = gas or flag == GAS
    if not fluid:
        return NO_FLUID
    return STANDARD if gas or ventilates(cell, cells) else NO_GAS


@kernel
def _release_films(cells: Any, parts: Any) -> None:
    """Turn interface cells far from any full one into droplets."""
    for k in range(parts.counts[0]):
        cell = parts.active[k]
        if cells.flags[cell] != INTERFACE or cells.kinds[cell] != NO_FLUID:
            continue
        held = False
        for i in range(1, N_DIRECTIONS):
            other = cell + cells.offsets[i]
            beside = cells.flags[other] == INTERFACE and cells.kinds[other] != NO_FLUID
            if beside and is_joined(i, cell, cells):
                held = True
                break
        if not held:
            cells.marks[cell] = _EMPTIED
    for k in range(parts.counts[0]):
        cell = parts.active[k]
        if cells.marks[cell] == _EMPTIED:
            cells.marks[cell] = 0
            cells.flags[cell] = GAS
            if cells.mass[cell] > 0.0:
                release(cells.mass[cell], cell, cells, parts)
            else:
                parts.owed[0] += cells.mass[cell]
            cells.mass[cell] = 0.0
