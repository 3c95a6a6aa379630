"""Where tasks are done, such as a sweep's shards: one file each; `local` is the default.

An executor does tasks in any order, on any number of workers, and yields what
became of each. It needs no care beyond that: workers may die, and a task may be
handed to two of them. What must not be lost is in the store.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Protocol

from pourcast.sweep.task import Task, TaskResult

Heartbeat = Callable[[int, float], None]
"""Called now and then while work goes on, with what workers have done since the last call
in tasks that are not finished, if they can tell: simulations, and rough work [s]."""


class Executor(Protocol):
    """A place where tasks are done."""

    def run(self, tasks: Iterable[Task], heartbeat: Heartbeat) -> Iterator[TaskResult]:
        """Do tasks, and yield what became of each, as they end."""
        ...

    def close(self) -> None:
        """Stop whatever is still running."""
        ...


def run_futures(
    submit: Callable[[Task], "Future[TaskResult]"],
    tasks: Iterable[Task],
    room: Callable[[], int],
    beat: Callable[[], None],
) -> Iterator[TaskResult]:
    """Keep some futures going, and yield what they give.

    Parameters
    ----------
    submit
        Starts a task.
    tasks
        All tasks; taken only when there is room.
    room
        How many may be on their way now.
    beat
        Called twice a second.
    """
    left = iter(tasks)
    running: dict[Future[TaskResult], Task] = {}
    while True:
        for task in left if len(running) < room() else ():
            running[submit(task)] = task
            if len(running) >= room():
                break
        if not running:
            return
        ended, _ = wait(running, timeout=0.5, return_when=FIRST_COMPLETED)
        beat()
        for future in ended:
            yield _result_of(future, running.pop(future))


def _result_of(future: "Future[TaskResult]", task: Task) -> TaskResult:
    try:
        return future.result()
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        return TaskResult(task.id, "lost", f"its worker died ({reason})")
