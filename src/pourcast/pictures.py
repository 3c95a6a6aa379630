"""Looking: a scene, a pour in six moments or as a film, several models side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from pourcast.errors import InputError
from pourcast.files import check_writable, replacing
from pourcast.liquid import Liquid
from pourcast.model import Model, SimulationModel, make_model, resolve_liquid
from pourcast.scene import Scene
from pourcast.simulation import EngineSettings, Progress, simulate
from pourcast.video import FRAME_RATE, write_film, write_gif

SUFFIXES = (".png", ".svg", ".gif", ".mp4")
MOMENTS = 6
_GIF_STRIDE = 2
_HOLD_SECONDS = 1.0
_CELL = 0.006
_OBSTACLE, _GOAL, _BACKGROUND = "#5b6470", "#a3684f", "#f7f7f4"
COLOURS = {"water": (0.16, 0.47, 0.80), "honey": (0.87, 0.58, 0.05)}
_MARBLE = (0.45, 0.30, 0.62)


@dataclass(frozen=True)
class Imagined:
    """What a model imagines of a scene: a film of particles, or paths; and its judgment."""

    name: str
    judgment: float
    frames: NDArray[np.float32] | None
    """Particle positions [m], shape [frame_count, n_particles, 3]."""
    paths: list[NDArray[np.float64]]
    spacing: float
    colour: tuple[float, float, float]
    marbles: bool = False


def imagine(
    scene: Scene,
    spec: str,
    liquid: Liquid,
    seed: int = 0,
    *,
    settings: EngineSettings | None = None,
) -> Imagined:
    """Judge a scene with a model, and record its typical pour or its paths.

    Parameters
    ----------
    scene
        The scene.
    spec
        Model spec, as for `make_model`.
    liquid
        Liquid that is shown in the trial.
    seed
        Source of randomness.
    settings
        How pours are computed; shorter ones for a look at the start.
    """
    model = make_model(spec)
    if isinstance(model, SimulationModel):
        pours = model.pours(scene, liquid, seed)
        outcomes = simulate(pours, settings=settings, record=True)
        typical, outcome = pours[len(pours) // 2], outcomes[len(pours) // 2]
        kind = "honey" if typical.liquid.adhesion_tangential > 0 else "water"
        marbles = typical.kind == "marbles"
        return Imagined(
            name=spec,
            judgment=float(np.mean([each.judgment for each in outcomes])),
            frames=outcome.frames,
            paths=[],
            spacing=typical.spacing,
            colour=_MARBLE if marbles else COLOURS[kind],
            marbles=marbles,
        )
    judgment = float(model.judge([scene], liquid, seed)[0])
    return Imagined(spec, judgment, None, _paths(model, scene, seed), 0.0, COLOURS["water"])


def _paths(model: Model, scene: Scene, seed: int) -> list[NDArray[np.float64]]:
    """Paths of a model that can tell them (SimpleSim), none of any other."""
    tell = getattr(model, "paths", None)
    return list(tell(scene, seed)) if callable(tell) else []


def show(
    scene: Scene,
    path: Path,
    models: Sequence[str] = (),
    liquid: str = "water",
    seed: int = 0,
    *,
    progress: Progress | None = None,
) -> list[Imagined]:
    """Make a picture or a film of a scene, and of what models imagine of it.

    Parameters
    ----------
    scene
        The scene.
    path
        PNG or SVG: six moments a model (the scene alone without models). GIF or
        MP4: the models side by side.
    models
        Model specs.
    liquid
        Liquid that is shown in the trial.
    seed
        Source of randomness.
    progress
        Called with the frames drawn and how many there are.

    Returns
    -------
    list of Imagined
        What the models imagined, with their judgments.

    Raises
    ------
    InputError
        If the extension or a model is wrong, or the file can't be written.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in {', '.join(SUFFIXES)}")
    trial_liquid = resolve_liquid(liquid, scene)
    if suffix in (".gif", ".mp4") and not models:
        raise InputError(f"{path}: a film needs at least one --model; a still scene is a .png")
    check_writable(path)
    imagined = [imagine(scene, spec, trial_liquid, seed) for spec in models]
    with replacing(path) as temporary:
        if suffix in (".png", ".svg"):
            _save_picture(moments_figure(scene, imagined), temporary)
        else:
            _save_film(scene, imagined, temporary, progress)
    return imagined


def _save_picture(figure: Figure, path: Path) -> None:
    # Without a date and with a fixed salt, the same scene gives the same file.
    with mpl.rc_context({"svg.hashsalt": "pourcast"}):
        metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        figure.savefig(path, dpi=110, metadata=metadata)


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


def draw_paths(axes: Any, one: Imagined, share: float) -> None:
    """Draw the paths as far as a share of the longest one's length."""
    longest = max((path_length(path) for path in one.paths), default=0.0)
    paths = [path_until(path, share * longest) for path in one.paths]
    axes.add_collection(LineCollection(paths, colors=[(*one.colour, 0.25)], linewidths=1))


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
    """Picture of a liquid: particles smeared out and cut at a level, as RGBA.

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
    width, height = scene.box.width, scene.box.height
    bins = (round(height / _CELL), round(width / _CELL))
    counts = np.histogram2d(
        position[:, 1], position[:, 0], bins=bins, range=((0, height), (0, width))
    )[0]
    blur = 0.5 * spacing / _CELL
    field = gaussian_filter(counts, blur) * 2 * np.pi * blur**2
    level = np.clip((field - 0.35) / 0.25, 0.0, 1.0)
    alpha = 0.85 * level * level * (3.0 - 2.0 * level)
    shades = np.dstack([np.broadcast_to(colour, (*alpha.shape, 3)), alpha])
    # Bytes are drawn twice as fast as floating-point numbers.
    return np.round(255 * shades).astype(np.uint8)


def draw_liquid(axes: Any, scene: Scene, imagined: Imagined, frame: int) -> Any:
    """Draw one moment; returns the artist, for `_move_liquid`."""
    assert imagined.frames is not None
    position = imagined.frames[frame]
    if imagined.marbles:
        count = len(position)
        return axes.add_collection(
            EllipseCollection(
                [imagined.spacing] * count, [imagined.spacing] * count, [0] * count, units="xy",
                offsets=position[:, :2], transOffset=axes.transData,
                facecolors=[(*imagined.colour, 0.7)], edgecolors="white", linewidths=0.4,
            )
        )  # fmt: skip
    picture = liquid_image(position, imagined.spacing, scene, imagined.colour)
    extent = (0.0, scene.box.width, 0.0, scene.box.height)
    image = axes.imshow(picture, origin="lower", extent=extent, interpolation="bilinear", zorder=3)
    axes.set(xlim=(0, scene.box.width), ylim=(0, scene.box.height))
    return image


def _move_liquid(artist: Any, scene: Scene, imagined: Imagined, frame: int) -> None:
    assert imagined.frames is not None
    position = imagined.frames[min(frame, len(imagined.frames) - 1)]
    if isinstance(artist, AxesImage):
        artist.set_data(liquid_image(position, imagined.spacing, scene, imagined.colour))
    else:
        artist.set_offsets(position[:, :2])


def moments_figure(scene: Scene, imagined: Sequence[Imagined]) -> Figure:
    """Six moments of each model's pour, a row a model; the scene alone without models."""
    aspect = scene.box.height / scene.box.width
    if not imagined:
        figure = Figure(figsize=(3.2, 3.2 * aspect + 0.3), layout="constrained")
        axes = figure.add_subplot()
        draw_scene(axes, scene)
        draw_start(axes, scene, COLOURS["water"])
        axes.set_title(scene.id, fontsize=9)
        return figure
    rows = len(imagined)
    figure = Figure(figsize=(1.9 * MOMENTS, rows * (1.9 * aspect + 0.35)), layout="constrained")
    grid = figure.subplots(rows, MOMENTS, squeeze=False)
    for row, one in zip(grid, imagined, strict=True):
        for column, axes in enumerate(row):
            draw_scene(axes, scene)
            if one.frames is None:
                draw_start(axes, scene, one.colour)
                draw_paths(axes, one, column / (MOMENTS - 1))
                continue
            frame = round(column * (len(one.frames) - 1) / (MOMENTS - 1))
            draw_liquid(axes, scene, one, frame)
            axes.set_xlabel(f"{frame / FRAME_RATE:.2f} s", fontsize=8)
        row[0].set_title(f"{one.name}", fontsize=9, loc="left")
        row[-1].set_title(f"J = {one.judgment:.2f}", fontsize=9, loc="right")
    return figure


def _save_film(
    scene: Scene, imagined: Sequence[Imagined], path: Path, progress: Progress | None
) -> None:
    figure, artists, solids = _film_figure(scene, imagined)
    last = max((len(one.frames) for one in imagined if one.frames is not None), default=1)
    numbers = list(range(last)) + [last - 1] * round(_HOLD_SECONDS * FRAME_RATE)
    if path.suffix == ".gif":
        numbers = numbers[::_GIF_STRIDE]
    frame = frame_maker(figure, scene, artists, solids)

    def picture(k: int) -> NDArray[np.uint8]:
        if progress is not None:
            progress(k + 1, len(numbers))
        return frame(numbers[k])

    if path.suffix == ".gif":
        write_gif(path, picture, len(numbers), stride=_GIF_STRIDE)
    else:
        write_film(path, picture, len(numbers))


def frame_maker(
    figure: Figure,
    scene: Scene,
    moving: Sequence[tuple[Any, Imagined]],
    solids: Sequence[PolyCollection],
) -> Callable[[int], NDArray[np.uint8]]:
    """Pictures of a figure in which only liquids move.

    Parameters
    ----------
    figure
        With all that is to be seen.
    scene
        The scene.
    moving
        Artists of `draw_liquid`, and whose liquid each shows.
    solids
        What stands in front of the liquid.

    Returns
    -------
    callable
        From a frame's number (the last one stays) to red, green, blue, shape [height, width, 3].
    """
    canvas: Any = FigureCanvasAgg(figure)
    # What stands still is drawn once; animated artists are left out of `draw`.
    for artist in [*(artist for artist, _ in moving), *solids]:
        artist.set_animated(True)
    canvas.draw()
    renderer = canvas.get_renderer()
    background = renderer.copy_from_bbox(figure.bbox)

    def picture(number: int) -> NDArray[np.uint8]:
        renderer.restore_region(background)
        for artist, one in moving:
            _move_liquid(artist, scene, one, number)
            artist.draw(renderer)
        for solid in solids:
            solid.draw(renderer)
        return np.array(renderer.buffer_rgba())[:, :, :3]

    return picture


def _film_figure(
    scene: Scene, imagined: Sequence[Imagined]
) -> tuple[Figure, list[tuple[Any, Imagined]], list[PolyCollection]]:
    """Panels side by side; what moves in them, and the solids in front of it."""
    aspect = scene.box.height / scene.box.width
    columns = len(imagined)
    figure = Figure(figsize=(2.6 * columns, 2.6 * aspect + 0.5), dpi=100, layout="constrained")
    moving, solids = [], []
    for axes, one in zip(figure.subplots(1, columns, squeeze=False)[0], imagined, strict=True):
        solids += draw_scene(axes, scene)
        axes.set_title(f"{one.name}\nJ = {one.judgment:.2f}", fontsize=9)
        if one.frames is None:
            draw_start(axes, scene, one.colour)
            draw_paths(axes, one, 1.0)
        else:
            moving.append((draw_liquid(axes, scene, one, 0), one))
    return figure, moving, solids
