"""Scenes to learn from, drawn piece by piece, and the ground truth's judgments of them."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pourcast.models.registry import parse_spec
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes, write_scenes
from pourcast.study.chosen import filter_numbers
from pourcast.study.experiments.base import Experiment
from pourcast.study.experiments.registry import EXPERIMENTS
from pourcast.study.selection import SceneFamily, drawn_scene, filtered_scenes
from pourcast.sweep.judgments import judge_in_study, sweep_words

PIECE = 250
"""Scenes in a file; what is drawn is kept in pieces, so that little is lost."""

LABEL_PARTICLES = 100
"""Particles of the ground truths that label (Bates et al., "ConvNet")."""

_STREAMS = {"training": 2, "held-out": 3}
"""Parts of the seed: no scene of one stream is in another, nor in any study's own."""


@dataclass(frozen=True)
class Draws:
    """An endless list of random scenes.

    Parameters
    ----------
    experiment
        Name of the experiment whose family and filter are used.
    seed
        Source of randomness.
    filtered
        Whether draws are dropped as for stimuli. (For Experiment 2 the paper went on to choose
        scenes for contrast, and suspects that this hurt its honey network.)
    stream
        ``training`` or ``held-out``: the same seed gives other scenes.
    """

    experiment: str
    seed: int
    filtered: bool = True
    stream: str = "training"

    @property
    def name(self) -> str:
        """Name of the folder that keeps them: another as soon as scenes are drawn otherwise."""
        rule = "filtered" if self.filtered else "unfiltered"
        version = hashlib.sha256(self.statistics.encode()).hexdigest()[:8]
        return f"{self.experiment}-{self.stream}-{rule}-seed{self.seed}-{version}"

    @property
    def statistics(self) -> str:
        """What scenes are drawn by, and dropped by: the filter, the engine and what it pours."""
        experiment = EXPERIMENTS.get(self.experiment)
        words = [repr(experiment.family)]
        if self.filtered:
            numbers = filter_numbers(experiment.family, experiment.choice.rule)
            words.append(json.dumps(numbers, sort_keys=True))
        return ", ".join(words)


def drawn_scenes(folder: Path, draws: Draws, count: int, report: Report = no_report) -> list[Scene]:
    """First scenes of a list; those that were drawn before are read.

    Parameters
    ----------
    folder
        Where they are kept.
    draws
        The list.
    count
        How many.
    report
        Told of the progress.

    Returns
    -------
    list of Scene
        With fewer wanted, the first ones of the same.

    Raises
    ------
    InputError
        If a file is damaged or can't be written.
    """
    scenes: list[Scene] = []
    words = f"drawing {draws.stream} scenes"
    for place, size in enumerate(_piece_sizes(count)):
        before = len(scenes)
        report(words, before, count)
        path = folder / draws.name / f"{place:04d}.json"
        piece = read_scenes(path) if path.is_file() else []
        if len(piece) < size:
            piece = _piece(draws, place, size, partial(_tell_piece, report, words, before, count))
            write_scenes(path, piece)
        scenes += piece[:size]
    return scenes


def _piece_sizes(count: int) -> Iterator[int]:
    for first in range(0, count, PIECE):
        yield min(PIECE, count - first)


def _tell_piece(
    report: Report, words: str, before: int, count: int, _words: str, done: int, _size: int
) -> None:
    report(words, before + done, count)


def _piece(draws: Draws, place: int, size: int, report: Report) -> list[Scene]:
    experiment = EXPERIMENTS.get(draws.experiment)
    family, rule = experiment.family, experiment.choice.rule
    words = [draws.seed, _STREAMS[draws.stream], place]
    seed = int(np.random.SeedSequence(words).generate_state(1)[0])
    if draws.filtered:
        found = filtered_scenes(family, size, seed, rule=rule, report=report).scenes
    else:
        found = _plain(family, size, seed)
    return [
        scene.model_copy(update={"id": f"{draws.stream}-{place * PIECE + k:05d}"})
        for k, scene in enumerate(found, start=1)
    ]


def _plain(family: SceneFamily, wanted: int, seed: int) -> list[Scene]:
    """First scenes of a family, whatever the liquid does in them."""
    draws = (drawn_scene(family, seed, index) for index in count())
    return list(islice((scene for scene in draws if scene is not None), wanted))


def label_spec(experiment: Experiment, liquid: str) -> str:
    """Spec of the ground truth that labels scenes for a liquid's network.

    Examples
    --------
    >>> label_spec(EXPERIMENTS.get("exp1"), "honey")
    'truth-honey:n_particles=100'
    """
    name, values = parse_spec(experiment.truth(liquid))
    values |= {"n_particles": str(LABEL_PARTICLES)}
    return f"{name}:{','.join(f'{key}={value}' for key, value in values.items())}"


def truth_labels(
    folder: Path,
    scenes: list[Scene],
    liquid: str,
    spec: str,
    workers: int | None = None,
    report: Report = no_report,
) -> NDArray[np.float64]:
    """The ground truth's judgments, through a sweep's store: none is simulated twice.

    Parameters
    ----------
    folder
        Where the store is.
    scenes
        The scenes.
    liquid
        Liquid of the trials.
    spec
        The ground truth, from `label_spec`.
    workers
        Processes; all cores by default.
    report
        Told of the progress.

    Returns
    -------
    ndarray
        Shape [scene_count].

    Raises
    ------
    InputError
        If there is no such liquid.
    StoreError
        If some judgments could not be made.
    """
    asked = (liquid, spec)
    tell = sweep_words(report, f"labelling with {liquid}")
    found = judge_in_study(
        folder, scenes, [asked], f"labels-{liquid}", workers=workers, report=tell
    )
    return found[asked]
