"""Here and now, one task after another: for work that is done before a process has started."""

from collections.abc import Iterable, Iterator

from pourcast.sweep.executors import Heartbeat
from pourcast.sweep.task import Task, TaskResult


class InProcessExecutor:
    """Does tasks in the process that asks for them; a crash of theirs is a crash of its own."""

    def run(self, tasks: Iterable[Task], heartbeat: Heartbeat) -> Iterator[TaskResult]:
        """Do tasks; see `Executor`."""
        for task in tasks:
            yield task.run(heartbeat)

    def close(self) -> None:
        """Nothing runs on."""
