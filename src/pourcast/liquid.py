"""Liquids: what flows, as far as the particle engine is concerned."""

from dataclasses import dataclass

from pourcast.errors import InputError


@dataclass(frozen=True)
class Liquid:
    """A liquid's parameters.

    Parameters
    ----------
    name
        Name in tables and on the command line.
    viscosity_alpha
        Artificial viscosity alpha of Monaghan (1992), dimensionless, >= 0.
    adhesion_normal, adhesion_tangential
        Rates [1/s] at which the speed across and along a surface decays while a
        particle touches it, >= 0 (the paper's "stickiness").

    Examples
    --------
    >>> WATER.viscosity_alpha
    0.01
    """

    name: str
    viscosity_alpha: float
    adhesion_normal: float = 0.0
    adhesion_tangential: float = 0.0

    def __post_init__(self) -> None:
        for field in ("viscosity_alpha", "adhesion_normal", "adhesion_tangential"):
            value = getattr(self, field)
            if not 0.0 <= value < float("inf"):
                raise InputError(f"liquid {self.name!r}: {field} must be at least 0, not {value}")


_HONEY_ADHESION = 60.0

WATER = Liquid("water", 0.01)
"""Bates et al., section "Intuitive Fluids Engine": alpha = 0.01, no stickiness."""

HONEY_EXP1 = Liquid("honey-exp1", 2.0, _HONEY_ADHESION, _HONEY_ADHESION)
"""Honey of Experiment 1. The paper contradicts itself about alpha (1.25 in its
parameter table); 2 agrees with the stimuli, whose honey was the thicker one."""

HONEY_EXP2 = Liquid("honey-exp2", 1.25, _HONEY_ADHESION, _HONEY_ADHESION)
"""Honey of Experiment 2 (the other reading of the paper: alpha = 2)."""

LIQUIDS = {liquid.name: liquid for liquid in (WATER, HONEY_EXP1, HONEY_EXP2)}
"""The presets by name. To swap the paper's two readings, name the other one."""
