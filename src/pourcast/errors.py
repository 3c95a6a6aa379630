"""Errors that the command line shows as one line, and the words that they are made of."""

import difflib
from collections.abc import Iterable
from typing import Any, Protocol


class InputError(ValueError):
    """Something that was given to pourcast is wrong.

    The message is one line that names the file or option, the field, and what
    was expected. The command line prints it and exits with status 2.
    """


class StoreError(RuntimeError):
    """Results can't be kept or read: the disk is full, read-only or gone.

    The message is one line. The command line prints it and exits with status 1.
    """


class ClusterError(RuntimeError):
    """A cluster that did the work is gone; what was finished is kept.

    The message is one line. The command line prints it and exits with status 1.
    """


class TrainingError(RuntimeError):
    """A network did not learn.

    The message is one line. The command line prints it and exits with status 1.
    """


class ModelError(RuntimeError):
    """A model failed, or said what is no judgment.

    The message is one line. The command line prints it and exits with status 1.
    """


class SimulationDivergedError(RuntimeError):
    """A simulation broke: what it says can't be trusted.

    The message is one line. The command line prints it and exits with status 1.

    Parameters
    ----------
    message
        What is wrong.
    number
        Which simulation of those that were run together it is, from 0.
    """

    def __init__(self, message: str, *, number: int = 0) -> None:
        super().__init__(message)
        self.number = number


def unknown(name: str, known: Iterable[str]) -> str:
    """Half a sentence about a name that is not known: the nearest one, and all of them.

    Examples
    --------
    >>> unknown("watr", ["water", "honey"])
    "there is no 'watr'; did you mean 'water'? known: water, honey"
    """
    names = list(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"there is no {name!r}; {hint}known: {', '.join(names)}"


class Complaints(Protocol):
    """A `pydantic.ValidationError`, as far as it is needed here, where nobody loads pydantic."""

    def errors(self) -> list[Any]:
        """What is wrong, field by field."""
        ...


def one_line(error: Complaints) -> str:
    """First complaint of a validation error: the field's path, what was expected and found."""
    first = error.errors()[0]
    path = ""
    for part in first["loc"]:
        if isinstance(part, int):
            path += f"[{part}]"
        else:
            path += f".{part}" if path else str(part)
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] in _BOUNDS:
        message += f", found {first['input']}"
    others = len(error.errors()) - 1
    more = f" (and {others} more faults)" if others else ""
    return f"{path}: {message}{more}" if path else message + more


_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
