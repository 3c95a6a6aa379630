"""What the kernels work on: the grid as one row of cells, with a margin of solid ones."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, generate_binary_structure

from pourcast.stimuli.lattice_boltzmann.lattice import (
    GAS,
    N_DIRECTIONS,
    OPPOSITE,
    SOLID,
    STANDARD,
    VELOCITY,
    WEIGHT,
)

_ALONG_AXIS = 0.999
_NEIGHBOURS = generate_binary_structure(3, 2)


class Cells(NamedTuple):
    """State of all cells, in lattice units; `n` counts the margin, too."""

    populations: Any
    """Populations less their weights, float32, shape [2, n, 19]: before and after a step."""
    flags: Any
    """GAS, INTERFACE, FLUID or SOLID, shape [n]."""
    walled: Any
    """Whether the cell or a neighbour is solid, in part or in whole, shape [n]."""
    room: Any
    """Share of the cell that is not solid, shape [n]."""
    links: Any
    """Row of `passage` that holds for the cell, int32, shape [n]."""
    passage: Any
    """Share of what comes to a cell in each direction that no solid stops, shape [rows, 19]."""
    kinds: Any
    """Of an interface cell: STANDARD, NO_FLUID or NO_GAS, shape [n]."""
    density: Any
    """Shape [n]."""
    velocity: Any
    """Shape [3, n]."""
    mass: Any
    """Of interface cells; a full cell's is its density times its room. Float64, shape [n]."""
    fill: Any
    """Share of the cell's room that liquid fills, shape [n]."""
    normal: Any
    """Of solid and cut cells: across the surface, of length 1, shape [3, n]. Its sign is of no
    account."""
    axis: Any
    """Of solid cells that let liquid slip: 1, 2, 3 if the surface is across an axis, else 0."""
    slip: Any
    """Of solid cells: 1 lets liquid slip, 0 holds it, shape [n]."""
    rough: Any
    """Of solid cells: whether they drag at liquid that slips along them, shape [n]."""
    face: Any
    """Area of the rough walls beside a cell, across them [cells^2], shape [3, n]."""
    leaked: Any
    """What slanted walls gave to a full cell in this step, shape [n]."""
    fallen: Any
    """How far the cell lies below the liquid's highest point at the start, shape [n]."""
    marks: Any
    """Scratch of `interface.convert`, shape [n]."""
    slots: Any
    """Scratch of `droplets.fly`, int32, shape [n]."""
    offsets: Any
    """From a cell to its neighbour in each direction, shape [19]."""


@dataclass(frozen=True)
class CutCells:
    """Which part of each cell is solid, the same at any depth.

    Parameters
    ----------
    room
        Share of each cell that is not solid, shape [nx, ny].
    passage
        Share of each cell from which a move by a cell in each direction meets no solid, shape
        [19, nx, ny]; at most `room`, and the same from both ends.
    """

    room: NDArray[np.float32]
    passage: NDArray[np.float32]


class Parts(NamedTuple):
    """The liquid's parts: cells that hold some, droplets smaller than a cell, and what is owed."""

    active: Any
    """Fluid and interface cells, int32, shape [n]; the first `counts[0]` of them."""
    changed: Any
    """Scratch: cells that were filled, and that were emptied, int32, shape [2, n]."""
    counts: Any
    """How many active cells and droplets there are, shape [2]."""
    droplets: Any
    """Position [cells], velocity [cells per step] and mass [cells], shape [7, capacity]."""
    owed: Any
    """Mass that found no place yet; the surface gets it evenly, shape [1]."""


class Flow(NamedTuple):
    """What moves and holds the liquid, in lattice units."""

    gravity_x: float
    gravity_y: float
    gravity_z: float
    head: float
    """Square of the speed that a body gains by falling a cell's width."""
    adhesion: float
    """Acceleration of cells at a wall towards it."""
    viscosity: float
    relaxation_time: float
    odd_kept: float
    """Share of odd moments of the third order that a step keeps; negative: they overshoot."""
    smagorinsky: float
    """18 sqrt(2) C^2, with Smagorinsky's constant C."""


def new_parts(n: int) -> Parts:
    """No liquid at all, on a grid of `n` cells."""
    return Parts(
        active=np.zeros(n, dtype=np.int32),
        changed=np.zeros((2, n), dtype=np.int32),
        counts=np.zeros(2, dtype=np.int64),
        droplets=np.zeros((7, n)),
        owed=np.zeros(1),
    )


def new_cells(
    solid: NDArray[np.bool_],
    normal: NDArray[np.float32],
    slip: NDArray[np.float32],
    fallen: NDArray[np.float32],
    rough: NDArray[np.bool_],
    cut: CutCells | None = None,
) -> Cells:
    """Empty cells.

    Parameters
    ----------
    solid
        Which cells are solid, shape [nx, ny, nz], with a margin of one solid cell all around.
    normal
        Across the surface of solid cells, shape [3, nx, ny, nz].
    slip
        Of solid cells, shape [nx, ny, nz].
    fallen
        How far each cell lies below the highest liquid at the start, shape [nx, ny, nz].
    rough
        Which solid cells drag at liquid that slips along them, shape [nx, ny, nz].
    cut
        Cells that are solid in part, without the margin.
    """
    n = solid.size
    _, ny, nz = solid.shape
    strides = np.array([ny * nz, nz, 1])
    across = np.abs(normal.reshape(3, n)) > _ALONG_AXIS
    across &= solid.ravel() & (slip.ravel() == 1.0)
    axis = np.where(across.any(axis=0), 1 + across.argmax(axis=0), 0)
    room, links, passage = _passages(solid, cut)
    return Cells(
        populations=np.zeros((2, n, N_DIRECTIONS), dtype=np.float32),
        flags=np.where(solid.ravel(), SOLID, GAS).astype(np.uint8),
        walled=binary_dilation(room < 1.0, _NEIGHBOURS).ravel(),
        room=room.ravel(),
        links=links.ravel(),
        passage=passage,
        kinds=np.full(n, STANDARD, dtype=np.uint8),
        density=np.ones(n, dtype=np.float32),
        velocity=np.zeros((3, n), dtype=np.float32),
        mass=np.zeros(n),
        fill=np.zeros(n, dtype=np.float32),
        normal=np.ascontiguousarray(normal.reshape(3, n), dtype=np.float32),
        axis=axis.astype(np.uint8),
        slip=np.ascontiguousarray(slip.ravel(), dtype=np.float32),
        rough=rough.ravel(),
        face=_faces(solid, rough, links, passage),
        leaked=np.zeros(n),
        fallen=np.ascontiguousarray(fallen.ravel(), dtype=np.float32),
        marks=np.zeros(n, dtype=np.uint8),
        slots=np.zeros(n, dtype=np.int32),
        offsets=VELOCITY @ strides,
    )


def _passages(solid: NDArray[np.bool_], cut: CutCells | None) -> tuple[Any, Any, Any]:
    """Room of each cell, its row of passages, and these rows; the first is that of open cells."""
    room = np.where(solid, 0.0, 1.0).astype(np.float32)
    links = np.zeros(solid.shape, dtype=np.int32)
    if cut is None:
        return room, links, np.ones((1, N_DIRECTIONS), dtype=np.float32)
    inner = room[1:-1, 1:-1]
    inner *= cut.room[:, :, None]
    free = np.ascontiguousarray(cut.passage[OPPOSITE] / np.maximum(cut.room, 1e-6))
    i, j = np.nonzero((free < 1.0).any(axis=0) & (cut.room > 0.0))
    links[i + 1, j + 1, 1:-1] = 1 + np.arange(len(i))[:, None]
    passage = np.concatenate([np.ones((1, N_DIRECTIONS)), free[:, i, j].T])
    return room, links, np.ascontiguousarray(passage, dtype=np.float32)


def _faces(
    solid: NDArray[np.bool_], rough: NDArray[np.bool_], links: Any, passage: Any
) -> NDArray[np.float32]:
    """Area of the rough walls beside each cell, towards it, over its room: a flat wall has 1."""
    face = np.zeros((3, *rough.shape), dtype=np.float32)
    if not rough.any():
        return face.reshape(3, rough.size)
    for i in range(1, N_DIRECTIONS):
        velocity, weight = VELOCITY[i], WEIGHT[i]
        behind = np.roll(rough & solid, tuple(velocity), axis=(0, 1, 2))
        stopped = np.where(behind, 1.0, 1.0 - passage[links, i])
        face += 6.0 * weight * velocity[:, None, None, None] * np.where(solid, 0.0, stopped)
    return face.reshape(3, rough.size)
