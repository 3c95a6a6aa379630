"""Numbers that are given from Python: plain ones are taken, NumPy's made plain, others refused."""

from typing import Any

import numpy as np

from pourcast.errors import InputError


def plain_number(value: Any, where: str) -> int | float:
    """A number; of NumPy's own kind, which would be counted with in its precision, a plain one.

    Parameters
    ----------
    value
        What was given.
    where
        What it was given for, in words: the first part of the error.

    Raises
    ------
    InputError
        If it is no single real number. True and False are none, nor are words that spell one.

    Examples
    --------
    >>> plain_number(np.float32(0.5), "pour: damping_zeta")
    0.5
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where}: expected a number, found {_shown(value)}")
    return value


def whole_number(value: Any, where: str) -> int:
    """The same for a whole number; see `plain_number`. 2.0 is none.

    Examples
    --------
    >>> whole_number(np.int64(50), "pour: n_particles")
    50
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{where}: expected a whole number, found {_shown(value)}")
    return value


def _shown(value: Any) -> str:
    """What was given, in one line."""
    return " ".join(repr(value).split())
