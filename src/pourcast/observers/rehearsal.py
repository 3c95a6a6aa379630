"""Simulated observers who take part through the real page."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from pourcast.experiment.design.steps import Step
from pourcast.scenes.scene import Scene


class Rehearsal:
    """What simulated observers answer, trial by trial.

    Parameters
    ----------
    table
        Their responses, from `simulate_observers`; each answered every scene with every
        liquid that the experiment shows.
    scenes
        The scenes; their goals say what an answer becomes in the mirror.
    """

    def __init__(self, table: pd.DataFrame, scenes: Sequence[Scene]) -> None:
        self._goals = {scene.id: scene.goal for scene in scenes}
        self._observers = list(dict.fromkeys(table["participant"]))
        names = ["participant", "scene", "liquid", "response", "rt"]
        self._answers: dict[tuple[str, str, str], tuple[float, float]] = {
            (participant, scene, liquid): (response, rt)
            for participant, scene, liquid, response, rt in zip(
                *(table[name].tolist() for name in names), strict=True
            )
        }

    def answers(self, observer: int, steps: Sequence[Step]) -> dict[str, Any]:
        """Responses and response times [s] of an observer (from 0), by the step's number.

        Scenes that the observer has no answer to, those of practice, get a seeded one.
        """
        name = self._observers[observer % len(self._observers)]
        rng = np.random.default_rng([observer])
        answers = {}
        for step in steps:
            if step.kind != "judgment":
                continue
            anywhere = (round(float(rng.random()), 2), 2.0)
            response, rt = self._answers.get((name, step.scene, step.liquid), anywhere)
            goal = self._goals.get(step.scene)
            seen = goal.mirrored_judgment(response) if step.mirrored and goal else response
            answers[str(step.seq)] = {"response": seen, "rt": rt}
        return answers
