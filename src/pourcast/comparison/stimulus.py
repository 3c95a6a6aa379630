"""What the stimuli themselves did: a ground truth that is independent of the particle engine."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.manifest import StimulusSet, sets_of
from pourcast.study.folder import study_liquids

NAME = "truth-stimulus"
"""Name by which tables and figures call it."""


def stimulus_truth(study: Path, scenes: Sequence[Scene], liquid: str) -> NDArray[np.float64] | None:
    """Outcomes of a study's films, if a solver made them that shares nothing with the models.

    Parameters
    ----------
    study
        The study folder.
    scenes
        Its scenes.
    liquid
        Name of a liquid.

    Returns
    -------
    ndarray
        Shape [scene_count], of the first set that has all of them in films as long as the
        liquid's own: a shorter one ends before the liquid is where it ends. None if there is none.

    Raises
    ------
    InputError
        If there is none, but a set of liquids that have changed since.
    """
    own = study_liquids(study)
    liquids = [resolve_liquid(liquid, scene, own) for scene in scenes]
    sets = [one for one in sets_of(study) if one.manifest.settings.solver.independent]
    for stimuli in sets:
        if any(stimuli.manifest.settings.film_seconds(one) < one.film_seconds for one in liquids):
            continue
        outcomes = [
            _outcome(stimuli, scene, one) for scene, one in zip(scenes, liquids, strict=True)
        ]
        known = [outcome for outcome in outcomes if outcome is not None]
        if len(known) == len(scenes):
            return np.array(known)
    for stimuli in sets:
        stimuli.check_made_alike(stimuli.manifest.settings, liquids)
    return None


def _outcome(stimuli: StimulusSet, scene: Scene, liquid: Liquid) -> float | None:
    """Outcome of a scene, or what its mirror image says of it."""
    plain = stimuli.find(scene, liquid)
    if plain is not None and plain.outcome is not None:
        return plain.outcome
    mirrored = stimuli.find(scene.mirrored(), liquid)
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
    outcomes = stimulus_truth(study, scenes, liquid)
    if outcomes is None:
        raise InputError(
            f"{study}: {NAME}: not all scenes were filmed with {liquid} to the end; "
            "`pourcast stimuli STUDY` does it"
        )
    return outcomes
