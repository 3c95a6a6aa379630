"""What the kernels work on: the grid as one row of cells, with a margin of solid ones."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, generate_binary_structure

from pourcast.stimuli.lattice_boltzmann.lattice import (
    GAS,
    N_DIRECTIONS,
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
    """Whether a neighbour is solid, shape [n]."""
    kinds: Any
    """Of an interface cell: STANDARD, NO_FLUID or NO_GAS, shape [n]."""
    density: Any
    """Shape [n]."""
    velocity: Any
    """Shape [3, n]."""
    mass: Any
    """Of interface cells; a full cell's is its density. Float64, shape [n]."""
    fill: Any
    """Share of the cell that liquid fills, shape [n]."""
    normal: Any
    """Of solid cells: across the surface, of length 1, shape [3, n]. Its sign is of no account."""
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
    """
    n = solid.size
    _, ny, nz = solid.shape
    strides = np.array([ny * nz, nz, 1])
    across = np.abs(normal.reshape(3, n)) > _ALONG_AXIS
    across &= solid.ravel() & (slip.ravel() == 1.0)
    axis = np.where(across.any(axis=0), 1 + across.argmax(axis=0), 0)
    return Cells(
        populations=np.zeros((2, n, N_DIRECTIONS), dtype=np.float32),
        flags=np.where(solid.ravel(), SOLID, GAS).astype(np.uint8),
        walled=binary_dilation(solid, _NEIGHBOURS).ravel(),
        kinds=np.full(n, STANDARD, dtype=np.uint8),
        density=np.ones(n, dtype=np.float32),
        velocity=np.zeros((3, n), dtype=np.float32),
        mass=np.zeros(n),
        fill=np.zeros(n, dtype=np.float32),
        normal=np.ascontiguousarray(normal.reshape(3, n), dtype=np.float32),
        axis=axis.astype(np.uint8),
        slip=np.ascontiguousarray(slip.ravel(), dtype=np.float32),
        rough=rough.ravel(),
        face=_faces(rough),
        leaked=np.zeros(n),
        fallen=np.ascontiguousarray(fallen.ravel(), dtype=np.float32),
        marks=np.zeros(n, dtype=np.uint8),
        slots=np.zeros(n, dtype=np.int32),
        offsets=VELOCITY @ strides,
    )


def _faces(rough: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Area of the rough walls beside each cell, towards it: a flat wall has 1."""
    face = np.zeros((3, *rough.shape), dtype=np.float32)
    if rough.any():
        for velocity, weight in zip(VELOCITY[1:], WEIGHT[1:], strict=True):
            links = np.roll(rough, tuple(velocity), axis=(0, 1, 2)) & ~rough
            face += 6.0 * weight * velocity[:, None, None, None] * links
    return face.reshape(3, rough.size)
