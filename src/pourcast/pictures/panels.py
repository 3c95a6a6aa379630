"""Models' predictions on matplotlib figures: moments in a row, or films side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray
from PIL import Image

from pourcast.pictures.cover import (
    CELL_FILLED,
    CELL_OPACITY,
    MARBLE_OPACITY,
    cell_cover,
    liquid_cover,
    marble_covers,
)
from pourcast.pictures.drawing import CELL, draw_paths, draw_scene, draw_start, liquid_image
from pourcast.pictures.predictions import PredictedPaths, PredictedPour
from pourcast.pictures.video import FRAME_RATE, Picture
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene import Scene

MOMENTS = 6

DPI = 100
"""Pixels an inch of films."""

_PAGE_PANELS = 16
"""Panels beside one another on a page of all scenes."""

_PAGE_PANEL, _PAGE_GAP, _PAGE_WORDS = 0.85, 0.06, 0.36
"""Width of its panels, what is between them, and the height of words [inch]."""

_WAY_OPACITY = 0.3
"""Of where a liquid has been, over that of where it is."""

_EDGE = 0.4
"""Width of the line around a marble [point]."""


def draw_pour(axes: Any, scene: Scene, pour: PredictedPour, frame: int) -> Any:
    """Draw the particles of a frame; returns the artist."""
    position = pour.frames[frame]
    if pour.look == "cells":
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (
            0.5 * CELL_FILLED * pour.spacing
        )
        filled = position[:, None, :2] + corners
        return axes.add_collection(
            PolyCollection(
                list(filled), facecolors=[(*pour.colour, CELL_OPACITY)], linewidths=0, snap=False
            )
        )
    if pour.look == "marbles":
        count = len(position)
        return axes.add_collection(
            EllipseCollection(
                [pour.spacing] * count, [pour.spacing] * count, [0] * count, units="xy",
                offsets=position[:, :2], transOffset=axes.transData,
                facecolors=[(*pour.colour, MARBLE_OPACITY)], edgecolors="white", linewidths=_EDGE,
            )
        )  # fmt: skip
    picture = liquid_image(position, pour.spacing, scene, pour.colour)
    extent = (0.0, scene.box.width, 0.0, scene.box.height)
    image = axes.imshow(picture, origin="lower", extent=extent, interpolation="bilinear", zorder=3)
    axes.set(xlim=(0, scene.box.width), ylim=(0, scene.box.height))
    return image


def draw_predicted_paths(
    axes: Any, scene: Scene, prediction: PredictedPaths, share: float = 1.0
) -> None:
    """Draw the liquid's start, and paths up to a share of the longest's length."""
    draw_start(axes, scene, prediction.colour)
    draw_paths(axes, prediction.paths, prediction.colour, share)


def scene_figure(scene: Scene) -> Figure:
    """A scene alone, with water at its start."""
    aspect = scene.box.height / scene.box.width
    figure = Figure(figsize=(3.2, 3.2 * aspect + 0.3), layout="constrained")
    axes = figure.add_subplot()
    draw_scene(axes, scene)
    draw_start(axes, scene, WATER.rgb)
    axes.set_title(scene.id, fontsize=9)
    return figure


def moments_figure(scene: Scene, predictions: Sequence[PredictedPour | PredictedPaths]) -> Figure:
    """Six moments of each prediction, a row a model."""
    aspect = scene.box.height / scene.box.width
    rows = len(predictions)
    figure = Figure(figsize=(1.9 * MOMENTS, rows * (1.9 * aspect + 0.35)), layout="constrained")
    grid = figure.subplots(rows, MOMENTS, squeeze=False)
    for row, one in zip(grid, predictions, strict=True):
        for column, axes in enumerate(row):
            draw_scene(axes, scene)
            if isinstance(one, PredictedPaths):
                draw_predicted_paths(axes, scene, one, column / (MOMENTS - 1))
                continue
            frame = round(column * (len(one.frames) - 1) / (MOMENTS - 1))
            draw_pour(axes, scene, one, frame)
            if one.look != "cells":
                axes.set_xlabel(f"{frame / FRAME_RATE:.2f} s", fontsize=8)
        row[0].set_title(f"{one.name}", fontsize=9, loc="left")
        row[-1].set_title(f"J = {one.judgment:.2f}", fontsize=9, loc="right")
    return figure


def page_figure(
    scenes: Sequence[Scene], predictions: Sequence[Sequence[PredictedPour | PredictedPaths]]
) -> Figure:
    """All scenes on a page, each as often as there are models: where the liquid goes.

    Parameters
    ----------
    scenes
        The scenes, all with boxes of one shape.
    predictions
        For each scene what each model predicts.
    """
    models = [one.name for one in predictions[0]]
    beside = min(max(1, _PAGE_PANELS // len(models)), len(scenes))
    down = -(-len(scenes) // beside)
    panel = _PAGE_PANEL, _PAGE_PANEL * max(scene.box.height / scene.box.width for scene in scenes)
    cell = len(models) * (panel[0] + _PAGE_GAP) + 2 * _PAGE_GAP, panel[1] + _PAGE_WORDS
    size = beside * cell[0], down * cell[1] + _PAGE_WORDS
    figure = Figure(figsize=size)
    figure.text(
        _PAGE_GAP / size[0], 1.0 - 0.3 * _PAGE_WORDS / size[1],
        f"Where the liquid goes by {', by '.join(models)}: its way pale, its end dark; the share "
        "in the goal below.", fontsize=9, va="top",
    )  # fmt: skip
    for number, (scene, row) in enumerate(zip(scenes, predictions, strict=True)):
        left = number % beside * cell[0] + _PAGE_GAP
        bottom = size[1] - _PAGE_WORDS - (number // beside + 1) * cell[1] + _PAGE_WORDS / 2
        for k, one in enumerate(row):
            place = left + k * (panel[0] + _PAGE_GAP), bottom
            axes = figure.add_axes((*np.divide(place, size), *np.divide(panel, size)))
            draw_scene(axes, scene)
            if isinstance(one, PredictedPaths):
                draw_predicted_paths(axes, scene, one)
            else:
                _draw_way(axes, scene, one)
            axes.set_xlabel(f"{one.judgment:.2f}", fontsize=7, labelpad=1)
            if k == 0:
                axes.set_title(scene.id, fontsize=7, loc="left", pad=2)
    return figure


def _draw_way(axes: Any, scene: Scene, pour: PredictedPour) -> None:
    """Draw all places where the liquid has been, pale, and where it ends."""
    frames = (liquid_image(frame, pour.spacing, scene, pour.colour) for frame in pour.frames)
    way = reduce(np.maximum, (picture[:, :, 3] for picture in frames))
    end = liquid_image(pour.frames[-1], pour.spacing, scene, pour.colour)
    end[:, :, 3] = np.maximum(end[:, :, 3], (_WAY_OPACITY * way).astype(np.uint8))
    extent = (0.0, scene.box.width, 0.0, scene.box.height)
    axes.imshow(end, origin="lower", extent=extent, interpolation="bilinear", zorder=3)
    axes.set(xlim=(0, scene.box.width), ylim=(0, scene.box.height))


@dataclass(frozen=True)
class FilmFigure:
    """Panels side by side, in which only the particles move."""

    scene: Scene
    figure: Figure
    floods: list[tuple[AxesImage, PredictedPour]]
    """Each pour, and a picture of its panel full of the liquid."""

    @property
    def frame_count(self) -> int:
        """Frames of the longest pour; 1 if nothing moves."""
        return max((len(pour.frames) for _, pour in self.floods), default=1)

    def picture_maker(self) -> Picture:
        """What draws a frame, by its number; where a pour is over, its last one stays.

        The figure is drawn once without a liquid, and once full of it: frames are made of the two.
        """
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")
        full = self._drawn([pour.colour for _, pour in self.floods])
        white = self._drawn([(1.0, 1.0, 1.0)] * len(self.floods))
        empty = self._drawn([])
        panels = [
            _FlowingPanel(flood.axes, self.scene, pour, empty, full, white)
            for flood, pour in self.floods
        ]
        background = np.asarray(empty)

        def picture(number: int) -> NDArray[np.uint8]:
            image = background.copy()
            for panel in panels:
                panel.draw(image, number)
            return image

        return picture

    def _drawn(self, colours: Sequence[tuple[float, float, float]]) -> Image.Image:
        """The figure, with panels full of some colours or empty."""
        for flood, _ in self.floods:
            flood.set_visible(bool(colours))
        for (flood, _), colour in zip(self.floods, colours, strict=False):
            flood.set_data([[colour]])
        canvas: Any = FigureCanvasAgg(self.figure)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


class _FlowingPanel:
    """A pour in a panel of a figure that was drawn without it, full of it, and full of white."""

    def __init__(
        self,
        axes: Any,
        scene: Scene,
        pour: PredictedPour,
        empty: Image.Image,
        full: Image.Image,
        white: Image.Image,
    ) -> None:
        bounds = axes.get_window_extent()
        floor = empty.height - bounds.y0
        self._left, self._top = round(bounds.x0), round(empty.height - bounds.y1)
        right, bottom = max(round(bounds.x1), self._left + 1), max(round(floor), self._top + 1)
        box = (self._left, self._top, right, bottom)
        self._layers = [layer.crop(box) for layer in (empty, full, white)]
        self._pour = pour
        self._scale = bounds.width / scene.box.width
        self._origin = np.array([floor - self._top, bounds.x0 - self._left])
        # The frames of a pour that is over are all the same.
        self._patch = lru_cache(maxsize=4)(self._new_patch)

    def draw(self, image: NDArray[np.uint8], number: int) -> None:
        """Draw a frame, or the last one, on a picture of the figure."""
        patch, (row, column) = self._patch(min(number, len(self._pour.frames) - 1))
        height, width = patch.shape[:2]
        top, left = self._top + row, self._left + column
        image[top : top + height, left : left + width] = patch

    def _new_patch(self, frame: int) -> tuple[NDArray[np.uint8], tuple[int, int]]:
        """The part of the panel that a frame changes, and its top left corner."""
        empty, full, white = self._layers
        # Rows of pictures count downwards.
        places = self._origin + self._pour.frames[frame][:, 1::-1] * (-self._scale, self._scale)
        shape = (empty.height, empty.width)
        if self._pour.look == "cells":
            cover = Image.fromarray(cell_cover(places, self._pour.spacing * self._scale, shape))
            return np.asarray(Image.composite(full, empty, cover)), (0, 0)
        if self._pour.look == "marbles":
            radius, edge = 0.5 * self._pour.spacing * self._scale, _EDGE * DPI / 72
            faces, edges = map(Image.fromarray, marble_covers(places, radius, edge, shape))
            coloured = Image.composite(full, empty, faces)
            return np.asarray(Image.composite(white, coloured, edges)), (0, 0)
        # Pixels of a large box are larger than the cells that a liquid takes.
        fine = max(1, math.ceil(1.0 / (self._scale * CELL)))
        opacity, (rows, columns) = liquid_cover(
            places * fine, 0.5 * self._pour.spacing * self._scale * fine,
            (shape[0] * fine, shape[1] * fine), block=fine,
        )  # fmt: skip
        top, left = rows.start // fine, columns.start // fine
        box = (left, top, columns.stop // fine, rows.stop // fine)
        cover = Image.fromarray(opacity).reduce(fine)
        return np.asarray(Image.composite(full.crop(box), empty.crop(box), cover)), (top, left)


def film_figure(scene: Scene, predictions: Sequence[PredictedPour | PredictedPaths]) -> FilmFigure:
    """Predictions side by side, with nothing poured yet."""
    aspect = scene.box.height / scene.box.width
    columns = len(predictions)
    figure = Figure(figsize=(2.6 * columns, 2.6 * aspect + 0.5), dpi=DPI, layout="constrained")
    floods = []
    for axes, one in zip(figure.subplots(1, columns, squeeze=False)[0], predictions, strict=True):
        draw_scene(axes, scene)
        axes.set_title(f"{one.name}\nJ = {one.judgment:.2f}", fontsize=9)
        if isinstance(one, PredictedPaths):
            draw_predicted_paths(axes, scene, one)
        else:
            extent = (0.0, scene.box.width, 0.0, scene.box.height)
            flood = axes.imshow([[one.colour]], extent=extent, zorder=3)
            floods.append((flood, one))
    return FilmFigure(scene, figure, floods)
