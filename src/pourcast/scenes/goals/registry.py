"""Goals by name: the files of this folder, and those of other packages.

An installed package adds one by an entry point of the group ``pourcast.goals``.
"""

from typing import Any

from pourcast.errors import InputError
from pourcast.registry import Registry
from pourcast.scenes.goals.base import Goal


def _checked(name: str, member: Any) -> type[Goal]:
    if not (isinstance(member, type) and issubclass(member, Goal)):
        raise InputError(f"goal {name!r}: expected a subclass of pourcast.Goal, found {member!r}")
    kind = member.model_fields["kind"].default
    if kind != name:
        raise InputError(f"goal {name!r}: its kind should be {name!r}, not {kind!r}")
    return member


GOALS = Registry("goal", "pourcast.scenes.goals", "GOAL", "pourcast.goals", _checked)
"""All goals."""
