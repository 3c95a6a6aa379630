"""What the stimuli themselves did: a ground truth that is independent of the particle engine."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.scenes.scene import Scene
from pourcast.stimuli.manifest import StimulusSet, sets_of

NAME = "truth-stimulus"
"""Name by which tables and figures call it."""


def stimulus_truth(study: Path, scenes: Sequence[Scene], liquid: str) -> NDArray[np.float64] | None:
    """Outcomes of a study's films, as far as the lattice-Boltzmann solver made them.

    Parameters
    ----------
    study
        The study folder.
    scenes
        Its scenes.
    liquid
        `water` or `honey`.

    Returns
    -------
    ndarray
        Shape [scene_count], of the first set that has all of them; None if there is none.
    """
    for films in sets_of(study):
        if films.manifest.recipe.flow.solver != "lbm":
            continue
        outcomes = [_outcome(films, scene, liquid) for scene in scenes]
        known = [outcome for outcome in outcomes if outcome is not None]
        if len(known) == len(scenes):
            return np.array(known)
    return None


def _outcome(films: StimulusSet, scene: Scene, liquid: str) -> float | None:
    """Outcome of a scene, or what its mirror image says of it."""
    plain = films.find(scene, liquid)
    if plain is not None and plain.outcome is not None:
        return plain.outcome
    mirrored = films.find(scene.mirrored(), liquid)
    if mirrored is None or mirrored.outcome is None:
        return None
    return float(scene.goal.mirrored_judgment(mirrored.outcome))


def required_truth(study: Path, scenes: Sequence[Scene], liquid: str) -> NDArray[np.float64]:
    """Like `stimulus_truth`, where it was asked for.

    Raises
    ------
    InputError
        If it is not there.
    """
    truth = stimulus_truth(study, scenes, liquid)
    if truth is None:
        raise InputError(
            f"{study}: {NAME}: not all scenes were filmed with {liquid}; "
            "`pourcast stimuli STUDY` does it"
        )
    return truth
