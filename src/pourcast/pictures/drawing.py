"""A scene, its liquid and paths, on matplotlib axes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from numpy.typing import NDArray

from pourcast.pictures.cover import liquid_cover
from pourcast.scenes.scene import Scene

CELL = 0.006
"""Cells in which a liquid's particles are counted; at most so large [m]."""

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
