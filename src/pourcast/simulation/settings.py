"""How pours are computed."""

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from pourcast.engine.job import Stepping
from pourcast.engine.packing import (
    SUPPORT_IN_SPACINGS,
)
from pourcast.errors import InputError

Kind = Literal["liquid", "marbles"]
"""SPH liquid, or rigid spheres."""

_RANGES: dict[str, tuple[float, float]] = {
    "step": (1e-6, 0.1),
    "marble_step": (1e-6, 0.005),
    "sound_speed": (1.0, math.inf),
    "support_in_spacings": (1.2, 4.0),
    "courant": (1e-3, math.inf),
    "frame_rate": (1.0, 10_000.0),
    "max_duration": (1e-3, 3600.0),
}


@dataclass(frozen=True)
class EngineSettings:
    """How we compute. None of it is in the world, and none in anybody's head.

    Parameters
    ----------
    step
        Longest time step [s], 1e-6 to 0.1. It is shortened so that a whole number of steps
        makes a frame, and by `courant`. The paper's was 0.0002; twice as long
        steps change judgments by no more than a start moved by 0.1 mm does
        (`docs/explanation/physics.md`).
    marble_step
        The same for rigid spheres [s], 1e-6 to 0.005, which no `courant` shortens.
    sound_speed
        Artificial speed of sound c [m/s], at least 1; the fastest flow (5 m/s) should stay
        well below it.
    support_in_spacings
        Support radius of the kernel over the particle spacing, 1.2 to 4: below, neighbours
        don't feel one another; above, the sums run over hundreds of them.
    courant
        The step stays below ``courant * h / (c (1 + 0.6 alpha))`` (Monaghan
        1992, section 5.3), h being half the support radius. At least 0.001; far above 1,
        pours break and raise `SimulationDivergedError`.
    frame_rate
        Frames per simulated second, 1 to 10,000: of films, and of the test for rest.
    max_duration
        Cap on the simulated time [s], 0.001 to 3600.

    Raises
    ------
    InputError
        If a value is not finite or out of its range.
    """

    step: float = 4e-4
    marble_step: float = 5e-4
    sound_speed: float = 30.0
    support_in_spacings: float = SUPPORT_IN_SPACINGS
    courant: float = 0.4
    frame_rate: float = 30.0
    max_duration: float = 10.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), _RANGES[field.name]
            if isinstance(value, np.generic):  # would be counted with in its own precision
                object.__setattr__(self, field.name, value := value.item())
            if not (low <= value <= high and math.isfinite(value)):
                expected = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
                raise InputError(
                    f"engine settings: {field.name}: expected {expected}, found {value}"
                )

    def stepping(self, kind: Kind, spacing: float, viscosity_alpha: float) -> Stepping:
        """Step and number of steps a frame for particles of a given spacing [m]."""
        step = self.marble_step
        if kind == "liquid":
            smoothing_length = 0.5 * self.support_in_spacings * spacing
            signal_speed = self.sound_speed * (1.0 + 0.6 * viscosity_alpha)
            step = min(self.step, self.courant * smoothing_length / signal_speed)
        steps = int(np.ceil(1.0 / (self.frame_rate * step) - 1e-9))
        return Stepping(step=1.0 / (self.frame_rate * steps), steps_per_frame=steps)
