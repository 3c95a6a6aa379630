"""Processes of this machine; one that dies takes only its shard with it."""

import multiprocessing
import os
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from typing import TYPE_CHECKING

from pebble import ProcessPool

from pourcast.sweep.executors import Heartbeat, run_futures
from pourcast.sweep.shard import ShardResult, ShardTask, run_shard

if TYPE_CHECKING:
    from multiprocessing.sharedctypes import Synchronized

_counter: "Synchronized[int] | None" = None


class LocalExecutor:
    """Worker processes, one shard at a time each, on one core each.

    Parameters
    ----------
    workers
        How many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        context = multiprocessing.get_context("spawn")
        self._done = context.Value("q", 0)
        self._seen = 0
        self._pool = ProcessPool(
            workers, initializer=_begin, initargs=(self._done,), context=context
        )

    def run(self, tasks: Iterable[ShardTask], heartbeat: Heartbeat) -> Iterator[ShardResult]:
        """Do shards; see `Executor`."""

        def beat() -> None:
            done = self._done.value
            heartbeat(done - self._seen)
            self._seen = done

        def submit(task: ShardTask) -> Future[ShardResult]:
            return self._pool.schedule(_work, args=(task,))

        # One more than there are workers, so that nobody waits for the next.
        yield from run_futures(submit, tasks, lambda: self.workers + 1, beat)

    def close(self) -> None:
        """End the workers at once; what they were at is lost, and nothing else."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()


def _begin(counter: "Synchronized[int]") -> None:
    """Set a worker up; it ends when its parent does, however that ended."""
    global _counter  # noqa: PLW0603  one per process, handed over at its start
    _counter = counter
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def _work(task: ShardTask) -> ShardResult:
    return run_shard(task, _count)


def _count(done: int) -> None:
    if _counter is not None:
        with _counter.get_lock():
            _counter.value += done
