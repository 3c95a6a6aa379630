"""Members that are found by name: one file each in a folder, or in other installed packages."""

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.resources import files
from typing import Any, Generic, TypeVar

from pourcast.errors import InputError, unknown

Member = TypeVar("Member")

_INFRASTRUCTURE = frozenset({"base", "registry"})
"""Files of a folder of members that are no members."""


@dataclass(frozen=True)
class Registry(Generic[Member]):
    """Members of one kind, such as goals; none is imported to list their names.

    Parameters
    ----------
    noun
        What a member is, for error messages.
    package
        The folder: a file ``some_name.py`` in it is the member ``some-name``.
    attribute
        Name that such a file gives to its member.
    group
        Entry points by which other packages add members.
    check
        Called with a name and what was found; raises `InputError` if that is no member.
    """

    noun: str
    package: str
    attribute: str
    group: str
    check: Callable[[str, Any], Member]

    def built_in(self) -> tuple[str, ...]:
        """Names of the members that come with pourcast, in alphabetical order."""
        stems = stems_of(self.package, ".py")
        return tuple(stem.replace("_", "-") for stem in stems if stem not in _INFRASTRUCTURE)

    def third_party(self) -> dict[str, EntryPoint]:
        """Members of other installed packages."""
        return dict(_entries(self.group, tuple(sys.path)))

    def names(self) -> list[str]:
        """All names; a third-party member takes the place of a built-in one of its name."""
        return list(dict.fromkeys([*self.built_in(), *self.third_party()]))

    def get(self, name: str) -> Member:
        """A member.

        Raises
        ------
        InputError
            If there is none of that name, it can't be imported, or is not a member.
        """
        if name not in self.names():
            raise InputError(f"{self.noun}: {unknown(name, self.names())}")
        entry = self.third_party().get(name)
        try:
            member = self.read(name) if entry is None else entry.load()
        except Exception as error:  # whatever somebody else's module does when it is imported
            why = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{self.noun} {name!r} cannot be loaded: {why}") from error
        return self.check(name, member)

    def all(self) -> tuple[dict[str, Member], dict[str, str]]:
        """Members by name; and what is wrong with those of other packages that can't be had."""
        members, broken = {}, {}
        for name in self.names():
            try:
                members[name] = self.get(name)
            except InputError as error:
                broken[name] = str(error)
        return members, broken

    def read(self, name: str) -> Any:
        """What the file of a built-in member holds."""
        module = importlib.import_module(f"{self.package}.{name.replace('-', '_')}")
        return getattr(module, self.attribute)


@cache
def _entries(group: str, _path: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Entry points of a group by name.

    Every installed package is looked through for them, which takes milliseconds: once for each
    search path, as a plan of many settings asks for liquids' names thousands of times.
    """
    return {entry.name: entry for entry in entry_points(group=group)}


@cache
def stems_of(package: str, suffix: str) -> tuple[str, ...]:
    """Names of a package's files with a suffix, without it, in alphabetical order."""
    names = [entry.name for entry in files(package).iterdir() if entry.name.endswith(suffix)]
    return tuple(sorted(n.removesuffix(suffix) for n in names if not n.startswith("_")))
