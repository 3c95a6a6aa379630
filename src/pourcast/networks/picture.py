"""Small pictures of scenes at their start, as a network sees them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pourcast.scenes.scene import Scene

Pictures = NDArray[np.uint8]
"""Shape [picture_count, 3, height, width]: red, green, blue, 0..255."""

OUTSIDE = (140, 140, 140)
AIR = (255, 255, 255)
OBSTACLE = (40, 40, 40)
GOAL = (220, 60, 40)
LIQUID = (40, 110, 230)

FRAME = 0.96
"""Share of the picture that the box takes at zoom 1, so that its walls are always seen."""

_FINER = 3
"""Pictures are painted so many times finer, and averaged: edges are smooth."""


@dataclass(frozen=True)
class View:
    """How a scene is looked at.

    Parameters
    ----------
    zoom
        1: the box takes `FRAME` of the picture; less: it is smaller.
    place
        Where it stands in the room that is left: 0 left or bottom, 1 right or top.
    mirrored
        Whether left and right are exchanged, at the very end.
    """

    zoom: float = 1.0
    place: tuple[float, float] = (0.5, 0.5)
    mirrored: bool = False


STRAIGHT = View()
"""How scenes are looked at when they are judged."""

MIRRORED = View(mirrored=True)


def paint(scene: Scene, height: int, width: int, view: View = STRAIGHT) -> Pictures:
    """Paint a scene.

    Parameters
    ----------
    scene
        The scene.
    height, width
        Of the picture [pixels].
    view
        How it is looked at.

    Returns
    -------
    ndarray
        Shape [3, height, width].

    Examples
    --------
    >>> from pourcast.pictures.demo import demo_scenes
    >>> paint(demo_scenes()[0], 48, 32).shape
    (3, 48, 32)
    """
    rows, columns = height * _FINER, width * _FINER
    box = scene.box
    scale = view.zoom * FRAME * min(columns / box.width, rows / box.height)
    left = view.place[0] * (columns - scale * box.width)
    floor = rows - view.place[1] * (rows - scale * box.height)

    def at(x: float, y: float) -> tuple[float, float]:
        return left + scale * x, floor - scale * y

    picture = Image.new("RGB", (columns, rows), OUTSIDE)
    draw: Any = ImageDraw.Draw(picture)
    draw.rectangle([at(0.0, box.height), at(box.width, 0.0)], fill=AIR)
    for solids, colour in ((scene.obstacles, OBSTACLE), (scene.goal.solids, GOAL)):
        for polygon in solids:
            draw.polygon([at(x, y) for x, y in polygon], fill=colour)
    (x, y), radius = scene.liquid.centre, scene.liquid.diameter / 2
    draw.ellipse([at(x - radius, y + radius), at(x + radius, y - radius)], fill=LIQUID)
    pixels = np.asarray(picture.reduce(_FINER)).transpose(2, 0, 1)
    return np.ascontiguousarray(pixels[:, :, ::-1] if view.mirrored else pixels)
