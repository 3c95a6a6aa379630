"""Models' predictions on matplotlib figures: moments in a row, or films side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from pourcast.pictures.drawing import draw_paths, draw_scene, draw_start, liquid_image
from pourcast.pictures.predictions import PredictedPaths, PredictedPour
from pourcast.pictures.video import FRAME_RATE, Picture
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene import Scene

MOMENTS = 6


def draw_pour(axes: Any, scene: Scene, pour: PredictedPour, frame: int) -> Any:
    """Draw the particles of a frame; returns the artist."""
    position = pour.frames[frame]
    if pour.marbles:
        count = len(position)
        return axes.add_collection(
            EllipseCollection(
                [pour.spacing] * count, [pour.spacing] * count, [0] * count, units="xy",
                offsets=position[:, :2], transOffset=axes.transData,
                facecolors=[(*pour.colour, 0.7)], edgecolors="white", linewidths=0.4,
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
            axes.set_xlabel(f"{frame / FRAME_RATE:.2f} s", fontsize=8)
        row[0].set_title(f"{one.name}", fontsize=9, loc="left")
        row[-1].set_title(f"J = {one.judgment:.2f}", fontsize=9, loc="right")
    return figure


@dataclass(frozen=True)
class FilmFigure:
    """Panels side by side, in which only the particles move."""

    scene: Scene
    figure: Figure
    pours: list[tuple[Any, PredictedPour]]
    """Each pour's artist, and the pour."""
    solids: list[PolyCollection]
    """What stands in front of the liquid."""

    @property
    def frame_count(self) -> int:
        """Frames of the longest pour; 1 if nothing moves."""
        return max((len(pour.frames) for _, pour in self.pours), default=1)

    def picture_maker(self) -> Picture:
        """What draws a frame, by its number; where a pour is over, its last one stays."""
        canvas: Any = FigureCanvasAgg(self.figure)
        # What stands still is drawn once; animated artists are left out of `draw`.
        for artist in [*(artist for artist, _ in self.pours), *self.solids]:
            artist.set_animated(True)
        canvas.draw()
        renderer = canvas.get_renderer()
        background = renderer.copy_from_bbox(self.figure.bbox)

        def picture(number: int) -> NDArray[np.uint8]:
            renderer.restore_region(background)
            for artist, pour in self.pours:
                _move_particles(artist, self.scene, pour, number)
                artist.draw(renderer)
            for solid in self.solids:
                solid.draw(renderer)
            return np.array(renderer.buffer_rgba())[:, :, :3]

        return picture


def film_figure(scene: Scene, predictions: Sequence[PredictedPour | PredictedPaths]) -> FilmFigure:
    """Predictions side by side, at their start."""
    aspect = scene.box.height / scene.box.width
    columns = len(predictions)
    figure = Figure(figsize=(2.6 * columns, 2.6 * aspect + 0.5), dpi=100, layout="constrained")
    pours, solids = [], []
    for axes, one in zip(figure.subplots(1, columns, squeeze=False)[0], predictions, strict=True):
        solids += draw_scene(axes, scene)
        axes.set_title(f"{one.name}\nJ = {one.judgment:.2f}", fontsize=9)
        if isinstance(one, PredictedPaths):
            draw_predicted_paths(axes, scene, one)
        else:
            pours.append((draw_pour(axes, scene, one, 0), one))
    return FilmFigure(scene, figure, pours, solids)


def _move_particles(artist: Any, scene: Scene, pour: PredictedPour, frame: int) -> None:
    """Let an artist of `draw_pour` show another frame."""
    position = pour.frames[min(frame, len(pour.frames) - 1)]
    if isinstance(artist, AxesImage):
        artist.set_data(liquid_image(position, pour.spacing, scene, pour.colour))
    else:
        artist.set_offsets(position[:, :2])
