"""What is to be run, and how it ended: a scene, a liquid and numbers; a judgment and positions."""

import math
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.packing import spacing_of
from pourcast.errors import InputError, unknown
from pourcast.numbers import plain_number, whole_number
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.settings import Kind

GRAVITY = 9.81
"""Acceleration of free fall [m/s^2]."""

MAX_PARTICLES = 2000

MAX_DAMPING = 200.0
"""Largest damping [1/s]: what is damped more falls too slowly to be told from what rests."""


@dataclass(frozen=True)
class Pour:
    """One simulation to be run.

    Parameters
    ----------
    scene
        Where.
    liquid
        What flows. Marbles take only its adhesion.
    n_particles
        Number of particles, 1 to 2000.
    damping_zeta
        Damping zeta [1/s], 0 to 200.
    offset
        Displacement of the liquid's start in x and y [m].
    kind
        SPH liquid or rigid marbles.

    Raises
    ------
    InputError
        If something is no number, not finite or out of its range.
    """

    scene: Scene
    liquid: Liquid
    n_particles: int = 50
    damping_zeta: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    kind: Kind = "liquid"

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", _two_lengths(self.offset))
        damping = float(plain_number(self.damping_zeta, "pour: damping_zeta"))
        object.__setattr__(self, "damping_zeta", damping)
        count = whole_number(self.n_particles, "pour: n_particles")
        object.__setattr__(self, "n_particles", count)
        if not 1 <= self.n_particles <= MAX_PARTICLES:
            raise InputError(
                f"n_particles must be from 1 to {MAX_PARTICLES}, not {self.n_particles}"
            )
        if not 0.0 <= self.damping_zeta <= MAX_DAMPING:
            raise InputError(
                f"pour: damping_zeta: expected 0 to {MAX_DAMPING:g} per second, found "
                f"{self.damping_zeta}"
            )
        if not all(math.isfinite(value) for value in self.offset):
            raise InputError(f"pour: offset: expected two finite lengths, found {self.offset}")
        if self.kind not in get_args(Kind):
            raise InputError(f"pour: kind: {unknown(str(self.kind), get_args(Kind))}")
        narrow = min(self.scene.box.width, self.scene.box.depth)
        if self.spacing > narrow:
            raise InputError(
                f"scene {self.scene.id!r}: {self.n_particles} particles of its liquid are "
                f"{self.spacing:.3g} m wide, and its box only {narrow:.3g} m: take more particles"
            )

    @property
    def spacing(self) -> float:
        """Particle spacing, in three dimensions [m]."""
        return spacing_of(self.n_particles, self.scene.liquid.diameter / 2, self.scene.box.depth)


def _two_lengths(offset: Any) -> tuple[float, float]:
    try:
        x, y = offset
    except (TypeError, ValueError):
        raise InputError(f"pour: offset: expected two finite lengths, found {offset!r}") from None
    across, up = (float(plain_number(value, "pour: offset")) for value in (x, y))
    return across, up


@dataclass(frozen=True)
class Outcome:
    """How a pour ended."""

    judgment: float
    """Share of the particles that the goal holds, 0..1."""
    stranded: float
    """Share above the goal's rim or still touching an obstacle."""
    touched: float
    """Share that ever met an obstacle."""
    time: float
    """Simulated time [s]."""
    settled: bool
    """Whether it ended by itself, before the cap."""
    position: NDArray[np.float32]
    """Positions at the end [m], shape [n_particles, 3]."""
    frames: NDArray[np.float32] | None
    """Positions at `EngineSettings.frame_rate` [m], shape [frame_count, n_particles, 3]."""
