"""How pours are computed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pourcast.engine.batch import Stepping
from pourcast.engine.packing import (
    SUPPORT_IN_SPACINGS,
)

Kind = Literal["liquid", "marbles"]
"""SPH liquid, or rigid spheres."""


@dataclass(frozen=True)
class EngineSettings:
    """How we compute. None of it is in the world, and none in anybody's head.

    Parameters
    ----------
    step
        Longest time step [s]. It is shortened so that a whole number of steps
        makes a frame, and by `courant`. The paper's was 0.0002; twice as long
        steps change judgments by no more than a start moved by 0.1 mm does
        (`docs/explanation/physics.md`).
    marble_step
        The same for rigid spheres [s].
    sound_speed
        Artificial speed of sound c [m/s]; the fastest flow (5 m/s) should stay
        well below it.
    support_in_spacings
        Support radius of the kernel over the particle spacing.
    courant
        The step stays below ``courant * h / (c (1 + 0.6 alpha))`` (Monaghan
        1992, section 5.3), h being half the support radius.
    frame_rate
        Frames per simulated second: of films, and of the test for rest.
    max_duration
        Cap on the simulated time [s].
    """

    step: float = 4e-4
    marble_step: float = 5e-4
    sound_speed: float = 30.0
    support_in_spacings: float = SUPPORT_IN_SPACINGS
    courant: float = 0.4
    frame_rate: float = 30.0
    max_duration: float = 10.0

    def stepping(self, kind: Kind, spacing: float, viscosity_alpha: float) -> Stepping:
        """Step and number of steps a frame for particles of a given spacing [m]."""
        step = self.marble_step
        if kind == "liquid":
            smoothing_length = 0.5 * self.support_in_spacings * spacing
            signal_speed = self.sound_speed * (1.0 + 0.6 * viscosity_alpha)
            step = min(self.step, self.courant * smoothing_length / signal_speed)
        steps = int(np.ceil(1.0 / (self.frame_rate * step) - 1e-9))
        return Stepping(step=1.0 / (self.frame_rate * steps), steps_per_frame=steps)
