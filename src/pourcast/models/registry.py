"""Models by name: the files of this folder, the paper's presets, and those of other packages.

None is imported to list them. An installed package adds one by an entry point of the group
``pourcast.models`` that names a subclass of `pourcast.Model`.
"""

import tomllib
import typing
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from importlib.resources import files
from typing import Any

from pourcast.errors import InputError, unknown
from pourcast.models.base import Model, choices_of, range_in_words
from pourcast.registry import Registry
from pourcast.scenes.liquids.base import Liquid


def _checked(name: str, member: Any) -> type[Model]:
    if not (isinstance(member, type) and issubclass(member, Model)):
        raise InputError(f"model {name!r}: expected a subclass of pourcast.Model, found {member!r}")
    return member


MODELS = Registry("model", "pourcast.models", "MODEL", "pourcast.models", _checked)
"""Families of models; `presets` are members of them with values of their own."""


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


def model_names() -> list[str]:
    """All names that `make_model` knows: presets, third-party models, families."""
    return [*presets(), *MODELS.third_party(), *MODELS.built_in()]


def parameter_table(name: str) -> list[dict[str, Any]]:
    """Parameters of a family or third-party model: name, default, unit, range, meaning."""
    return [
        {
            "parameter": entry.name,
            "default": entry.default,
            "unit": entry.metadata.get("unit", ""),
            "range": ", ".join(choices_of(entry.metadata) or ()) or range_in_words(entry.metadata),
            "meaning": entry.metadata.get("doc", ""),
        }
        for entry in fields(MODELS.get(name))
    ]


def make_model(spec: str, own: Sequence[Liquid] = ()) -> Model:
    """Build a model from its name and, after a colon, its parameters.

    Parameters
    ----------
    spec
        For example ``water-ife`` or ``water-ife:n_particles=75,damping_zeta=8``.
    own
        The study's own liquids, which parameters can name.

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
    return build_model(*parse_spec(spec), own)


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


def build_model(name: str, values: Mapping[str, str], own: Sequence[Liquid] = ()) -> Model:
    """Build a model from its name and the texts of its parameters; see `make_model`."""
    if name not in model_names():
        raise InputError(f"model: {unknown(name, model_names())}")
    preset = presets().get(name, {})
    found = MODELS.get(preset.get("model", name))
    given = {key: parse_parameter(name, found, key, text, own) for key, text in values.items()}
    return found(**(preset.get("parameters", {}) | given))


def parse_parameter(
    model: str, found: type[Model], key: str, text: str, own: Sequence[Liquid] = ()
) -> Any:
    """Value of a model's parameter from its text.

    Parameters
    ----------
    model
        Name of the model, for error messages.
    found
        Its class.
    key, text
        Name and value of the parameter; ``none`` for no value.
    own
        The study's own liquids.

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
    if Liquid in options and (named := [one for one in own if text in (one.name, one.called)]):
        return named[0]
    if bool in options:
        if (word := text.lower()) not in ("true", "false"):
            raise InputError(f"model {model!r}: {key}: expected true or false, found {text!r}")
        return word == "true"
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


def family_of(name: str) -> str:
    """Family of a preset; any other name is its own."""
    return str(presets().get(name, {}).get("model", name))


def name_of(spec: str) -> str:
    """Model's name in a spec."""
    return spec.strip().partition(":")[0]


def labels_of(specs: Sequence[str]) -> dict[str, str]:
    """What tables and figures call models.

    A preset that wants a parameter goes by its name alone if it is there only once.

    Examples
    --------
    >>> labels_of(["gravity", "water-convnet:weights=net/water.safetensors"])
    {'gravity': 'gravity', 'water-convnet:weights=net/water.safetensors': 'water-convnet'}
    """
    short = {spec: _without_wanted(spec) for spec in dict.fromkeys(specs)}
    counts = Counter(short.values())
    return {spec: label if counts[label] == 1 else spec for spec, label in short.items()}


def _without_wanted(spec: str) -> str:
    name, values = parse_spec(spec)
    wanted = presets().get(name, {}).get("wants")
    if wanted is None:
        return spec
    kept = ",".join(f"{key}={text}" for key, text in values.items() if key != wanted)
    return f"{name}:{kept}" if kept else name
