"""What must be computed, once for each scene: a setting.

Two kinds. A `PourSetting` is one deterministic pour; all models that ask for it
share it, so that the uncertain IFE costs nothing beside the deterministic one. A
`JudgeSetting` is a whole judgment by a model whose answer is its own: SimpleSim,
draws of noisy starts, models of other packages.
"""

import hashlib
import json
import sys
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from pourcast.engine.compile import digest_of_sources
from pourcast.models.base import Model, SimulationModel
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour, spacing_in
from pourcast.simulation.settings import Kind
from pourcast.sweep.cost import pour_seconds, simulated_seconds


@dataclass(frozen=True)
class PourSetting:
    """A pour, in any scene: `Pour` without the scene."""

    kind: Kind
    liquid: Liquid
    n_particles: int
    damping_zeta: float
    offset: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def of(cls, pour: Pour) -> "PourSetting":
        """The setting of a pour."""
        liquid, zeta = pour.liquid, float(pour.damping_zeta)
        return cls(pour.kind, liquid, pour.n_particles, zeta, pour.offset)

    def pours_in(self, scene: Scene) -> list[Pour]:
        """The one pour in a scene."""
        zeta, offset = self.damping_zeta, self.offset
        return [Pour(scene, self.liquid, self.n_particles, zeta, offset, self.kind)]

    @cached_property
    def identity(self) -> str:
        """All that determines the outcome in a scene, as JSON; but for the engine's version."""
        content = asdict(self) | {"liquid": self.liquid.engine_identity}
        return json.dumps(content, sort_keys=True)

    @cached_property
    def order(self) -> tuple[Any, ...]:
        """Place among all settings: same engine arrays together, the longest first."""
        duration = simulated_seconds(self.liquid, self.n_particles, self.damping_zeta)
        return (*self.group, -duration, self.identity)

    @property
    def group(self) -> tuple[str, int, str]:
        """What runs in lockstep, in words: kind, number of particles, liquid."""
        name = self.liquid.name if self.kind == "liquid" else ""
        return self.kind, self.n_particles, f"{name} alpha {self.liquid.viscosity_alpha:g}"

    def simulations(self, scene: Scene) -> int:
        """Simulations in a scene."""
        return 1

    def seconds(self, scene: Scene) -> float:
        """Rough time in a scene on one core [s]."""
        spacing = spacing_in(scene, self.n_particles)
        return pour_seconds(self.kind, self.liquid, self.n_particles, self.damping_zeta, spacing)


@dataclass(frozen=True)
class JudgeSetting:
    """A model's judgment of a scene, of a trial with a liquid, with a seed."""

    name: str
    """Name of the model's class."""
    model: Model
    liquid: Liquid
    seed: int

    @cached_property
    def identity(self) -> str:
        """All that determines the judgment of a scene, as JSON; but for the engine's version."""
        content = {
            "model": self.name,
            "parameters": self.model.parameters(),
            "liquid": asdict(self.liquid),  # a model of another package may use all of it
            "seed": self.seed,
            "source": model_source(type(self.model)),
        }
        if fingerprint := self.model.fingerprint:
            content["fingerprint"] = fingerprint
        return json.dumps(content, sort_keys=True)

    @cached_property
    def order(self) -> tuple[Any, ...]:
        """Place among all settings: after the pours, same models together."""
        return (*self.group, 0.0, self.identity)

    @property
    def group(self) -> tuple[str, int, str]:
        """What is alike, in words: kind, number of particles, model."""
        return "model", getattr(self.model, "n_particles", 0), self.name

    def pours_in(self, scene: Scene) -> list[Pour]:
        """Pours in a scene that the judgment is the mean of; none if the model doesn't pour."""
        if isinstance(self.model, SimulationModel):
            return self.model.pours(scene, self.liquid, self.seed)
        return []

    def simulations(self, scene: Scene) -> int:
        """Simulations in a scene; 1 for a judgment without pours."""
        return len(self.pours_in(scene)) or 1

    def seconds(self, scene: Scene) -> float:
        """Rough time in a scene on one core [s]."""
        pours = self.pours_in(scene)
        if not pours:
            return self.model.seconds_per_judgment
        return sum(PourSetting.of(pour).seconds(scene) for pour in pours)


Setting = PourSetting | JudgeSetting


def digest(setting: Setting) -> bytes:
    """Short name of a setting: 16 bytes."""
    return hashlib.sha256(setting.identity.encode()).digest()[:16]


@lru_cache
def model_source(kind: type[Model]) -> str:
    """Name of the state of the file that defines a model; empty if there is none."""
    path = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return digest_of_sources([Path(path)]) if path and Path(path).exists() else ""
