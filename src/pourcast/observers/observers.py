"""Simulated observers: a model's judgments, answered as people might answer them.

They rehearse a study before anybody takes part. Everything made from them says so, in the
column `simulated`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError, unknown
from pourcast.models.registry import make_model
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.statistics.observer import Population
from pourcast.study.responses import TEST
from pourcast.sweep.judgments import LiquidAndModel

STEPS: Mapping[str, float] = {"damping_zeta": 1.0, "n_particles": 5.0, "g": 0.1, "m": 0.02}
"""Parameters in which observers can differ, and the steps of their values."""

SPREADS: Mapping[str, float] = {"damping_zeta": 1.5, "m": 0.02, "g": 0.1}
"""How much observers differ unless it is said otherwise (standard deviation)."""

Judge = Callable[[Sequence[LiquidAndModel]], Mapping[LiquidAndModel, NDArray[np.float64]]]
"""Gets the judgments of models, each of shape [scene_count]."""

_ORDER, _PARAMETERS, _ANSWERS = 0xFFFF_FFFF, 0, 1
"""Streams of randomness: the order of trials; each observer's parameters, and answers."""

_MEDIAN_RT, _RT_LOG_SD = 4.0, 0.4


@dataclass(frozen=True)
class Observers:
    """Who is simulated.

    Parameters
    ----------
    count
        Number of observers.
    models
        Liquid of the trials -> model in the observers' heads.
    groups
        Liquids that each group sees; observers belong to the groups in turn. By default there is
        one group, which sees all.
    own
        The study's own liquids, which the models can name.
    population
        How they answer.
    spreads
        Parameter -> how much observers differ in it (standard deviation); of parameters
        that a model hasn't, nothing comes.
    seed
        Source of all randomness.

    Raises
    ------
    InputError
        If a number or a name is wrong.
    """

    count: int
    models: Mapping[str, str]
    groups: tuple[tuple[str, ...], ...] = ()
    own: tuple[Liquid, ...] = ()
    population: Population = field(default_factory=Population)
    spreads: Mapping[str, float] = field(default_factory=lambda: dict(SPREADS))
    seed: int = 0

    def __post_init__(self) -> None:
        if self.count < 1:
            raise InputError(f"observers: expected at least 1, found {self.count}")
        for name, spread in self.spreads.items():
            if name not in STEPS:
                raise InputError(f"vary: {unknown(name, STEPS)}")
            if not 0.0 <= spread < 1e3:
                raise InputError(f"vary: {name}: expected 0 or more, found {spread:g}")
        for spec in self.models.values():
            make_model(spec, self.own)
        missing = {liquid for group in self.groups for liquid in group} - set(self.models)
        if missing:
            raise InputError(f"observers: {missing.pop()}: no model for the trials of this liquid")

    def seen_by(self, number: int) -> list[tuple[str, str]]:
        """Liquids that an observer sees, and the model for each, before it is varied."""
        groups = self.groups or (tuple(self.models),)
        return [(liquid, self.models[liquid]) for liquid in groups[number % len(groups)]]


def simulate_observers(scenes: Sequence[Scene], observers: Observers, judge: Judge) -> pd.DataFrame:
    """Let observers answer all scenes; an observer answers the same, however many others do.

    Parameters
    ----------
    scenes
        The scenes, each answered once for each liquid that the observer sees.
    observers
        Who answers.
    judge
        Gets the judgments of the models in their heads.

    Returns
    -------
    DataFrame
        `participant`, `scene`, `liquid`, `trial`, `phase`, `response`, `rt` [s], `simulated`, and
        `model`, the one in the observer's head. One shuffled order is shared by all who see
        the same liquids.
    """
    people = [_Person.draw(k, observers) for k in range(observers.count)]
    judged = judge(list(dict.fromkeys(model for person in people for model in person.models)))
    return pd.concat(
        [person.answers(scenes, observers, judged) for person in people], ignore_index=True
    )


@dataclass(frozen=True)
class _Person:
    """One observer, by number, and what is in the head for each liquid that it sees."""

    number: int
    models: tuple[LiquidAndModel, ...]

    @classmethod
    def draw(cls, number: int, observers: Observers) -> "_Person":
        rng = np.random.default_rng([observers.seed, number, _PARAMETERS])
        # One draw a parameter, whatever the liquids: who damps water much damps honey much.
        normal = {name: float(rng.standard_normal()) for name in STEPS}
        seen = observers.seen_by(number)
        return cls(
            number,
            tuple((liquid, _own_spec(spec, observers, normal)) for liquid, spec in seen),
        )

    def answers(
        self,
        scenes: Sequence[Scene],
        observers: Observers,
        judged: Mapping[LiquidAndModel, NDArray[np.float64]],
    ) -> pd.DataFrame:
        """The observer's rows, in the order of the trials."""
        rng = np.random.default_rng([observers.seed, self.number, _ANSWERS])
        styles = observers.population.draw(1, rng)
        judgments = np.concatenate([judged[model] for model in self.models])
        responses = observers.population.respond(judgments, styles, rng)[0]
        times = _MEDIAN_RT * np.exp(_RT_LOG_SD * rng.standard_normal(len(responses)))
        table = pd.DataFrame(
            {
                "participant": f"sim-{self.number + 1:03d}",
                "scene": [scene.id for scene in scenes] * len(self.models),
                "liquid": np.repeat([liquid for liquid, _ in self.models], len(scenes)),
                "trial": 0,
                "phase": TEST,
                "response": responses.round(6),
                "rt": times.round(3),
                "simulated": True,
                "model": np.repeat([spec for _, spec in self.models], len(scenes)),
            }
        )
        order = np.random.default_rng([observers.seed, _ORDER]).permutation(len(table))
        return table.iloc[order].assign(trial=np.arange(1, len(table) + 1))


def _own_spec(spec: str, observers: Observers, normal: Mapping[str, float]) -> str:
    """Spec of the model with an observer's own parameters."""
    model, spreads, own = make_model(spec, observers.own), observers.spreads, []
    for entry in fields(model):
        if not spreads.get(entry.name):
            continue
        step, low, high = STEPS[entry.name], entry.metadata["low"], entry.metadata["high"]
        drawn = getattr(model, entry.name) + spreads[entry.name] * normal[entry.name]
        value = np.clip(step * round(drawn / step), low, high)
        own.append(f"{entry.name}={value:g}")
    joined = ",".join(own)
    if not joined:
        return spec
    return f"{spec},{joined}" if ":" in spec else f"{spec}:{joined}"
