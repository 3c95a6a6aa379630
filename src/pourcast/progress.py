"""How long work tells of its progress."""

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with how much is done, and how much there is."""

Report = Callable[[str, int, int], None]
"""Called with what is going on, how much of it is done, and how much there is."""


def no_report(what: str, done: int, total: int) -> None:
    """Tell nobody."""


def no_progress(done: int, total: int) -> None:
    """Tell nobody."""
