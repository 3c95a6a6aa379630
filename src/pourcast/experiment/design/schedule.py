"""Which trials a participant gets, and in which order: the schedule of a session."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pourcast.experiment.design.settings import Design
from pourcast.experiment.design.steps import Step
from pourcast.scenes.scene import Scene
from pourcast.study.responses import TEST

PRACTICE = "practice"
"""The phase with films; no model is compared on it."""

OWN_ORDERS = 24
"""Orders to choose from, a group, where each participant has an own one and no server counts."""

_ORDER = 2
"""Sets the random numbers of orders apart from others with the same seed."""


@dataclass(frozen=True)
class Trial:
    """A scene that is judged with a liquid, mirrored or not.

    Parameters
    ----------
    scene
        The study's scene.
    liquid
        Liquid shown.
    mirrored
        Whether the scene is shown in a mirror.
    film
        Whether a film of what happens follows.
    """

    scene: Scene
    liquid: str
    mirrored: bool = False
    film: bool = False

    @property
    def key(self) -> tuple[str, str, bool]:
        """What tells it from all others of a study."""
        return self.scene.id, self.liquid, self.mirrored

    @property
    def shown_scene(self) -> Scene:
        """The scene as it is shown."""
        return self.scene.mirrored() if self.mirrored else self.scene


def practice_trials(practice: Sequence[Scene], design: Design, group: int) -> list[Trial]:
    """Practice trials of a group; the liquids take turns."""
    liquids = design.groups[group]
    return [
        Trial(scene, liquids[k % len(liquids)], film=True)
        for k, scene in enumerate(practice[: design.practice])
    ]


def test_trials(scenes: Sequence[Scene], design: Design, group: int, place: int) -> list[Trial]:
    """Test trials of a group's place, in their order."""
    trials = [
        Trial(scene, liquid, liquid in design.mirrored)
        for liquid in design.groups[group]
        for scene in scenes
    ]
    # Groups that see one liquid each share the order of the scenes, as in the paper.
    entropy = [design.seed, _ORDER, *([place] if design.order == "own" else [])]
    return [trials[k] for k in np.random.default_rng(entropy).permutation(len(trials))]


def all_trials(scenes: Sequence[Scene], practice: Sequence[Scene], design: Design) -> list[Trial]:
    """The trials of all groups, those of practice first."""
    groups = range(len(design.groups))
    return [
        *(trial for g in groups for trial in practice_trials(practice, design, g)),
        *(trial for g in groups for trial in test_trials(scenes, design, g, 0)),
    ]


def session_steps(
    practice: Sequence[Trial],
    test: Sequence[Trial],
    blocks: int,
    files: Callable[[Trial], tuple[str, str]],
) -> list[Step]:
    """All steps of a session, from consent to debriefing.

    Parameters
    ----------
    practice, test
        The trials, in their order.
    blocks
        Parts of the test trials, with a break between.
    files
        From a trial to the names of its still and of its film; an empty one where there is none.
    """

    def content(trial: Trial) -> dict[str, Any]:
        still, film = files(trial)
        return {
            "liquid": trial.liquid,
            "scene": trial.scene.id,
            "mirrored": trial.mirrored,
            "still": still,
            "film": film,
        }

    steps: list[dict[str, Any]] = [{"kind": kind} for kind in ("consent", "check", "instructions")]
    for number, trial in enumerate(practice, start=1):
        step = content(trial) | {"phase": PRACTICE, "trial": number}
        steps += [step | {"kind": "judgment"}, step | {"kind": "film"}]
    ends = np.linspace(0, len(test), min(blocks, len(test)) + 1).round()[1:-1]
    block = 1
    for number, trial in enumerate(test, start=1):
        step = content(trial) | {"phase": TEST, "trial": number, "block": block}
        steps.append(step | {"kind": "judgment", "film": ""})
        if number in ends:
            steps.append({"kind": "break", "block": block})
            block += 1
    steps.append({"kind": "debrief"})
    return [Step(seq=seq, **step) for seq, step in enumerate(steps)]
