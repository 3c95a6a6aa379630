"""What the engine is given and what it answers: a simulation in numbers, its steps, its end."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.packing import SUPPORT_IN_SPACINGS
from pourcast.errors import InputError


@dataclass(frozen=True)
class Job:
    """One simulation, in numbers.

    Lengths in m, times in s. `damping` is zeta [1/s]; `adhesion_normal` and
    `adhesion_tangential` are decay rates [1/s] of the speed while in contact, that is,
    within `contact_layer` of the contact radius.
    """

    position: NDArray[np.float32]
    """Starting positions [m], shape [count, 3]."""
    scene: int
    """Index of the scene in the `Solids` of the batch."""
    width: float
    height: float
    depth: float
    radius: float
    """Contact radius of a particle [m]."""
    support_radius: float
    reference_density: float
    sound_speed: float
    viscosity_alpha: float
    damping: float
    duration: float
    """Cap on the simulated time [s]."""
    gravity: float = 9.81
    adhesion_normal: float = 0.0
    adhesion_tangential: float = 0.0
    support_in_spacings: float = SUPPORT_IN_SPACINGS
    """Support radius over the particle spacing, more than 1."""
    contact_layer: float = 0.0
    """Distance from a solid, beyond the contact radius, at which a particle touches it [m]."""
    cohesion: float = 0.0
    """Surface tension over density [m^3/s^2]."""
    tension: float = 0.0
    """Least pressure over c^2 rho0, with the sign reversed: 0 for none below rest, to 1."""
    viscosity_of_all_pairs: bool = False
    """Whether viscosity acts on pairs that part, too."""
    ceiling: float = np.inf
    """Height of a lid [m]; none by default."""
    rim: float = 0.0
    """Height [m] that a particle must climb to change the outcome; 0 to wait for rest."""
    velocity: NDArray[np.float32] | None = None
    """Starting velocities [m/s], shape [count, 3]; at rest by default."""

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            _check("job", name, getattr(self, name), "more than 0", getattr(self, name) > 0.0)
        for name in _NOT_NEGATIVE:
            _check("job", name, getattr(self, name), "at least 0", getattr(self, name) >= 0.0)
        if not (self.ceiling > 0.0):
            raise InputError(f"job: ceiling: expected more than 0, found {self.ceiling}")
        _check("job", "tension", self.tension, "0 to 1", 0.0 <= self.tension <= 1.0)

    @property
    def spacing(self) -> float:
        """Distance at which a pair of particles neither attracts nor repels by cohesion [m]."""
        return self.support_radius / self.support_in_spacings

    @property
    def touch(self) -> float:
        """Distance of a centre from a solid within which the particle touches it [m]."""
        return self.radius + self.contact_layer


_POSITIVE = (
    "width", "height", "depth", "radius", "support_radius", "reference_density", "sound_speed",
    "duration",
)  # fmt: skip
_NOT_NEGATIVE = (
    "viscosity_alpha", "damping", "gravity", "adhesion_normal", "adhesion_tangential",
    "contact_layer", "cohesion",
)  # fmt: skip


def _check(owner: str, field: str, value: float, expected: str, right: bool) -> None:
    if not (right and math.isfinite(value)):
        raise InputError(f"{owner}: {field}: expected {expected}, found {value}")


@dataclass
class Result:
    """Where a simulation ended."""

    position: NDArray[np.float32]
    """Positions at the end [m], shape [count, 3]."""
    velocity: NDArray[np.float32]
    """Velocities at the end [m/s], shape [count, 3]."""
    touched: NDArray[np.bool_]
    """Whether each particle ever met an obstacle, shape [count]."""
    time: float
    """Simulated time [s]."""
    settled: bool
    """Whether it came to rest, or its outcome was decided, before the cap."""
    frames: NDArray[np.float32] | None
    """Positions frame by frame [m], shape [frame_count, count, 3], if recorded."""


@dataclass(frozen=True)
class Stepping:
    """How a batch is stepped: `steps_per_frame` steps of `step` seconds make a frame."""

    step: float
    steps_per_frame: int

    def __post_init__(self) -> None:
        _check("stepping", "step", self.step, "more than 0 s", self.step > 0.0)
        count = self.steps_per_frame
        _check("stepping", "steps_per_frame", count, "at least 1", count >= 1)

    @property
    def frame(self) -> float:
        """Simulated time between two looks at the state [s]."""
        return self.step * self.steps_per_frame
