"""How long work tells of its progress, and how long it will still take."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[int, int], None]
"""Called with how much is done, and how much there is; first before any of it is done."""

Report = Callable[[str, int, int], None]
"""Called with what is going on, how much of it is done, and how much there is."""


def no_report(what: str, done: int, total: int) -> None:
    """Tell nobody."""


def no_progress(done: int, total: int) -> None:
    """Tell nobody."""


_meanwhile: list[str] = []


@contextmanager
def meanwhile(words: str) -> Iterator[None]:
    """Something that work waits for, of which its own count says nothing."""
    _meanwhile.append(words)
    try:
        yield
    finally:
        _meanwhile.remove(words)


def waits_for() -> str:
    """What work waits for now, in words; empty if for nothing that is known."""
    return next(iter(_meanwhile[-1:]), "")


_SHORTEST_MEASUREMENT = 1.0
"""A rate is measured over so long at least [s]."""

_WINDOW = 10.0
"""A rate is measured over the last half of the work's time, but over so long at least [s]."""

_APART = 0.25
"""What is seen in shorter intervals counts as seen at once [s]."""


class TimeLeft:
    """How long work will still take, by the rate at which it went lately.

    Work that begins anew (less is done than before, or there is more or less in all) is measured
    anew. What is done when it is first seen is not counted: work may go on where it stopped.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float]] = deque()
        self._begin = 0.0
        self._total = 0.0

    def see(self, now: float, done: float, total: float) -> None:
        """Take in how far the work is.

        Parameters
        ----------
        now
            Time, of any clock [s].
        done, total
            How much is done, and how much there is, in any unit.
        """
        if not self._seen or total != self._total or done < self._seen[-1][1]:
            self._seen.clear()
            self._begin, self._total = now, total
        elif len(self._seen) > 1 and now - self._seen[-2][0] < _APART:
            self._seen.pop()
        self._seen.append((now, done))

    def seconds(self, now: float) -> float | None:
        """Time that the work will still take [s]; None if no rate can be told yet.

        Parameters
        ----------
        now
            Time, of the same clock [s].
        """
        since = now - max(_WINDOW, (now - self._begin) / 2)
        while len(self._seen) > 2 and self._seen[1][0] <= since:
            self._seen.popleft()
        if not self._seen:
            return None
        (begin, done_then), (_, done) = self._seen[0], self._seen[-1]
        if done <= done_then or now - begin < _SHORTEST_MEASUREMENT:
            return None
        return (now - begin) * (self._total - done) / (done - done_then)


def duration_in_words(seconds: float) -> str:
    """A duration in the unit that suits it.

    Parameters
    ----------
    seconds
        The duration [s].

    Examples
    --------
    >>> duration_in_words(40.2), duration_in_words(600.0), duration_in_words(9000.0)
    ('40 s', '10 min', '2.5 h')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
