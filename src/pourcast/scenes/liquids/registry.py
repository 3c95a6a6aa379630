"""Liquids by name: the files of this folder, those of other packages, and a study's own.

An installed package adds one by an entry point of the group ``pourcast.liquids`` that names a
`Liquid`; a study by a table ``[liquids.<name>]`` in its `study.toml`. What a study defines is
handed on as `own`: nothing is global.
"""

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.resources import files
from typing import Any

from pydantic import TypeAdapter, ValidationError

from pourcast.errors import InputError, one_line, unknown
from pourcast.registry import Registry, stems_of
from pourcast.scenes.liquids.base import RESERVED, Liquid
from pourcast.scenes.scene import Scene

_PACKAGE = "pourcast.scenes.liquids"
_LIQUID = TypeAdapter(Liquid)


def liquid_from(name: str, table: Mapping[str, Any], source: str) -> Liquid:
    """A liquid from its table in a TOML file.

    Parameters
    ----------
    name
        Its name.
    table
        The fields of `Liquid` but its name.
    source
        Name of file and table, for error messages.

    Raises
    ------
    InputError
        One line that names the source, the field and what was expected.
    """
    fields = [entry.name for entry in dataclasses.fields(Liquid) if entry.name != "name"]
    for key in table:
        if key not in fields:
            raise InputError(f"{source}: {unknown(key, fields)}")
    try:
        return _LIQUID.validate_python({**table, "name": name})
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error)}") from None


class _Liquids(Registry[Liquid]):
    """Liquids: each a TOML file instead of a module."""

    def built_in(self) -> tuple[str, ...]:
        return stems_of(self.package, ".toml")

    def read(self, name: str) -> Liquid:
        text = files(self.package).joinpath(f"{name}.toml").read_text(encoding="utf-8")
        return liquid_from(name, tomllib.loads(text), f"{name}.toml")


def _checked(name: str, member: Any) -> Liquid:
    if not isinstance(member, Liquid):
        raise InputError(f"liquid {name!r}: expected a pourcast.Liquid, found {member!r}")
    if member.name != name:
        raise InputError(f"liquid {name!r}: its name should be {name!r}, not {member.name!r}")
    return member


LIQUIDS = _Liquids("liquid", _PACKAGE, "LIQUID", "pourcast.liquids", _checked)
"""All liquids but studies' own."""


_UNKNOWN_COLOUR = "#666666"


@cache
def _named(name: str) -> Liquid:
    return LIQUIDS.get(name)


@cache
def _loadable(names: tuple[str, ...]) -> tuple[Liquid, ...]:
    """Liquids that can be had; one that can't is told of by who names it, and hurts no other."""
    known = []
    for name in names:
        with suppress(InputError):
            known.append(_named(name))
    return tuple(known)


WATER = _named("water")
HONEY_EXP1 = _named("honey-exp1")
HONEY_EXP2 = _named("honey-exp2")


def known_liquids(own: Sequence[Liquid] = ()) -> list[Liquid]:
    """All liquids, a study's own first.

    Raises
    ------
    InputError
        If one of a study's own has the name of another.
    """
    others = list(_loadable(tuple(LIQUIDS.names())))
    taken = {name for liquid in others for name in (liquid.name, liquid.called)}
    for liquid in own:
        if liquid.name in taken:
            raise InputError(f"liquid {liquid.name!r}: there is one of that name already")
        taken.add(liquid.name)
    return [*own, *others]


def called(name: str) -> str:
    """What a liquid of a name is called: ``honey`` for the honey of either experiment.

    Examples
    --------
    >>> called("honey-exp1"), called("my-syrup")
    ('honey', 'my-syrup')
    """
    return next((known.called for known in known_liquids() if known.name == name), name)


def colour_of(name: str, own: Sequence[Liquid] = ()) -> str:
    """Colour of a liquid in figures, ``#rrggbb``, by its name or what it is called.

    Examples
    --------
    >>> colour_of("honey") == colour_of("honey-exp2") == HONEY_EXP2.colour
    True
    """
    return next(
        (known.colour for known in known_liquids(own) if name in (known.name, known.called)),
        _UNKNOWN_COLOUR,
    )


def liquid_names(own: Sequence[Liquid] = ()) -> list[str]:
    """Names that `resolve_liquid` knows: what liquids are called, then their names."""
    known = known_liquids(own)
    water_first = sorted(known, key=lambda liquid: liquid is not WATER)
    names = [*(liquid.called for liquid in water_first), *(liquid.name for liquid in water_first)]
    return list(dict.fromkeys(names))


def resolve_liquid(name: str | Liquid, scene: Scene, own: Sequence[Liquid] = ()) -> Liquid:
    """The liquid that a name means in a scene.

    Parameters
    ----------
    name
        A liquid's name, or what several are called: then the scene's goal decides, so that plain
        ``honey`` is that of the scene's experiment.
    scene
        The scene.
    own
        The study's own liquids.

    Raises
    ------
    InputError
        If there is none.
    """
    if isinstance(name, Liquid):
        return name
    known = known_liquids(own)
    kind = scene.goal.kind
    alike = [liquid for liquid in known if liquid.called == name]
    meant = [
        *(liquid for liquid in known if liquid.name == name),
        *(liquid for liquid in alike if kind in liquid.goals),
        *(liquid for liquid in alike if not liquid.goals),
    ]
    if not meant and alike:
        raise InputError(f"liquid: {name!r} is none in scenes with the goal {kind!r}")
    if not meant and name in LIQUIDS.names():
        LIQUIDS.get(name)  # says what is wrong with it
    if not meant:
        raise InputError(f"liquid: {unknown(name, liquid_names(own))}")
    return meant[0]


def imagined_liquid(name: str | Liquid, trial_liquid: Liquid, scene: Scene) -> Liquid:
    """Liquid in a model's head: a named one, or with ``trial`` the one that is shown."""
    return trial_liquid if name == RESERVED else resolve_liquid(name, scene)


def imagined_names() -> list[str]:
    """What a model's liquid can be named: ``trial``, or any liquid."""
    return [RESERVED, *liquid_names()]
