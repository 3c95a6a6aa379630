"""Stimuli from the particle engine, drawn flat: at once, on any machine.

They show the ground truth of the models themselves. For a study that is to be published, an
independent solver's are better: the paper took care not to test its model on its own kind.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from pourcast.files import replacing
from pourcast.model import resolve_liquid
from pourcast.pictures import (
    FRAME_RATE,
    Imagined,
    draw_liquid,
    draw_scene,
    frame_maker,
    imagine,
    write_mp4,
)
from pourcast.progress import Report
from pourcast.scene import Scene
from pourcast.simulation import EngineSettings
from pourcast.stimuli.manifest import (
    FILM_SECONDS,
    FOLDER,
    Manifest,
    Stimulus,
    checksum,
    is_whole,
    read_manifest,
    write_manifest,
)

SOLVER, RENDERER = "sph", "preview"

_PIXELS_PER_METRE = 600
_DPI = 100
_WORTH_PROCESSES = 3
"""So many films pay for the start of other processes."""

_TRUTH = {"water": "truth-water", "honey": "truth-honey"}


@dataclass(frozen=True)
class Wanted:
    """A scene with water or honey that is to be shown; `film` if what happens is, too."""

    scene: Scene
    liquid: str
    film: bool = False


def make_stimuli(study: Path, wanted: Sequence[Wanted], report: Report | None = None) -> Manifest:
    """Make the stimuli of a study that are not there yet.

    Parameters
    ----------
    study
        The study folder.
    wanted
        What is to be shown.
    report
        Told of the progress.

    Returns
    -------
    Manifest
        All stimuli of the study. It is written after every film, so that
        interrupted work goes on where it was.
    """
    manifest = read_manifest(study)
    there = {(one.scene, one.liquid): one for one in manifest.stimuli}
    needed: dict[tuple[str, str], Wanted] = {}
    for one in wanted:  # groups that see the same are shown the same files
        key = (one.scene.digest, one.liquid)
        if one.film or key not in needed:
            needed[key] = one
    missing = [one for key, one in needed.items() if not _is_there(study, there.get(key), one)]
    if missing and report is not None:
        report("making stimuli", 0, len(missing))
    for k, stimulus in enumerate(_made(study, missing), start=1):
        there[stimulus.scene, stimulus.liquid] = stimulus
        if stimulus.film or k == len(missing):
            # The list names those who made its first stimuli.
            manifest = Manifest(
                solver=manifest.solver or SOLVER,
                renderer=manifest.renderer or RENDERER,
                stimuli=tuple(there.values()),
            )
            write_manifest(study, manifest)
        if report is not None:
            report("making stimuli", k, len(missing))
    return manifest


def _made(study: Path, missing: Sequence[Wanted]) -> Iterator[Stimulus]:
    """Make stimuli, in their order; films, of which each takes seconds, on all cores."""
    make = partial(_make, study)
    if sum(one.film for one in missing) < _WORTH_PROCESSES:
        yield from map(make, missing)
        return
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        try:
            yield from pool.map(make, missing)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _is_there(study: Path, found: Stimulus | None, one: Wanted) -> bool:
    if found is None or (one.film and found.film is None):
        return False
    return is_whole(study, found)


def _make(study: Path, one: Wanted) -> Stimulus:
    seconds = FILM_SECONDS[one.liquid]
    # A still is the film's first picture: nothing jumps when the film begins.
    settings = EngineSettings(max_duration=seconds if one.film else 1 / FRAME_RATE)
    liquid = resolve_liquid(one.liquid, one.scene)
    truth = imagine(one.scene, _TRUTH[one.liquid], liquid, settings=settings)
    picture = _frames(one.scene, truth)
    stem = f"{one.scene.digest}-{one.liquid}"
    still, film = study / FOLDER / f"{stem}.png", study / FOLDER / f"{stem}.mp4"
    with replacing(still) as temporary:
        Image.fromarray(picture(0)).save(temporary)
    checksums = {still.name: checksum(still)}
    if one.film:
        with replacing(film) as temporary:
            write_mp4(temporary, picture, round(seconds * FRAME_RATE))
        checksums[film.name] = checksum(film)
    return Stimulus(
        scene=one.scene.digest,
        liquid=one.liquid,
        still=still.name,
        film=film.name if one.film else None,
        outcome=round(truth.judgment, 6) if one.film else None,
        checksums=checksums,
    )


def _frames(scene: Scene, truth: Imagined) -> Callable[[int], NDArray[np.uint8]]:
    """Pictures of the box alone, edge to edge, by the frame's number."""
    width, height = (
        2 * round(side * _PIXELS_PER_METRE / 2) for side in (scene.box.width, scene.box.height)
    )
    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    solids = draw_scene(axes, scene)
    return frame_maker(figure, scene, [(draw_liquid(axes, scene, truth, 0), truth)], solids)
