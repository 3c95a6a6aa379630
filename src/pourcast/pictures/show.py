"""Looking: a scene, a pour in six moments or as a film, several models side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.files import check_writable, replacing
from pourcast.models.base import Model, SimulationModel
from pourcast.models.registry import make_model
from pourcast.pictures.drawing import draw_paths, draw_scene, draw_start, liquid_image
from pourcast.pictures.video import FRAME_RATE, write_film, write_gif
from pourcast.progress import Progress
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import WATER, resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings

SUFFIXES = (".png", ".svg", ".gif", ".mp4")

MOMENTS = 6

_GIF_STRIDE = 2

_HOLD_SECONDS = 1.0

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
        marbles = typical.kind == "marbles"
        return Imagined(
            name=spec,
            judgment=float(np.mean([each.judgment for each in outcomes])),
            frames=outcome.frames,
            paths=[],
            spacing=typical.spacing,
            colour=_MARBLE if marbles else typical.liquid.rgb,
            marbles=marbles,
        )
    judgment = float(model.judge([scene], liquid, seed)[0])
    return Imagined(spec, judgment, None, _paths(model, scene, seed), 0.0, liquid.rgb)


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
        draw_start(axes, scene, WATER.rgb)
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
                draw_paths(axes, one.paths, one.colour, column / (MOMENTS - 1))
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
            draw_paths(axes, one.paths, one.colour, 1.0)
        else:
            moving.append((draw_liquid(axes, scene, one, 0), one))
    return figure, moving, solids
