"""How pours are computed."""

import math
from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np

from pourcast.engine.job import Stepping
from pourcast.engine.packing import (
    SUPPORT_IN_SPACINGS,
    spacing_of,
)
from pourcast.errors import InputError, unknown
from pourcast.numbers import plain_number
from pourcast.scenes.scene import Scene

Kind = Literal["liquid", "marbles"]
"""SPH liquid, or rigid spheres."""

ViscousPairs = Literal["approaching", "all"]
"""Pairs that artificial viscosity acts on."""

_RANGES: dict[str, tuple[float, float]] = {
    "step": (1e-6, 0.1),
    "marble_step": (1e-6, 0.005),
    "sound_speed": (1.0, math.inf),
    "support_in_spacings": (1.2, 4.0),
    "courant": (1e-3, math.inf),
    "frame_rate": (1.0, 10_000.0),
    "max_duration": (1e-3, 3600.0),
    "contact_radius": (0.2, 0.6),  # above, contact gives water energy
    "contact_layer": (1e-3, 1.0),
    "marble_radius": (0.2, 0.7),
    "damping_scale": (1e-3, 10.0),
}


@dataclass(frozen=True)
class EngineSettings:
    """How we compute. None of it is in the world, and none in anybody's head.

    Of what the paper leaves open, the radii and the scale of damping are inferred from what it
    publishes about models (`docs/explanation/open-choices.md`).

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
    contact_radius
        Radius of the sphere as which a liquid's particle meets solids, over the particle
        spacing, 0.2 to 0.6. Half a spacing would be the distance of the outermost particles of
        a packing from its border. Contact gives water energy in larger spheres: 0.5 % of that at
        the start at 0.6, 2 % at 0.65, and at 0.7 pours diverge.
    contact_layer
        How far beyond that radius a particle still touches a solid and may stick to it, in
        radii, 0.001 to 1.
    marble_radius
        Radius of a marble over the particle spacing, 0.2 to 0.7. With 0.5, marbles fill 52 % of
        the liquid's volume; with 0.62, all of it.
    viscous_pairs
        Pairs that artificial viscosity acts on: ``approaching`` (Monaghan 1992, section 4.1), or
        ``all`` (Monaghan 2005, Rep. Prog. Phys. 68, section 8).
    damping_scale
        What a damping zeta of 1/s takes from the acceleration, over the velocity [1/s], 0.001 to
        10. With 0.5 it is as if the damping had acted in one of two half-steps of an
        integrator.
    dimensions
        3, or 2: a slab one particle thick, between panes.

    Raises
    ------
    InputError
        If a value is no number, not finite or out of its range.
    """

    step: float = 4e-4
    marble_step: float = 5e-4
    sound_speed: float = 30.0
    support_in_spacings: float = SUPPORT_IN_SPACINGS
    courant: float = 0.4
    frame_rate: float = 30.0
    max_duration: float = 10.0
    contact_radius: float = 0.45
    contact_layer: float = 0.1
    marble_radius: float = 0.5
    viscous_pairs: ViscousPairs = "approaching"
    damping_scale: float = 1.6
    dimensions: Literal[2, 3] = 3

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name not in ("viscous_pairs", "dimensions"):
                value = getattr(self, field.name)
                plain = plain_number(value, f"engine settings: {field.name}")
                object.__setattr__(self, field.name, plain)
        if self.viscous_pairs not in get_args(ViscousPairs):
            known = unknown(str(self.viscous_pairs), get_args(ViscousPairs))
            raise InputError(f"engine settings: viscous_pairs: {known}")
        if not isinstance(self.dimensions, int | np.integer) or self.dimensions not in (2, 3):
            raise InputError(
                f"engine settings: dimensions: expected 2 or 3, found {self.dimensions!r}"
            )
        object.__setattr__(self, "dimensions", int(self.dimensions))
        for name in ("contact_radius", "marble_radius"):
            if self.dimensions == 2 and getattr(self, name) > 0.5:
                raise InputError(
                    f"engine settings: {name}: expected at most 0.5 in a slab that is one spacing "
                    f"thick, found {getattr(self, name)}"
                )
        for name, (low, high) in _RANGES.items():
            value = getattr(self, name)
            if not (low <= value <= high and math.isfinite(value)):
                expected = f"at least {low:g}" if high == math.inf else f"{low:g} to {high:g}"
                raise InputError(f"engine settings: {name}: expected {expected}, found {value}")

    def depth_in(self, scene: Scene, n_particles: int) -> float:
        """Depth of a scene's box as it is simulated [m]: its own, or a particle spacing."""
        if self.dimensions == 3:
            return scene.box.depth
        return math.sqrt(math.pi / n_particles) * scene.liquid.diameter / 2

    def spacing_in(self, scene: Scene, n_particles: int) -> float:
        """Particle spacing of a scene's liquid [m]."""
        depth = self.depth_in(scene, n_particles)
        return spacing_of(n_particles, scene.liquid.diameter / 2, depth)

    def contact_radius_in(self, scene: Scene, n_particles: int, kind: Kind) -> float:
        """Radius as which particles meet solids, and marbles one another [m]."""
        spacings = self.marble_radius if kind == "marbles" else self.contact_radius
        return spacings * self.spacing_in(scene, n_particles)

    def stepping(self, kind: Kind, spacing: float, viscosity_alpha: float) -> Stepping:
        """Step and number of steps a frame for particles of a given spacing [m]."""
        step = self.marble_step
        if kind == "liquid":
            smoothing_length = 0.5 * self.support_in_spacings * spacing
            signal_speed = self.sound_speed * (1.0 + 0.6 * viscosity_alpha)
            step = min(self.step, self.courant * smoothing_length / signal_speed)
        steps = int(np.ceil(1.0 / (self.frame_rate * step) - 1e-9))
        return Stepping(step=1.0 / (self.frame_rate * steps), steps_per_frame=steps)
