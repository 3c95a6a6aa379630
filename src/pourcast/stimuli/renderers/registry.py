"""Renderers by name: the files of this folder, and those of other packages.

An installed package adds one by an entry point of the group ``pourcast.renderers``.
"""

from typing import Any

from pourcast.errors import InputError
from pourcast.registry import Registry
from pourcast.stimuli.renderers.base import Renderer


def _checked(name: str, member: Any) -> type[Renderer]:
    if not (isinstance(member, type) and issubclass(member, Renderer)):
        raise InputError(f"renderer {name!r}: expected a subclass of Renderer, found {member!r}")
    if member.name != name:
        raise InputError(f"renderer {name!r}: its name should be {name!r}, not {member.name!r}")
    return member


RENDERERS = Registry(
    "renderer", "pourcast.stimuli.renderers", "RENDERER", "pourcast.renderers", _checked
)
"""All renderers."""
