"""The rules by which molecules move on a grid: the kernels of `blobs`, apart as they need Numba.

Cells are numbered row by row from the floor, from left to right. In a time step every molecule
has its turn once, from the lowest row upwards, and goes to a cell beside, below or above its own.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import kernel

_STEP, _QUESTION = 0, 1
"""Places in `Molecules.counts`."""


class Molecules(NamedTuple):
    """Molecules on a grid, and what they have told one another; kernels change all but the ways."""

    down: NDArray[np.bool_]
    """Whether there is a way from a cell to the one below, shape [cell_count]."""
    right: NDArray[np.bool_]
    """Whether there is a way to the one on the right; there is none from the last of a row."""
    who: NDArray[np.int64]
    """Number of the molecule in a cell, -1 if it is free, shape [cell_count]."""
    cell: NDArray[np.int64]
    """Cell of each molecule, shape [molecule_count]."""
    who_was: NDArray[np.int64]
    """`who` at the beginning of the time step: what molecules know when they ask for room."""
    was_in: NDArray[np.int64]
    """`cell` at the beginning of the time step."""
    heading: NDArray[np.int64]
    """Side to which each last moved: 1 for right, -1 for left."""
    moved: NDArray[np.int64]
    """Time step in which each last moved."""
    denied: NDArray[np.int64]
    """Time step in which a cell last heard that there is no room, shape [cell_count]."""
    asked: NDArray[np.int64]
    """Number of the last question that came to a cell."""
    asker: NDArray[np.int64]
    """Cell from which that question came."""
    queue: NDArray[np.int64]
    """Cells to which a question has come, the nearest first."""
    counts: NDArray[np.int64]
    """Time steps and questions so far."""


def place_molecules(
    down: NDArray[np.bool_],
    right: NDArray[np.bool_],
    start: NDArray[np.int64],
    heading: NDArray[np.int64],
) -> Molecules:
    """Molecules where they start.

    Parameters
    ----------
    down, right
        Where there are ways, shape [row_count, column_count] both; see `Molecules`.
    start
        Cell of each molecule, shape [molecule_count].
    heading
        Side that each prefers at first, 1 or -1.
    """
    who = np.full(down.size, -1)
    who[start] = np.arange(len(start))
    return Molecules(
        who_was=who.copy(), was_in=start.copy(),
        down=down.ravel(), right=right.ravel(), who=who, cell=start.copy(), heading=heading.copy(),
        moved=np.zeros(len(start), np.int64), denied=np.zeros(down.size, np.int64),
        asked=np.zeros(down.size, np.int64), asker=np.zeros(down.size, np.int64),
        queue=np.zeros(down.size, np.int64), counts=np.zeros(2, np.int64),
    )  # fmt: skip


@kernel
def move_to_rest(molecules: Any, columns: int) -> None:
    """Let molecules move until none does.

    That comes to pass: none rises, and whoever moves without falling is nearer to room.

    Parameters
    ----------
    molecules
        The molecules; changed in place.
    columns
        Number of cells in a row.
    """
    while move_once(molecules, columns):
        pass


@kernel
def move_once(molecules: Any, columns: int) -> bool:
    """Let a time step pass.

    Parameters
    ----------
    molecules
        The molecules; changed in place.
    columns
        Number of cells in a row.

    Returns
    -------
    bool
        Whether any molecule moved.
    """
    molecules.counts[_STEP] += 1
    any_moved = False
    for row in range(_look_around(molecules) // columns + 1):
        any_moved |= _fall(molecules, columns, row)
        any_moved |= _spread(molecules, columns, row)
    return any_moved


@kernel
def _look_around(molecules: Any) -> int:
    """Let molecules know how all stand, and say which is the last cell that has one."""
    last = 0
    for one in range(len(molecules.cell)):
        molecules.who_was[molecules.was_in[one]] = -1
    for one in range(len(molecules.cell)):
        cell = molecules.cell[one]
        molecules.who_was[cell], molecules.was_in[one] = one, cell
        last = max(last, cell)
    return last


@kernel
def _fall(molecules: Any, columns: int, row: int) -> bool:
    """Let those of a row fall that have nobody below; says whether any did."""
    any_moved = False
    for cell in range(row * columns, (row + 1) * columns):
        falls = molecules.down[cell] and molecules.who[cell - columns] < 0
        if falls and _may_move(molecules, cell):
            _go(molecules, cell, cell - columns)
            any_moved = True
    return any_moved


@kernel
def _spread(molecules: Any, columns: int, row: int) -> bool:
    """Let the others at the surface ask for room, and give way; says whether any moved."""
    step, any_moved = molecules.counts[_STEP], False
    for number in range(columns):
        # From either wall inwards in turn. It matters only where two want to go to one cell.
        column = number // 2 if (number + step) % 2 else columns - 1 - number // 2
        cell = row * columns + column
        asks = _may_move(molecules, cell) and molecules.denied[cell] != step
        if asks and _at_surface(molecules, columns, cell):
            room = _nearest_room(molecules, columns, cell)
            any_moved |= room >= 0 and _give_way(molecules, cell, room)
    return any_moved


@kernel
def _may_move(molecules: Any, cell: int) -> bool:
    """Whether a cell has a molecule that has not moved in this time step."""
    one = molecules.who[cell]
    return bool(one >= 0 and molecules.moved[one] != molecules.counts[_STEP])


@kernel
def _at_surface(molecules: Any, columns: int, cell: int) -> bool:
    """Whether a cell beside or above is free."""
    for direction in range(1, 4):
        there = _neighbour(molecules, columns, cell, direction, 1)
        if there >= 0 and molecules.who_was[there] < 0:
            return True
    return False


@kernel
def _neighbour(molecules: Any, columns: int, cell: int, direction: int, side: int) -> int:
    """Cell below (0), on a side (1), on the other side (2) or above (3); -1 if there is no way."""
    if direction == 0:
        return cell - columns if molecules.down[cell] else -1
    if direction == 3:
        above = cell + columns
        return above if above < len(molecules.down) and molecules.down[above] else -1
    if (direction == 1) == (side > 0):
        return cell + 1 if molecules.right[cell] else -1
    return cell - 1 if cell > 0 and molecules.right[cell - 1] else -1


@kernel
def _nearest_room(molecules: Any, columns: int, cell: int) -> int:
    """Free cell below a molecule's row to which the way is shortest; -1 if there is none.

    The question goes through cells that hold a molecule and through free ones of its own row,
    never above that. Who hears that there is no room, and stands as high, need not ask again.
    """
    counts, queue, asked = molecules.counts, molecules.queue, molecules.asked
    counts[_QUESTION] += 1
    side = molecules.heading[molecules.who[cell]]
    row_start = cell - cell % columns
    queue[0], asked[cell] = cell, counts[_QUESTION]
    done, known = 0, 1
    while done < known:
        here = queue[done]
        done += 1
        for direction in range(4):
            there = _neighbour(molecules, columns, here, direction, side)
            if there < 0 or there >= row_start + columns or asked[there] == counts[_QUESTION]:
                continue
            asked[there], molecules.asker[there] = counts[_QUESTION], here
            if molecules.who_was[there] < 0 and there < row_start:
                return there
            queue[known] = there
            known += 1
    for number in range(known):
        if queue[number] >= row_start:
            molecules.denied[queue[number]] = counts[_STEP]
    return -1


@kernel
def _give_way(molecules: Any, cell: int, room: int) -> bool:
    """Move on the way by which a question came to room, and push on what stands in the way.

    Nobody moves if one of them has moved in this time step already, or the room is taken.
    """
    free, here = -1, room
    while here != cell:
        if molecules.who[here] < 0:
            free = here
        here = molecules.asker[here]
    if free < 0:
        return False
    here = molecules.asker[free]
    while here != cell:
        if molecules.moved[molecules.who[here]] == molecules.counts[_STEP]:
            return False
        here = molecules.asker[here]
    while free != cell:
        _go(molecules, molecules.asker[free], free)
        free = molecules.asker[free]
    return True


@kernel
def _go(molecules: Any, cell: int, there: int) -> None:
    """Move the molecule of a cell to a neighbouring free one."""
    one = molecules.who[cell]
    molecules.who[cell], molecules.who[there] = -1, one
    molecules.cell[one], molecules.moved[one] = there, molecules.counts[_STEP]
    if abs(there - cell) == 1:
        molecules.heading[one] = there - cell
