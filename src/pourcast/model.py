"""What a model is, how models are found by name, and how their parameters are set.

A model is a frozen dataclass: its fields are its parameters, each declared
with `parameter` (default, unit, range, meaning), and its method `judge` says,
scene by scene, which share of the liquid the goal will hold.

Names come from three places, none of which is imported to list them: the files
in `pourcast/models` (one model each), the presets in `models/presets.toml`
(the paper's names and values), and the entry points of the group
``pourcast.models`` of installed packages.
"""

import difflib
import importlib
import tomllib
import typing
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.resources import files
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.liquid import HONEY_EXP1, HONEY_EXP2, LIQUIDS, Liquid
from pourcast.scene import Scene
from pourcast.simulation import Pour, Progress, simulate

ENTRY_POINT_GROUP = "pourcast.models"

LIQUID_NAMES = ("water", "honey", "honey-exp1", "honey-exp2")


def parameter(
    default: Any,
    *,
    doc: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] | None = None,
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
        Range, both ends included.
    choices
        Allowed words, for a parameter that is one.
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
        progress: Progress | None = None,
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

    def parameters(self) -> dict[str, Any]:
        """Names and values of the parameters."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}

    @property
    def fingerprint(self) -> str:
        """Name of all else that its judgments depend on, such as the content of a file."""
        return ""

    @property
    def remark(self) -> str:
        """What a reader of its judgments should know of how it came about; half a sentence."""
        return ""


def _check(owner: str, name: str, value: Any, rules: typing.Mapping[str, Any]) -> None:
    choices = rules.get("choices")
    if choices is not None and value not in choices:
        raise InputError(f"{owner}: {name}: {unknown(str(value), choices)}")
    low, high = rules.get("low"), rules.get("high")
    if value is None or isinstance(value, str):
        return
    if (
        not np.isfinite(value)
        or (low is not None and value < low)
        or (high is not None and value > high)
    ):
        unit = f" {rules['unit']}" if rules.get("unit") else ""
        raise InputError(f"{owner}: {name}: expected {low:g} to {high:g}{unit}, found {value:g}")


def unknown(name: str, known: Iterable[str]) -> str:
    """Half a sentence about a name that is not known: the nearest one, and all of them."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"there is no {name!r}; {hint}known: {', '.join(names)}"


def resolve_liquid(name: str, scene: Scene) -> Liquid:
    """Liquid of a name; plain `honey` is that of the experiment that the goal belongs to.

    Raises
    ------
    InputError
        If there is no such liquid.
    """
    if name == "honey":
        return HONEY_EXP1 if scene.goal.kind == "basins" else HONEY_EXP2
    if name not in LIQUIDS:
        raise InputError(f"liquid: {unknown(name, LIQUID_NAMES)}")
    return LIQUIDS[name]


def imagined_liquid(name: str, trial_liquid: Liquid, scene: Scene) -> Liquid:
    """Liquid in a model's head: a named one, or with `trial` the one that is shown."""
    return trial_liquid if name == "trial" else resolve_liquid(name, scene)


IMAGINED_LIQUIDS = ("trial", *LIQUID_NAMES)


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
        progress: Progress | None = None,
    ) -> NDArray[np.float64]:
        """Judge scenes: the mean over `pours`. See `Model.judge`."""
        groups = [self.pours(scene, liquid, seed) for scene in scenes]
        outcomes = iter(simulate([pour for group in groups for pour in group], progress=progress))
        return np.array([np.mean([next(outcomes).judgment for _ in group]) for group in groups])


# Names -------------------------------------------------------------------------------


@cache
def presets() -> dict[str, dict[str, Any]]:
    """The paper's models: preset name -> model, parameters and source.

    One that `wants` a parameter can't be made until the user gives it.
    """
    text = files("pourcast.models").joinpath("presets.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def complete_presets() -> list[str]:
    """Names of the presets that want nothing more."""
    return [name for name, entry in presets().items() if "wants" not in entry]


@cache
def family_names() -> tuple[str, ...]:
    """Built-in models, one a file; found by the files' names, without importing them."""
    names = (entry.name for entry in files("pourcast.models").iterdir())
    stems = (name.removesuffix(".py") for name in names if name.endswith(".py"))
    return tuple(sorted(stem.replace("_", "-") for stem in stems if not stem.startswith("_")))


def third_party() -> dict[str, EntryPoint]:
    """Models of other installed packages."""
    return {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}


def model_names() -> list[str]:
    """All names that `make_model` knows: presets, third-party models, families."""
    return [*presets(), *third_party(), *family_names()]


def model_class(name: str) -> type[Model]:
    """Import the class of a family or of a third-party model.

    Raises
    ------
    InputError
        If it can't be imported, or is not a model.
    """
    entry = third_party().get(name)
    try:
        if entry is not None:
            found = entry.load()
        else:
            module = importlib.import_module(f"pourcast.models.{name.replace('-', '_')}")
            found = module.MODEL
    except (ImportError, AttributeError) as error:
        raise InputError(f"model {name!r} cannot be loaded: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Model)):
        raise InputError(f"model {name!r}: expected a subclass of pourcast.Model, found {found!r}")
    return found


def parameter_table(name: str) -> list[dict[str, Any]]:
    """Parameters of a family or third-party model: name, default, unit, range, meaning."""
    return [
        {
            "parameter": entry.name,
            "default": entry.default,
            "unit": entry.metadata.get("unit", ""),
            "range": _range_of(entry.metadata),
            "meaning": entry.metadata.get("doc", ""),
        }
        for entry in fields(model_class(name))
    ]


def _range_of(rules: typing.Mapping[str, Any]) -> str:
    if rules.get("choices"):
        return ", ".join(rules["choices"])
    low, high = rules.get("low"), rules.get("high")
    return "" if low is None and high is None else f"{low} to {high}"


def make_model(spec: str) -> Model:
    """Build a model from its name and, after a colon, its parameters.

    Parameters
    ----------
    spec
        For example ``water-ife`` or ``water-ife:n_particles=75,damping_zeta=8``.

    Returns
    -------
    Model
        The model.

    Raises
    ------
    InputError
        If the name, a parameter or a value is wrong; says the nearest right one.

    Examples
    --------
    >>> make_model("water-ife:n_particles=75").n_particles
    75
    """
    return build_model(*parse_spec(spec))


def parse_spec(spec: str) -> tuple[str, dict[str, str]]:
    """Name of a model, and the texts of its parameters, from a spec; see `make_model`.

    Examples
    --------
    >>> parse_spec("water-ife: n_particles=75, damping_zeta=8")
    ('water-ife', {'n_particles': '75', 'damping_zeta': '8'})
    """
    name, _, assignments = spec.strip().partition(":")
    values: dict[str, str] = {}
    for assignment in filter(None, assignments.split(",")):
        key, equals, text = (part.strip() for part in assignment.partition("="))
        if not equals:
            raise InputError(f"model {name!r}: expected parameter=value, found {assignment!r}")
        values[key] = text
    return name, values


def build_model(name: str, values: typing.Mapping[str, str]) -> Model:
    """Build a model from its name and the texts of its parameters; see `make_model`."""
    if name not in model_names():
        raise InputError(f"model: {unknown(name, model_names())}")
    preset = presets().get(name, {})
    found = model_class(preset.get("model", name))
    given = {key: parse_parameter(name, found, key, text) for key, text in values.items()}
    return found(**(preset.get("parameters", {}) | given))


def parse_parameter(model: str, found: type[Model], key: str, text: str) -> Any:
    """Value of a model's parameter from its text.

    Parameters
    ----------
    model
        Name of the model, for error messages.
    found
        Its class.
    key, text
        Name and value of the parameter; ``none`` for no value.

    Raises
    ------
    InputError
        If there is no such parameter, or the text is of the wrong kind.
    """
    known = [entry.name for entry in fields(found)]
    if key not in known:
        raise InputError(f"model {model!r}: parameter: {unknown(key, known)}")
    wanted = typing.get_type_hints(found)[key]
    options = typing.get_args(wanted) or (wanted,)
    if type(None) in options and text.lower() == "none":
        return None
    for convert in (int, float, str):
        if convert in options:
            try:
                return convert(text)
            except ValueError:
                kind = {int: "a whole number", float: "a number"}.get(convert, "text")
                raise InputError(
                    f"model {model!r}: {key}: expected {kind}, found {text!r}"
                ) from None
    raise InputError(f"model {model!r}: {key} cannot be set here")
