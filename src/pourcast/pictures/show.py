"""Looking: a scene, a pour in six moments or as a film, several models side by side."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pourcast.cores import available_cores
from pourcast.errors import InputError
from pourcast.files import check_writable, replacing
from pourcast.pictures.panels import (
    FilmFigure,
    film_figure,
    moments_figure,
    page_figure,
    scene_figure,
)
from pourcast.pictures.predictions import Prediction, make_predictions, predictions_of_all
from pourcast.pictures.video import FRAME_RATE, write_film, write_gif
from pourcast.progress import Progress, Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene

PICTURES = (".png", ".svg")

SUFFIXES = (*PICTURES, ".gif", ".mp4")

_GIF_STRIDE = 2

_HOLD_SECONDS = 1.0


def show(
    scene: Scene,
    path: Path,
    models: Sequence[str] = (),
    liquid: str = "water",
    seed: int = 0,
    *,
    own: Sequence[Liquid] = (),
    report: Report = no_report,
) -> list[Prediction]:
    """Make a picture or a film of a scene, and of what models predict of it.

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
    own
        The study's own liquids.
    report
        Told of the progress: pours that are run, then frames that are drawn.

    Returns
    -------
    list of Prediction
        What the models predict, with their judgments.

    Raises
    ------
    InputError
        If the extension or a model is wrong, or the file can't be written.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: expected a name that ends in {', '.join(SUFFIXES)}")
    trial_liquid = resolve_liquid(liquid, scene, own)
    if suffix in (".gif", ".mp4") and not models:
        raise InputError(f"{path}: a film needs at least one --model; a still scene is a .png")
    check_writable(path)
    predictions = make_predictions(scene, models, trial_liquid, seed, own, report=report)
    with replacing(path) as temporary:
        if suffix in (".gif", ".mp4"):
            drawing = partial(report, f"drawing {path.name}")
            _save_film(film_figure(scene, predictions), temporary, drawing)
        elif predictions:
            _save_picture(moments_figure(scene, predictions), temporary)
        else:
            _save_picture(scene_figure(scene), temporary)
    return list(predictions)


def show_all(
    scenes: Sequence[Scene],
    path: Path,
    models: Sequence[str],
    liquid: str = "water",
    seed: int = 0,
    *,
    own: Sequence[Liquid] = (),
    report: Report = no_report,
) -> list[list[Prediction]]:
    """Make one picture of all scenes: where the liquid goes by each model, and how it ends.

    Parameters
    ----------
    scenes
        The scenes.
    path
        PNG or SVG.
    models, liquid, seed, own
        See `show`.
    report
        Told of the progress.

    Returns
    -------
    list of list of Prediction
        For each scene what the models predict.

    Raises
    ------
    InputError
        If the extension or a model is wrong, there is no model, or the file can't be written.
    """
    if path.suffix.lower() not in PICTURES:
        raise InputError(
            f"{path}: all scenes make a picture: expected a name that ends in {', '.join(PICTURES)}"
        )
    if not models:
        raise InputError(f"{path}: a page of all scenes needs at least one --model")
    check_writable(path)
    liquids = [resolve_liquid(liquid, scene, own) for scene in scenes]
    predictions = predictions_of_all(scenes, models, liquids, seed, own, report=report)
    with replacing(path) as temporary:
        _save_picture(page_figure(scenes, predictions), temporary)
    return [list(row) for row in predictions]


def _save_picture(figure: Figure, path: Path) -> None:
    # Without a date and with a fixed salt, the same scene gives the same file.
    with mpl.rc_context({"svg.hashsalt": "pourcast"}):
        metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        figure.savefig(path, dpi=110, metadata=metadata)


def _save_film(film: FilmFigure, path: Path, progress: Progress) -> None:
    last = film.frame_count
    numbers = list(range(last)) + [last - 1] * round(_HOLD_SECONDS * FRAME_RATE)
    if path.suffix == ".gif":
        numbers = numbers[::_GIF_STRIDE]
    frame = film.picture_maker()

    def picture(k: int) -> NDArray[np.uint8]:
        return frame(numbers[k])

    cores = available_cores()
    if path.suffix == ".gif":
        write_gif(path, picture, len(numbers), stride=_GIF_STRIDE, threads=cores, progress=progress)
    else:
        write_film(path, picture, len(numbers), threads=cores, progress=progress)
