"""Many simulations at once: a block of them a thread, in lockstep or one by one.

Simulations of one particle count and step run in lockstep where there are enough of them to fill
the lanes; the others one at a time, their particles in the lanes (`block`). One that has come to
rest leaves its lane, and the next in the queue takes it. When the queue is empty and few are left
in a block, they go on one by one, on whatever threads are free; several threads share a large one.

A simulation's result has the same bits alone, in any batch and on any number of threads.
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from pourcast.cores import available_cores
from pourcast.engine.block import (
    Block,
    Kind,
    Lockstep,
    Simulation,
    SingleLiquid,
    SingleMarbles,
    lanes_worth,
)
from pourcast.engine.clusters import most_members
from pourcast.engine.contact import LIST_SKIN
from pourcast.engine.job import Job, Result, Stepping
from pourcast.engine.polygons import Solids
from pourcast.engine.simd import LANES, flush_denormals
from pourcast.engine.solids import BroadPhase, build_broad_phase, join_broad_phases

OnDone = Callable[[int, Result], None]
"""Called from a worker thread with number and result of each job that ended."""


@dataclass(frozen=True)
class Batch:
    """Simulations of one particle count, kind and step."""

    jobs: Sequence[Job]
    """All with the same number of particles."""
    solids: Solids
    """Polygons of the scenes that the jobs name."""
    stepping: Stepping
    kind: Kind = "liquid"

    @property
    def particle_count(self) -> int:
        """Number of particles of each simulation."""
        return len(self.jobs[0].position)


def run_batch(
    jobs: Sequence[Job],
    solids: Solids,
    stepping: Stepping,
    *,
    kind: Kind = "liquid",
    record: bool = False,
    threads: int | None = None,
    on_done: OnDone | None = None,
) -> list[Result]:
    """Run simulations of one particle count, and return where each ended: a single `Batch`.

    For parameters, result and errors see `run_batches`.
    """
    batch = Batch(jobs, solids, stepping, kind)
    return run_batches([batch], record=record, threads=threads, on_done=on_done)


def run_batches(
    batches: Sequence[Batch],
    *,
    record: bool = False,
    threads: int | None = None,
    on_done: OnDone | None = None,
) -> list[Result]:
    """Run the simulations of several batches, and return where each ended.

    Parameters
    ----------
    batches
        The simulations. They are numbered through, batch after batch.
    record
        Keep the positions of every frame.
    threads
        Worker threads; all cores by default. Results don't depend on it.
    on_done
        Called from a worker thread with number and result of each job that ended.

    Returns
    -------
    list of Result
        In the order of the jobs.

    Raises
    ------
    SimulationDivergedError
        If a simulation breaks (`diagnostics`); its `number` is the job's.
    """
    batches = [batch for batch in batches if batch.jobs]
    total = sum(len(batch.jobs) for batch in batches)
    if not total:
        return []
    results: list[Result | None] = [None] * total

    def done(number: int, result: Result) -> None:
        results[number] = result
        if on_done is not None:
            on_done(number, result)

    worker_count = min(threads or available_cores(), sum(_most_threads(b) for b in batches))
    with ThreadPoolExecutor(worker_count, initializer=flush_denormals) as pool:
        work = _Work(worker_count, done)
        try:
            first = 0
            for batch in batches:
                broad_phase = _broad_phase_of(batch.jobs, batch.solids, pool, worker_count)
                work.add(batch, broad_phase, first, record=record)
                first += len(batch.jobs)
            futures = [pool.submit(work.run) for _ in range(worker_count)]
            for future in as_completed(futures):  # the first that fails ends the others
                future.result()
        finally:
            work.stop()
    return [result for result in results if result is not None]


def _most_threads(batch: Batch) -> int:
    """Threads that a batch may have work for."""
    members = most_members(batch.particle_count) if batch.kind == "liquid" else 1
    return members * len(batch.jobs)


@dataclass
class _Queue:
    """What is left to do of a batch."""

    batch: Batch
    broad_phase: BroadPhase
    waiting: deque[Simulation] = field(default_factory=deque)

    @property
    def cost(self) -> float:
        """A measure of the work that is waiting; measured, it grows so with N."""
        each: float = self.batch.particle_count**1.4 * self.batch.stepping.steps_per_frame
        return len(self.waiting) * each


class _Work:
    """Queues of simulations, and the threads that empty them."""

    def __init__(self, worker_count: int, on_done: OnDone) -> None:
        self._worker_count, self._on_done = worker_count, on_done
        self._queues: list[_Queue] = []
        self._singles: list[SingleLiquid] = []
        """Those that are running."""
        self._changed = threading.Condition()
        self._busy = 0
        self._stopped = False

    def add(self, batch: Batch, broad_phase: BroadPhase, first: int, *, record: bool) -> None:
        """Add a batch, whose jobs' numbers begin with `first`."""
        queue = _Queue(batch, broad_phase)
        for number, job in enumerate(batch.jobs, first):
            recorded = (job.position.copy(),) if record else None
            queue.waiting.append(Simulation(number, job, recorded=recorded))
        self._queues.append(queue)
        # What takes longest comes first, so that all threads end at about the same time.
        self._queues.sort(key=lambda queue: queue.cost, reverse=True)

    def stop(self) -> None:
        """Let the threads end after the frame that they are at."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def run(self) -> None:
        """Work until nothing is left; one thread."""
        while (call := self._take()) is not None:
            call()

    def _take(self) -> Callable[[], None] | None:
        """What to do next: run a block, or help another thread with its single simulation.

        Waits for what other threads may hand over, or need help with.
        """
        with self._changed:
            while not self._stopped:
                left = [queue for queue in self._queues if queue.waiting]
                if left:
                    self._busy += 1
                    return partial(self._run_and_tell, *self._next_block(left))
                if not self._busy:
                    return None
                single = next((one for one in self._singles if one.wants_help), None)
                if single is not None:
                    return single.join()
                self._changed.wait()
        return None

    def _run_and_tell(self, queue: _Queue, block: Block, taken: list[Simulation]) -> None:
        if isinstance(block, SingleLiquid):
            with self._changed:
                self._singles.append(block)
                self._changed.notify_all()
        try:
            self._run_block(queue, block, taken)
        finally:
            with self._changed:
                if isinstance(block, SingleLiquid):
                    self._singles.remove(block)
                    block.regroup(alone=True)
                self._busy -= 1
                self._changed.notify_all()

    def _next_block(self, left: Sequence[_Queue]) -> tuple[_Queue, Block, list[Simulation]]:
        queue = left[0]
        count, kind = queue.batch.particle_count, queue.batch.kind
        # This thread and those that have nothing to do yet share what is waiting.
        free = 1 + self._worker_count - self._busy
        sharing = -(-free // len(left))
        width = min(LANES, -(-len(queue.waiting) // sharing))
        block: Block
        if width >= lanes_worth(count):
            block = Lockstep(count, kind)
        else:
            block = SingleMarbles(count) if kind == "marbles" else SingleLiquid(count)
        return queue, block, _take_from(queue.waiting, min(width, block.lanes))

    def _run_block(self, queue: _Queue, block: Block, taken: list[Simulation]) -> None:
        batch, width = queue.batch, len(taken)
        few = lanes_worth(batch.particle_count)
        while not self._stopped:
            if taken:
                block.put(taken, batch.stepping.step)
            block.advance(batch.solids, queue.broad_phase, batch.stepping)
            for number, result in block.take_finished(batch.stepping):
                self._on_done(number, result)
            with self._changed:
                taken = _take_from(queue.waiting, width - len(block.simulations))
                if isinstance(block, SingleLiquid):
                    block.regroup(alone=any(other.waiting for other in self._queues))
                if not block.simulations and not taken:
                    return
                if block.lanes > 1 and len(block.simulations) + len(taken) < few:
                    queue.waiting.extend([*block.take_all(), *taken])
                    return


def _take_from(waiting: deque[Simulation], count: int) -> list[Simulation]:
    return [waiting.popleft() for _ in range(min(count, len(waiting)))]


def _broad_phase_of(
    jobs: Sequence[Job], solids: Solids, pool: Executor, worker_count: int
) -> BroadPhase:
    """Broad phase of all scenes, a share of them a worker."""
    scene_count = len(solids.scene_start) - 1
    extents = np.ones((scene_count, 2))
    for job in jobs:
        extents[job.scene] = job.width, job.height
    reach = max(job.touch + LIST_SKIN * job.radius for job in jobs)
    edges = np.linspace(0, scene_count, worker_count + 1).astype(int)
    shares = pool.map(partial(build_broad_phase, solids, extents, reach), edges[:-1], edges[1:])
    return join_broad_phases([BroadPhase(*share) for share in shares])
