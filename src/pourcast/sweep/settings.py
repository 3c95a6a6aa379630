"""What must be computed, once for each scene: a setting.

Two kinds. A `PourSetting` is one deterministic pour; all models that ask for it
share it, so that the uncertain IFE costs nothing beside the deterministic one. A
`JudgeSetting` is a whole judgment by a model whose answer is its own: SimpleSim,
draws of noisy starts, models of other packages.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, field, fields
from functools import cache, cached_property
from typing import Any

from pourcast.models.base import Model, SimulationModel, averages_pours, choices_of
from pourcast.scenes.goals.base import Goal
from pourcast.scenes.liquids.base import RESERVED, Liquid
from pourcast.scenes.liquids.registry import known_liquids
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import engine_version
from pourcast.simulation.settings import EngineSettings, Kind
from pourcast.simulation.versions import code_version, defining_modules
from pourcast.sweep.cost import pour_seconds, simulated_seconds


@dataclass(frozen=True, eq=False)
class PourSetting:
    """A pour, in any scene: `Pour` without the scene.

    Two are the same if they have one outcome, whatever their liquids are called.
    """

    kind: Kind
    liquid: Liquid
    n_particles: int
    damping_zeta: float
    offset: tuple[float, float] = (0.0, 0.0)
    engine: EngineSettings = field(default_factory=EngineSettings)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PourSetting) and self.identity == other.identity

    def __hash__(self) -> int:
        return hash(self.identity)

    @classmethod
    def of(cls, pour: Pour, engine: EngineSettings | None = None) -> "PourSetting":
        """The setting of a pour, computed with engine settings (by default as they come)."""
        liquid, zeta = pour.liquid, float(pour.damping_zeta)
        engine = engine or EngineSettings()
        return cls(pour.kind, liquid, pour.n_particles, zeta, pour.offset, engine)

    def pours_in(self, scene: Scene) -> list[Pour]:
        """The one pour in a scene."""
        zeta, offset = self.damping_zeta, self.offset
        return [Pour(scene, self.liquid, self.n_particles, zeta, offset, self.kind)]

    @cached_property
    def identity(self) -> str:
        """All that determines the outcome in a scene, as JSON; but for the code."""
        content = asdict(self) | {"liquid": self.liquid.engine_identity}
        del content["engine"]
        return json.dumps(content | named_engine(self.engine), sort_keys=True)

    @property
    def version(self) -> str:
        """Name of the state of the code that determines the outcome; see `engine_version`."""
        return engine_version()

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
        spacing = self.engine.spacing_in(scene, self.n_particles)
        return pour_seconds(
            self.kind, self.liquid, self.n_particles, self.damping_zeta, spacing, self.engine
        )


@dataclass(frozen=True)
class JudgeSetting:
    """A model's judgment of a scene, of a trial with a liquid, with a seed."""

    name: str
    """Name of the model's class."""
    model: Model
    liquid: Liquid
    seed: int
    engine: EngineSettings = field(default_factory=EngineSettings)
    """What its pours are computed with; of no account for a model without any."""

    @cached_property
    def identity(self) -> str:
        """All that determines the judgment of a scene, as JSON; but for the code."""
        content: dict[str, Any] = {
            "model": self.name,
            "parameters": self.model.parameters(),
            "liquid": _as_models_see(self.liquid),
            "seed": self.seed,
        }
        if named := _named_liquids(self.model):
            content["liquids"] = named
        if fingerprint := self.model.fingerprint:
            content["fingerprint"] = fingerprint
        if averages_pours(self.model):
            content |= named_engine(self.engine)
        return json.dumps(content, sort_keys=True)

    @property
    def version(self) -> str:
        """Name of the state of the code that determines the judgment; see `model_version`."""
        return model_version(type(self.model))

    @cached_property
    def order(self) -> tuple[Any, ...]:
        """Place among all settings: after the pours, same models together."""
        return (*self.group, 0.0, self.identity)

    @property
    def group(self) -> tuple[str, int, str]:
        """What is alike, in words: kind, number of particles, model."""
        return "model", getattr(self.model, "n_particles", 0), self.name

    def pours_in(self, scene: Scene) -> list[Pour]:
        """Pours in a scene that the judgment is the mean of; none if it judges otherwise."""
        if averages_pours(self.model):
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
        return sum(PourSetting.of(pour, self.engine).seconds(scene) for pour in pours)


Setting = PourSetting | JudgeSetting


def digest(setting: Setting) -> bytes:
    """Short name of a setting and of the state of its code: 16 bytes."""
    return hashlib.sha256(f"{setting.identity} {setting.version}".encode()).digest()[:16]


def model_version(model: type[Model]) -> str:
    """Name of the state of the code that a model judges with, but for the goals' own.

    Parameters
    ----------
    model
        The model, ours or another package's.
    """
    without: tuple[str, ...] = ("pourcast.scenes.goals", "pourcast.simulation.versions")
    if not issubclass(model, SimulationModel):
        without += ("pourcast.models.base",)  # It decides nothing for models that don't pour.
    return code_version(defining_modules(model, Model), without)


def goal_version(goal: type[Goal]) -> str:
    """Name of the state of the code that says what a goal holds, and where its solids are.

    Parameters
    ----------
    goal
        The goal, ours or another package's.
    """
    return code_version((*defining_modules(goal, Goal), Goal.__module__), words=False)


ENGINE = "engine"
"""What names the engine settings of results that were not computed with them as they come."""


def named_engine(engine: EngineSettings) -> dict[str, Any]:
    """What of the engine settings is not as they come: all of them that results name."""
    standard = asdict(EngineSettings())
    changed = {name: v for name, v in asdict(engine).items() if v != standard[name]}
    return {ENGINE: changed} if changed else {}


_NOT_SEEN = ("called", "goals", "film_seconds")
"""What a liquid says of itself, but no model can judge by."""


def _as_models_see(liquid: Liquid) -> dict[str, Any]:
    """All of a liquid that a model can judge by, another package's or ours."""
    return {name: value for name, value in asdict(liquid).items() if name not in _NOT_SEEN}


def _named_liquids(model: Model) -> list[dict[str, float]]:
    """What the liquids are like that a model's parameters name."""
    names = [
        getattr(model, entry.name)
        for entry in fields(model)
        if isinstance(getattr(model, entry.name), str) and choices_of(entry.metadata) is not None
    ]
    return [liquid for name in names for liquid in _liquids_called(name)]


@cache
def _liquids_called(name: str) -> list[dict[str, float]]:
    known = known_liquids() if name != RESERVED else []
    return [one.engine_identity for one in known if name in (one.name, one.called)]
