"""What a model is, and how its parameters are declared.

A model is a frozen dataclass: its fields are its parameters, each declared
with `parameter` (default, unit, range, meaning), and its method `judge` says,
scene by scene, which share of the liquid the goal will hold.
"""

import itertools
import json
import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import Any, ClassVar, TypeGuard

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import (
    InputError,
    ModelError,
    SimulationDivergedError,
    StoreError,
    unknown,
)
from pourcast.progress import Progress, no_progress
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.memory import REMEMBERED, outcomes_of
from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings


def parameter(
    default: Any,
    *,
    doc: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] | Callable[[], Sequence[str]] | None = None,
) -> Any:
    """Declare a model's parameter; use it as the value of a dataclass field.

    Parameters
    ----------
    default
        Its default.
    doc
        What it means, in one line.
    unit
        SI unit.
    low, high
        Range, both ends included; either can be left open.
    choices
        Allowed words, for a parameter that is one; or what lists them when they are needed.
    """
    return field(
        default=default,
        metadata={"doc": doc, "unit": unit, "low": low, "high": high, "choices": choices},
    )


@dataclass(frozen=True)
class Model(ABC):
    """Base of all models. Subclasses are frozen dataclasses too.

    Raises
    ------
    InputError
        If a parameter is out of its range.
    """

    seconds_per_judgment: ClassVar[float] = 0.01
    """Rough time of a judgment on one core [s]; sweeps size their pieces of work by it.
    Of no account for a `SimulationModel`, whose pours are counted."""

    def __post_init__(self) -> None:
        for entry in fields(self):
            _check(type(self).__name__, entry.name, getattr(self, entry.name), entry.metadata)

    @abstractmethod
    def judge(
        self,
        scenes: Sequence[Scene],
        liquid: Liquid,
        seed: int = 0,
        *,
        progress: Progress = no_progress,
    ) -> NDArray[np.float64]:
        """Judge scenes.

        Parameters
        ----------
        scenes
            The scenes.
        liquid
            The liquid shown in the trial.
        seed
            Source of all randomness.
        progress
            Called with (done, in all) as the work goes on.

        Returns
        -------
        ndarray
            One judgment in 0..1 for each scene.
        """

    @classmethod
    def follows_trial(cls, parameters: typing.Mapping[str, Any]) -> bool:
        """Whether judgments depend on the liquid that a trial shows.

        Where they don't, those of trials with one liquid stand for those with any other.

        Parameters
        ----------
        parameters
            Names and values, as `parameters` gives them.
        """
        return True

    def parameters(self) -> dict[str, Any]:
        """Names and values of the parameters; a liquid's is its name."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {k: v.name if isinstance(v, Liquid) else v for k, v in values.items()}

    @property
    def fingerprint(self) -> str:
        """Name of all else that its judgments depend on, such as the content of a file.

        By default what a study says of its own liquids, which `parameters` has only by name.
        """
        values = [getattr(self, entry.name) for entry in fields(self)]
        own = [value.engine_identity for value in values if isinstance(value, Liquid)]
        return json.dumps(own) if own else ""

    @property
    def remark(self) -> str:
        """What a reader of its judgments should know of how it came about; half a sentence."""
        return ""


def judge_checked(
    model: "Model",
    spec: str,
    scenes: Sequence[Scene],
    liquid: Liquid,
    seed: int,
    progress: Progress = no_progress,
) -> NDArray[np.float64]:
    """Let a model judge, and make sure that what it says are judgments.

    Parameters
    ----------
    model
        The model, of another package maybe.
    spec
        What it is called, for error messages.
    scenes, liquid, seed, progress
        See `Model.judge`.

    Returns
    -------
    ndarray
        Shape [scene_count], each 0..1.

    Raises
    ------
    ModelError
        If it fails, or says anything else.
    """
    with failing_as(spec):
        said = model.judge(scenes, liquid, seed, progress=progress)
        return checked_judgments(said, spec, scenes)


@contextmanager
def failing_as(spec: str) -> Iterator[None]:
    """What a model's code or a goal's raises is the model's failure, but for what says itself."""
    try:
        yield
    except (InputError, ModelError, SimulationDivergedError, StoreError):
        raise
    except Exception as error:
        raise ModelError(f"model {spec!r} failed: {type(error).__name__}: {error}") from error


def checked_judgments(said: Any, model: str, scenes: Sequence[Scene]) -> NDArray[np.float64]:
    """Judgments that can be trusted to be some.

    Parameters
    ----------
    said
        What a model said: one number for each scene.
    model
        Its spec, for error messages.
    scenes
        The scenes.

    Returns
    -------
    ndarray
        The same, shape [scene_count].

    Raises
    ------
    ModelError
        If there is not one for each scene, or one is no number from 0 to 1.
    """
    values = np.asarray(said)
    if values.dtype.kind not in "fiub":
        raise ModelError(f"model {model!r}: expected numbers, found {type(said).__name__}")
    if values.shape != (len(scenes),):
        raise ModelError(
            f"model {model!r}: expected one judgment for each of {len(scenes)} scenes, found an "
            f"array of shape {list(values.shape)}"
        )
    wrong = np.flatnonzero(~((values >= 0.0) & (values <= 1.0)))
    if len(wrong):
        raise ModelError(
            f"model {model!r}: scene {scenes[wrong[0]].id!r}: expected a judgment from 0 to 1, "
            f"found {values[wrong[0]]}"
        )
    return values.astype(np.float64)


def _check(owner: str, name: str, value: Any, rules: typing.Mapping[str, Any]) -> None:
    choices = choices_of(rules)
    if isinstance(value, Liquid):
        return
    if choices is not None and value not in choices:
        raise InputError(f"{owner}: {name}: {unknown(str(value), choices)}")
    if value is None or isinstance(value, str):
        return
    low, high = rules.get("low"), rules.get("high")
    inside = (low is None or value >= low) and (high is None or value <= high)
    if not (inside and np.isfinite(value)):
        unit = f" {rules['unit']}" if rules.get("unit") else ""
        expected = range_in_words(rules) or "a finite number"
        raise InputError(f"{owner}: {name}: expected {expected}{unit}, found {value:g}")


def choices_of(rules: typing.Mapping[str, Any]) -> Sequence[str] | None:
    """Words that a parameter can be; None if it is no choice of words."""
    choices = rules.get("choices")
    return choices() if callable(choices) else choices


def range_in_words(rules: typing.Mapping[str, Any]) -> str:
    """Range of a parameter; empty if there is none.

    Examples
    --------
    >>> range_in_words({"low": 0, "high": 100}), range_in_words({"low": 0, "high": None})
    ('0 to 100', 'at least 0')
    """
    low, high = rules.get("low"), rules.get("high")
    if low is not None and high is not None:
        return f"{low:g} to {high:g}"
    if low is not None:
        return f"at least {low:g}"
    return "" if high is None else f"at most {high:g}"


def zeta_window(damping_zeta: float, zeta_sigma: int) -> list[float]:
    """Dampings over which the uncertain IFE averages: zeta - sigma .. zeta + sigma, step 1.

    Values below 0 are left out (the paper's best MarbleSim for water, zeta = 2
    with sigma = 4, would reach them).

    Examples
    --------
    >>> zeta_window(5.0, 4)
    [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
    >>> zeta_window(2.0, 4)
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    """
    window = [damping_zeta + k for k in range(-zeta_sigma, zeta_sigma + 1)]
    return [zeta for zeta in window if zeta >= 0.0]


class SimulationModel(Model):
    """A model that judges by running pours and averaging what they say."""

    same_pours_everywhere: ClassVar[bool] = False
    """Whether `pours` gives the same pours in all scenes with one kind of goal, and
    with any seed, so that sweeps can share them between models."""

    @abstractmethod
    def pours(self, scene: Scene, liquid: Liquid, seed: int = 0) -> list[Pour]:
        """Pours whose judgments are averaged for a scene; the middle one is the typical one."""

    def judge(
        self,
        scenes: Sequence[Scene],
        liquid: Liquid,
        seed: int = 0,
        *,
        progress: Progress = no_progress,
    ) -> NDArray[np.float64]:
        """Judge scenes: the mean over `pours`. See `Model.judge`."""
        groups = [self.pours(scene, liquid, seed) for scene in scenes]
        return np.array(means_over_pours(groups, progress=progress))


def averages_pours(model: Model) -> TypeGuard[SimulationModel]:
    """Whether a model's judgments are the means over its pours, and nothing else."""
    return isinstance(model, SimulationModel) and type(model).judge is SimulationModel.judge


def typical_pour(pours: Sequence[Pour]) -> Pour:
    """The one of a model's pours of a scene that is pictured."""
    return pours[len(pours) // 2]


def means_over_pours(
    groups: Sequence[Sequence[Pour]],
    pictured: Sequence[bool] = (),
    *,
    settings: EngineSettings | None = None,
    remember: bool = False,
    progress: Progress = no_progress,
) -> list[np.float64]:
    """Mean judgment over each group of pours, each different pour run once.

    Parameters
    ----------
    groups
        Pours of a model in a scene, group by group.
    pictured
        For each group whether its typical pour is recorded; by default none is.
    settings
        How pours are computed.
    remember
        Whether this process's memory of outcomes is used.
    progress
        Called with the pours that were run, and how many are.
    """
    pours = [pour for group in groups for pour in group]
    starts = itertools.accumulate((len(group) for group in groups), initial=0)
    typical = [start + len(group) // 2 for start, group in zip(starts, groups, strict=False)]
    judgments = iter(
        outcomes_of(
            pours,
            attrgetter("judgment"),
            settings=settings,
            record=list(itertools.compress(typical, pictured)),
            memory=REMEMBERED if remember else None,
            progress=progress,
        )
    )
    return [np.mean([next(judgments) for _ in group]) for group in groups]
