"""How particles cover a picture: a liquid's, which run together, marbles, and cells of a grid."""

import math

import numpy as np
from numpy.typing import NDArray

MARBLE_OPACITY = 0.7
"""Of a marble, whose edge is opaque."""

CELL_OPACITY = 0.85
"""Of what fills a cell of a grid."""

CELL_FILLED = 0.85
"""Share of a cell's side that is filled: the rest tells it from the next one."""


def liquid_cover(
    places: NDArray[np.floating], blur: float, shape: tuple[int, int], *, block: int = 1
) -> tuple[NDArray[np.uint8], tuple[slice, slice]]:
    """How a liquid covers a grid: particles smeared out and cut at a level.

    Parameters
    ----------
    places
        Particles' rows and columns [cells], shape [n_particles, 2].
    blur
        Standard deviation of what is made of a particle [cells]: half a particle's spacing.
    shape
        Rows and columns of the grid.
    block
        Cells in whose multiples the part that may be covered begins and ends.

    Returns
    -------
    ndarray
        Opacity, 0..255, of the part of the grid that may be covered.
    tuple of slice
        That part's rows and columns.
    """
    # No further than to the other side, where what goes through a wall is folded back.
    reach = min(math.ceil(3.0 * blur), *shape)
    corners, rows, columns = _around(places, reach, shape)
    along, across = (np.exp(-0.5 * (part / blur) ** 2) for part in (rows, columns))
    field = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach), np.float32)
    for (row, column), one in zip(corners, along[:, :, None] * across[:, None, :], strict=True):
        field[row : row + len(one), column : column + len(one)] += one
    for _ in range(2):
        field[reach : 2 * reach] += field[:reach][::-1]
        field[-2 * reach : -reach] += field[-reach:][::-1]
        field = field[reach:-reach].T
    seen = corners if len(corners) else np.zeros((1, 2), int)
    begin = np.maximum(seen.min(axis=0) - reach, 0) // block * block
    end = -(-(seen.max(axis=0) + reach + 1) // block) * block
    end = np.minimum(end, shape)
    part = slice(begin[0], end[0]), slice(begin[1], end[1])
    level = np.clip((field[part] - 0.35) / 0.25, 0.0, 1.0)
    opacity = np.round(255 * 0.85 * level * level * (3.0 - 2.0 * level)).astype(np.uint8)
    return opacity, part


def marble_covers(
    places: NDArray[np.floating], radius: float, edge: float, shape: tuple[int, int]
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """How marbles cover a picture.

    Parameters
    ----------
    places
        Marbles' rows and columns [pixels], shape [n_marbles, 2].
    radius
        Their radius [pixels].
    edge
        Width of the line around each [pixels].
    shape
        Rows and columns of the picture.

    Returns
    -------
    tuple of ndarray
        Opacities of the marbles and of the lines over them, 0..255, of that shape.
    """
    reach = math.ceil(radius + edge) + 1
    corners, rows, columns = _around(places, reach, shape)
    distance = np.hypot(rows[:, :, None], columns[:, None, :])
    lines = np.clip((edge + 1) / 2 - np.abs(distance - radius), 0.0, min(edge, 1.0))
    faces = MARBLE_OPACITY * np.clip(radius - distance + 0.5, 0.0, 1.0) * (1.0 - lines)
    # Shares of the marbles' colour and of the lines' in each pixel, the last marble in front.
    shares = np.zeros((2, shape[0] + 2 * reach, shape[1] + 2 * reach), np.float32)
    for (row, column), face, line in zip(corners, faces, lines, strict=True):
        behind = shares[:, row : row + len(face), column : column + len(face)]
        behind *= 1.0 - face - line
        behind += (face, line)
    face, line = shares[:, reach:-reach, reach:-reach]
    face = face / np.maximum(1.0 - line, 1e-6)
    return np.round(255 * face).astype(np.uint8), np.round(255 * line).astype(np.uint8)


def cell_cover(
    places: NDArray[np.floating], side: float, shape: tuple[int, int]
) -> NDArray[np.uint8]:
    """How what fills cells of a grid covers a picture.

    Parameters
    ----------
    places
        Rows and columns of the cells' middles [pixels], shape [n_cells, 2].
    side
        Length of a cell's side [pixels].
    shape
        Rows and columns of the picture.

    Returns
    -------
    ndarray
        Opacity, 0..255, of that shape.
    """
    reach = 0.5 * CELL_FILLED * side
    along, across = (
        np.clip(
            np.minimum(np.arange(length) + 1.0, place[:, None] + reach)
            - np.maximum(np.arange(length), place[:, None] - reach),
            0.0, 1.0,
        )
        for length, place in zip(shape, places.T, strict=True)
    )  # fmt: skip
    filled: NDArray[np.floating] = np.minimum(along.T @ across, 1.0)
    return np.round(255 * CELL_OPACITY * filled).astype(np.uint8)


def _around(
    places: NDArray[np.floating], reach: int, shape: tuple[int, int]
) -> tuple[NDArray[np.int_], NDArray[np.float32], NDArray[np.float32]]:
    """Cells around particles that are on a grid.

    Returns
    -------
    tuple of ndarray
        Row and column of the cell that holds each, shape [n_seen, 2]; distances from each to the
        middles of rows and of columns around it [cells], shape [n_seen, 2 reach + 1] both.
    """
    seen = places[((places >= 0) & (places < shape)).all(axis=1)]
    corners = seen.astype(int)
    offsets = np.arange(-reach, reach + 1) + 0.5
    distances = ((corners - seen)[:, :, None] + offsets).astype(np.float32)
    return corners, distances[:, 0], distances[:, 1]
