"""How stimuli are made: which solver, which renderer, and their settings."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

SOLVERS = ("lbm", "sph")
"""Free-surface lattice Boltzmann, and the ground truth of the particle engine."""

RENDERERS = ("cycles", "preview")
"""Blender's path tracer, and shaded flat pictures."""

FILM_SECONDS = {"water": 4.0, "honey": 10.0}
"""How long the paper's films run [s], by the liquid's kind."""


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class LatticeRecipe(_Frozen):
    """Settings of the lattice-Boltzmann solver.

    Parameters
    ----------
    resolution
        Cells along the box's longest side (paper: 300).
    real_size
        Real length of that side [m]. Water in a small box falls and comes to rest sooner; paper:
        0.5.
    honey_viscosity
        [Pa s]; paper: 0.1 in Experiment 1 and 0.002 in Experiment 2, which is the default. Real
        honey has some 10.
    honey_slip
        1 lets honey slip along walls, as in the paper; 0 holds it.
    honey_adhesion
        Acceleration of honey at a wall towards it [m/s^2]; paper: none.
    """

    solver: Literal["lbm"] = "lbm"
    resolution: int = Field(default=100, ge=20, le=600)
    real_size: float = Field(default=0.5, gt=0.0, le=20.0)
    honey_viscosity: float | None = Field(default=None, gt=0.0, le=1000.0)
    honey_slip: float = Field(default=1.0, ge=0.0, le=1.0)
    honey_adhesion: float = Field(default=0.0, ge=0.0, le=100.0)


class ParticleRecipe(_Frozen):
    """The particle engine's ground truth; it has nothing to choose."""

    solver: Literal["sph"] = "sph"


class PreviewRecipe(_Frozen):
    """Settings of the flat renderer.

    Parameters
    ----------
    width
        Of the pictures [pixels]; their height follows from the box.
    """

    renderer: Literal["preview"] = "preview"
    width: int = Field(default=600, ge=80, le=4000, multiple_of=2)


class CyclesRecipe(_Frozen):
    """Settings of Blender's Cycles.

    Parameters
    ----------
    width, height
        Of the pictures [pixels].
    samples
        Paths per pixel; noise falls with their square root.
    denoise
        Whether to smooth away what noise is left.
    """

    renderer: Literal["cycles"] = "cycles"
    width: int = Field(default=640, ge=80, le=4000, multiple_of=2)
    height: int = Field(default=960, ge=80, le=4000, multiple_of=2)
    samples: int = Field(default=64, ge=1, le=4096)
    denoise: bool = True


class Recipe(_Frozen):
    """How a set of stimuli is made.

    Parameters
    ----------
    flow, look
        Solver and renderer with their settings.
    seconds
        Length of films [s]; the paper's by default, `FILM_SECONDS`.
    webm
        Whether films are made as WebM, too.

    Examples
    --------
    >>> Recipe(flow=LatticeRecipe(resolution=300), look=CyclesRecipe()).name
    'lbm-cycles'
    """

    flow: Annotated[LatticeRecipe | ParticleRecipe, Field(discriminator="solver")]
    look: Annotated[PreviewRecipe | CyclesRecipe, Field(discriminator="renderer")]
    seconds: float | None = Field(default=None, gt=0.0, le=120.0)
    webm: bool = False

    @property
    def name(self) -> str:
        """Name of the set: solver and renderer."""
        return f"{self.flow.solver}-{self.look.renderer}"

    def film_seconds(self, liquid: str) -> float:
        """Length of a liquid's films [s]."""
        return FILM_SECONDS[liquid] if self.seconds is None else self.seconds


QUICK = Recipe(flow=ParticleRecipe(), look=PreviewRecipe())
"""There in no time: what an experiment shows if nothing better was made."""
