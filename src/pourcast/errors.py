"""Errors that the command line shows as one line, and the words that they are made of."""

import difflib
from collections.abc import Iterable, Sequence
from types import TracebackType
from typing import Any, Protocol


class InputError(ValueError):
    """Something that was given to pourcast is wrong.

    The message is one line that names the file or option, the field, and what
    was expected. The command line prints it and exits with status 2.
    """


class ManyFaultsError(InputError):
    """Several things that are wrong with one input.

    The message has a line for each. The command line prints them and exits with status 2.

    Parameters
    ----------
    lines
        What is wrong, each as an `InputError` says it.
    """

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = tuple(lines)


class Faults:
    """What is wrong with one input, to be told at once.

    Each check is made within it, as a context, which keeps the `InputError` that is raised there.

    Examples
    --------
    >>> faults = Faults()
    >>> for value in (0.5, 7, 9):
    ...     with faults:
    ...         if value > 1:
    ...             raise InputError(f"expected 0..1, found {value}")
    >>> faults.lines
    ['expected 0..1, found 7', 'expected 0..1, found 9']
    """

    MOST = 20
    """Lines that are told, of more the number."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __enter__(self) -> "Faults":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        if not isinstance(error, InputError):
            return False
        self.lines += error.lines if isinstance(error, ManyFaultsError) else [str(error)]
        return True

    def refuse(self) -> None:
        """Raise what was kept, if anything was.

        Raises
        ------
        InputError
            With a line for each, `MOST` at most.
        """
        lines = list(dict.fromkeys(self.lines))
        if len(lines) > self.MOST:
            lines[self.MOST :] = [f"and {len(lines) - self.MOST} more faults"]
        if lines:
            raise ManyFaultsError(lines) if len(lines) > 1 else InputError(lines[0])


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
