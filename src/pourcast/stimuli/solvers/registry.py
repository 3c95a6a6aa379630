"""Solvers by name: the files of this folder, and those of other packages.

An installed package adds one by an entry point of the group ``pourcast.solvers``.
"""

from typing import Any

from pourcast.errors import InputError
from pourcast.registry import Registry
from pourcast.stimuli.solvers.base import Solver


def _checked(name: str, member: Any) -> type[Solver]:
    if not (isinstance(member, type) and issubclass(member, Solver)):
        raise InputError(f"solver {name!r}: expected a subclass of Solver, found {member!r}")
    if member.name != name:
        raise InputError(f"solver {name!r}: its name should be {name!r}, not {member.name!r}")
    return member


SOLVERS = Registry("solver", "pourcast.stimuli.solvers", "SOLVER", "pourcast.solvers", _checked)
"""All solvers."""
