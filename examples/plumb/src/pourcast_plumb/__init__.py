"""A rival model in a package of its own: see docs/how-to/add-a-model.md."""

from dataclasses import dataclass

import numpy as np

import pourcast
from pourcast.progress import no_progress


@dataclass(frozen=True)
class Plumb(pourcast.Model):
    """The liquid falls straight down, blurred by uncertainty about its width."""

    blur: float = pourcast.parameter(
        0.1, unit="m", low=0.001, high=1, doc="SD of the landing place"
    )

    def judge(self, scenes, liquid, seed=0, *, progress=no_progress):
        """Judge scenes: a number from 0 to 1 for each."""
        landing = np.array([scene.liquid.centre[0] for scene in scenes])
        rng = np.random.default_rng(seed)
        places = landing + self.blur * rng.standard_normal((1000, len(scenes)))
        held = [
            [scene.goal.holds(x, 0.0) for x in column]
            for scene, column in zip(scenes, places.T, strict=True)
        ]
        return np.mean(held, axis=1)

    @classmethod
    def follows_trial(cls, parameters):
        """Say that the liquid which a trial shows makes no difference."""
        return False
