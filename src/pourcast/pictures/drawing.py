"""A scene, its liquid and paths, on matplotlib axes."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from numpy.typing import NDArray

from pourcast.scenes.scene import Scene

CELL = 0.006
"""Cells in which a liquid's particles are counted; at most so large [m]."""

MARBLE_OPACITY = 0.7
"""Of a marble, whose edge is opaque."""

_OBSTACLE, _GOAL, _BACKGROUND = "#5b6470", "#a3684f", "#f7f7f4"


def draw_scene(axes: Any, scene: Scene) -> list[PolyCollection]:
    """Draw box, obstacles and goal on matplotlib axes; returns the solids drawn."""
    box = scene.box
    axes.set(xlim=(0, box.width), ylim=(0, box.height), aspect="equal", xticks=[], yticks=[])
    axes.set_facecolor(_BACKGROUND)
    for side in axes.spines.values():
        side.set_color(_OBSTACLE)
    # In front of the liquid, whose picture is a little thicker than the liquid.
    return [
        axes.add_collection(
            PolyCollection(polygons, facecolors=colour, edgecolors=colour, linewidths=0.5, zorder=4)
        )
        for polygons, colour in ((scene.obstacles, _OBSTACLE), (scene.goal.solids, _GOAL))
    ]


def draw_start(axes: Any, scene: Scene, colour: tuple[float, float, float]) -> None:
    """Draw the liquid in its starting position."""
    diameter = scene.liquid.diameter
    axes.add_collection(
        EllipseCollection(
            [diameter], [diameter], [0], units="xy", offsets=[scene.liquid.centre],
            transOffset=axes.transData, facecolors=[(*colour, 0.75)],
        )
    )  # fmt: skip


def draw_paths(
    axes: Any,
    paths: Sequence[NDArray[np.float64]],
    colour: tuple[float, float, float],
    share: float,
) -> None:
    """Draw paths (corners [m], shape [corner_count, 2]) up to a share of the longest's length."""
    longest = max((path_length(path) for path in paths), default=0.0)
    begun = [path_until(path, share * longest) for path in paths]
    axes.add_collection(LineCollection(begun, colors=[(*colour, 0.25)], linewidths=1))


def path_length(path: NDArray[np.float64]) -> float:
    """Length of a path [m] given by its corners, shape [corner_count, 2]."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def path_until(path: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """First part of a path, up to a length.

    Parameters
    ----------
    path
        Corners [m], shape [corner_count, 2].
    length
        How much of it [m]; a shorter path is returned whole.

    Examples
    --------
    >>> path_until(np.array([[0.0, 2.0], [0.0, 1.0], [1.0, 1.0]]), 1.5).tolist()
    [[0.0, 2.0], [0.0, 1.0], [0.5, 1.0]]
    """
    reached = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    tip = [np.interp(length, reached, path[:, k]) for k in range(2)]
    return np.vstack([path[reached < length], tip])


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


def liquid_image(
    position: NDArray[np.float32], spacing: float, scene: Scene, colour: tuple[float, float, float]
) -> NDArray[np.uint8]:
    """Picture of a liquid, as RGBA.

    Parameters
    ----------
    position
        Particle positions [m], shape [n_particles, 3].
    spacing
        Particle spacing [m].
    scene
        The scene, for its box.
    colour
        Red, green, blue.

    Returns
    -------
    ndarray
        Shape [height / 6 mm, width / 6 mm, 4], the lowest row first.
    """
    size = np.array([scene.box.height, scene.box.width])
    shape = (max(1, round(size[0] / CELL)), max(1, round(size[1] / CELL)))
    image = np.zeros((*shape, 4), np.uint8)
    image[:, :, :3] = np.round(255 * np.array(colour))
    places = position[:, 1::-1] * (shape / size)
    opacity, (rows, columns) = liquid_cover(places, 0.5 * spacing / CELL, shape)
    image[rows, columns, 3] = opacity
    return image
