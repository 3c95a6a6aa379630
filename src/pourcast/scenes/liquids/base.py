"""What a liquid is: one definition for the engine, the stimuli, the page and the report."""

import re
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Strict

from pourcast.errors import InputError
from pourcast.numbers import plain_number

_NAME = re.compile(r"[a-z][a-z0-9-]{0,39}")
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
RESERVED = "trial"
"""Stands for the liquid that a trial shows, in models' parameters."""

_Number = Annotated[float, Strict()]
"""In a file, neither true nor "0.1" is one."""

_RANGES = {
    "viscosity_alpha": (0.0, 10.0),  # the step shrinks with it
    "cohesion": (0.0, 1.0),
    "tension": (0.0, 1.0),
    "adhesion_normal": (0.0, 1e6),
    "adhesion_tangential": (0.0, 1e6),
    "kinematic_viscosity": (1e-9, 10.0),
    "slip": (0.0, 1.0),
    "slip_length": (0.0, 1.0),
    "wall_pull": (0.0, 100.0),
    "film_seconds": (0.1, 120.0),
}
"""Smallest and largest values."""


@dataclass(frozen=True)
class Liquid:
    """A liquid.

    Parameters
    ----------
    name
        Name in tables and on the command line: small letters, digits, hyphens.
    viscosity_alpha
        Particle engine: artificial viscosity alpha of Monaghan (1992), dimensionless, 0..10.
    cohesion
        Particle engine: surface tension over density [m^3/s^2], 0..1, by which it holds together
        (`engine.cohesion`). Real water has 7.3e-5.
    tension
        Particle engine: least pressure over c^2 rho0, with the sign reversed, 0..1. 0: none below
        that at rest; 1: the equation of state without a bound (`engine.equation_of_state`).
    adhesion_normal, adhesion_tangential
        Particle engine: rates [1/s] at which the speed across and along a surface decays while
        a particle touches it, 0..1e6 (the paper's "stickiness").
    kinematic_viscosity
        Stimuli's solver [m^2/s], 1e-9..10; water has 1e-6.
    slip
        Stimuli's solver: 1 lets the liquid slip along walls, 0 holds it: thick liquid without
        slip (but see `slip_length`), thin liquid by the drag of its boundary layer.
    slip_length
        Stimuli's solver, where walls hold the liquid: how far behind them its speed would vanish
        (Navier 1823) [m of the film's real size], 0..1; 0 is no slip at all.
    wall_pull
        Stimuli's solver: acceleration at a wall towards it [m/s^2], 0..100 (the paper's: none).
    colour
        ``#rrggbb``, in every picture.
    glass_colour
        ``#rrggbb`` of light that has gone through it, where it is rendered as glass; by default
        its colour, lightened.
    film_seconds
        How long its films run [s], 0.1..120.
    called
        What participants, trials and reports call it, by default its name. Several liquids can
        be called alike; `goals` then tells which of them is meant.
    goals
        Kinds of goals in whose scenes `called` means this liquid; none: in all others.

    Raises
    ------
    InputError
        If a value is of another type, or out of its range.

    Examples
    --------
    >>> Liquid("oil", viscosity_alpha=0.4, kinematic_viscosity=5e-5).called
    'oil'
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    name: str
    viscosity_alpha: _Number
    adhesion_normal: _Number = 0.0
    adhesion_tangential: _Number = 0.0
    cohesion: _Number = 0.0
    tension: _Number = 0.0
    kinematic_viscosity: _Number = 1e-6
    slip: _Number = 1.0
    slip_length: _Number = 0.0
    wall_pull: _Number = 0.0
    colour: str = "#2978cc"
    glass_colour: str = ""
    film_seconds: _Number = 4.0
    called: str = ""
    goals: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.called:
            object.__setattr__(self, "called", self.name)
        for field in ("name", "called"):
            value = getattr(self, field)
            if not isinstance(value, str) or not _NAME.fullmatch(value) or value == RESERVED:
                raise InputError(
                    f"liquid: {field}: expected small letters, digits and hyphens, such as "
                    f"'olive-oil' (not {RESERVED!r}), found {value!r}"
                )
        for field, (low, high) in _RANGES.items():
            value = plain_number(getattr(self, field), f"liquid {self.name!r}: {field}")
            object.__setattr__(self, field, value)
            if not low <= value <= high:
                raise InputError(
                    f"liquid {self.name!r}: {field}: expected {low:g} to {high:g}, found {value}"
                )
        for field in ("colour", "glass_colour"):
            value = getattr(self, field)
            is_colour = isinstance(value, str) and _COLOUR.fullmatch(value)
            if not is_colour and (field, value) != ("glass_colour", ""):
                raise InputError(
                    f"liquid {self.name!r}: {field}: expected #rrggbb, found {value!r}"
                )

        if not isinstance(self.goals, tuple) or not all(isinstance(g, str) for g in self.goals):
            raise InputError(
                f"liquid {self.name!r}: goals: expected a tuple of kinds of goals, such as "
                f"('basins',), found {self.goals!r}"
            )

    @property
    def rgb(self) -> tuple[float, float, float]:
        """Red, green and blue of its colour, 0..1 each."""
        return _rgb(self.colour)

    @property
    def glass_rgb(self) -> tuple[float, float, float]:
        """Red, green and blue of light that has gone through it, 0..1 each."""
        if self.glass_colour:
            return _rgb(self.glass_colour)
        red, green, blue = (1.0 - 0.6 * (1.0 - share) for share in self.rgb)
        return red, green, blue

    @property
    def sticky(self) -> bool:
        """Whether it clings to what it touches, in the particle engine."""
        return self.adhesion_tangential > 0.0

    @property
    def engine_identity(self) -> dict[str, float]:
        """All of it that a simulation by the particle engine depends on."""
        return {
            "viscosity_alpha": self.viscosity_alpha,
            "adhesion_normal": self.adhesion_normal,
            "adhesion_tangential": self.adhesion_tangential,
            "cohesion": self.cohesion,
            "tension": self.tension,
        }


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
