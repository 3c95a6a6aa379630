"""Where shards are done: one file each; `local` is the default.

An executor does shards in any order, on any number of workers, and yields what
became of each. It needs no care beyond that: workers may die, and a shard may be
handed to two of them. What must not be lost is in the store.
"""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Protocol

from pourcast.sweep.shard import ShardResult, ShardTask

Heartbeat = Callable[[int, float], None]
"""Called now and then while work goes on, with what workers have done since the last call
in shards that are not finished, if they can tell: simulations, and rough work [s]."""


class Executor(Protocol):
    """A place where shards are done."""

    def run(self, tasks: Iterable[ShardTask], heartbeat: Heartbeat) -> Iterator[ShardResult]:
        """Do shards, and yield what became of each, as they end."""
        ...

    def close(self) -> None:
        """Stop whatever is still running."""
        ...


def run_futures(
    submit: Callable[[ShardTask], "Future[ShardResult]"],
    tasks: Iterable[ShardTask],
    room: Callable[[], int],
    beat: Callable[[], None],
) -> Iterator[ShardResult]:
    """Keep some futures going, and yield what they give.

    Parameters
    ----------
    submit
        Starts a shard.
    tasks
        All shards; taken only when there is room.
    room
        How many may be on their way now.
    beat
        Called twice a second.
    """
    left = iter(tasks)
    running: dict[Future[ShardResult], ShardTask] = {}
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


def _result_of(future: "Future[ShardResult]", task: ShardTask) -> ShardResult:
    try:
        return future.result()
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        return ShardResult(task.shard.id, "lost", f"its worker died ({reason})")
