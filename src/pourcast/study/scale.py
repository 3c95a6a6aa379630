"""The scale of responses in a table: what the least and the most that can be answered stand as."""

import re
from dataclasses import dataclass

from pourcast.errors import InputError


@dataclass(frozen=True)
class Scale:
    """What the least and the most that can be answered stand as in a table."""

    low: float
    high: float

    @property
    def words(self) -> str:
        """The range, as messages have it."""
        return f"{self.low:g}..{self.high:g}"


SHARES, PERCENT = Scale(0.0, 1.0), Scale(0.0, 100.0)


def scale_of(text: str) -> Scale:
    """A scale as a user writes it.

    Raises
    ------
    InputError
        If it is none.

    Examples
    --------
    >>> scale_of("0-100"), scale_of("-1..1")
    (Scale(low=0.0, high=100.0), Scale(low=-1.0, high=1.0))
    """
    number = r"[-+]?\d+(?:\.\d+)?"
    found = re.fullmatch(rf"\s*({number})\s*(?:-|\.\.|:)\s*({number})\s*", text)
    if found is None or not float(found[1]) < float(found[2]):
        raise InputError(f"scale: expected LOW-HIGH, such as 0-100 or -1..1, found {text!r}")
    return Scale(float(found[1]), float(found[2]))
