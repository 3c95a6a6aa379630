"""Processes of this machine; one that dies takes only its task with it."""

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

import numpy as np
from pebble import ProcessPool

from pourcast.sweep.executors import Heartbeat, run_futures
from pourcast.sweep.task import Task, TaskResult

_SLOTS = 4096

_counters: Any = None
"""Shared memory for what was done: a pair (simulations, rough work [s]) for each worker,
at an index by its process number. Nobody waits for a lock: a worker that is killed would
take it to its grave. Should two share one, the bar is off a little, and nothing else."""


class LocalExecutor:
    """Worker processes, one task at a time each, on one core each.

    Parameters
    ----------
    workers
        How many.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        context = multiprocessing.get_context("spawn")
        self._done = context.RawArray("d", 2 * _SLOTS)
        self._seen = np.zeros(2)
        self._pool = ProcessPool(
            workers, initializer=_begin, initargs=(self._done,), context=context
        )

    def run(self, tasks: Iterable[Task], heartbeat: Heartbeat) -> Iterator[TaskResult]:
        """Do tasks; see `Executor`."""

        def beat() -> None:
            done = np.frombuffer(self._done).reshape(_SLOTS, 2).sum(axis=0)
            simulations, seconds = done - self._seen
            heartbeat(int(simulations), float(seconds))
            self._seen = done

        def submit(task: Task) -> Future[TaskResult]:
            with _uninterrupted():
                return self._pool.schedule(_work, args=(pickle.dumps(task),))

        # One more than there are workers, so that nobody waits for the next.
        yield from run_futures(submit, tasks, lambda: self.workers + 1, beat)

    def close(self) -> None:
        """End the workers at once; what they were at is lost, and nothing else."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Block Ctrl-C in this thread, and in processes that it starts.

    A terminal sends it to all of them, and one that is just starting would answer with a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # When Python starts its tracker it unblocks the signal: before, and not between.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(counters: Any) -> None:
    """Set a worker up; it ends when its parent does, however that ended."""
    global _counters  # noqa: PLW0603  one a process, handed over at its start
    _counters = counters
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def _work(packed: bytes) -> TaskResult:
    # Unpacked here, for that may import much: pebble holds a lock while it hands work over, and a
    # worker that was killed just then would take it to its grave.
    task: Task = pickle.loads(packed)
    return task.run(_count)


def _count(simulations: int, seconds: float) -> None:
    index = 2 * (os.getpid() % _SLOTS)
    _counters[index] += simulations
    _counters[index + 1] += seconds
