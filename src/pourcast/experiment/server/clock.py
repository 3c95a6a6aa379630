"""The time of a server that runs: it goes on evenly, whatever is done to the machine's clock."""

import time
from collections.abc import Callable

Clock = Callable[[], float]
"""Says the time [s]."""


def even_clock() -> float:
    """Seconds since some moment, that nobody sets; they go on while the machine sleeps.

    Python's own `time.monotonic` stands still then, on Linux and on macOS.
    """
    for name in ("CLOCK_BOOTTIME", "CLOCK_MONOTONIC"):
        if hasattr(time, name):
            return time.clock_gettime(getattr(time, name))
    return time.monotonic()


class RunningClock:
    """Seconds since 1970 as the machine's clock said at the start, and those gone by since.

    Parameters
    ----------
    wall
        Seconds since 1970; may be set by somebody at any time.
    even
        Seconds since some moment; nobody sets it.
    """

    def __init__(self, wall: Clock = time.time, even: Clock = even_clock) -> None:
        self._even = even
        self._began = wall() - even()

    def __call__(self) -> float:
        """The time [s]."""
        return self._began + self._even()
