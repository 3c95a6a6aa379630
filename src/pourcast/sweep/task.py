"""A piece of work that an executor can hand to a worker, on this machine or another."""

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from pourcast.errors import ModelError

OnWork = Callable[[int, float], None]
"""Called now and then with simulations that were done since the last call, and rough work [s]."""


def no_work(simulations: int, seconds: float) -> None:
    """Tell nobody."""


@dataclass(frozen=True)
class TaskResult:
    """What became of a task.

    `done`: its result is kept. `busy`: another process is at it. `failed`: it raised an
    error. `lost`: its worker died. `store`: the result couldn't be kept.
    """

    task: str
    outcome: Literal["done", "busy", "failed", "lost", "store"]
    message: str = ""


def told(error: Exception) -> str:
    """What an error says, and where it was raised, in one line."""
    first = error.__cause__ or error
    where = traceback.extract_tb(first.__traceback__)[-1]
    line = f"{Path(where.filename).name}, line {where.lineno}"
    kind = "" if isinstance(error, ModelError) else f"{type(error).__name__}: "
    return f"{kind}{error} ({line})"


class Task(Protocol):
    """A piece of work; it can be pickled, and keeps its result by itself."""

    @property
    def id(self) -> str:
        """Name of the task, different from all others'."""
        ...

    def run(self, on_work: OnWork = no_work) -> TaskResult:
        """Do the work; never raises an ordinary error."""
        ...


def run_task(task: Task) -> TaskResult:
    """Do a task; what workers that tell nobody of their progress are given."""
    return task.run()
