"""Driving a sweep: what is left goes to an executor, until all is done or given up."""

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

import pandas as pd

from pourcast.errors import InputError, StoreError
from pourcast.extras import optional_module
from pourcast.sweep.executors import Executor
from pourcast.sweep.executors.in_process import InProcessExecutor
from pourcast.sweep.plan import Plan, Shard
from pourcast.sweep.shard import task_of
from pourcast.sweep.store import Damage, Failure, Store
from pourcast.sweep.survey import Survey, survey
from pourcast.sweep.table import gather
from pourcast.sweep.task import TaskResult

ATTEMPTS = 3
"""How often a shard is tried."""

_PATIENCE = 1.0
"""Pause before a shard that another process is at is looked at again [s]."""


@dataclass(frozen=True)
class SweepProgress:
    """Where a sweep is.

    Parameters
    ----------
    shards, simulations, seconds
        Done by now; the simulations of unfinished shards count, as far as they are known.
    all_shards, all_simulations, all_seconds
        To be done in all by this run.
    failed
        Tries that failed.
    """

    shards: int
    all_shards: int
    simulations: int
    all_simulations: int
    seconds: float
    all_seconds: float
    failed: int


SweepReport = Callable[[SweepProgress], None]
"""Called with where a sweep is, now and then."""


def no_sweep_report(now: SweepProgress) -> None:
    """Tell nobody."""


@dataclass(frozen=True)
class SweepResult:
    """How a sweep ended."""

    table: pd.DataFrame
    """Judgments; see `sweep.table.gather`."""
    reused_shards: int
    """Files that were there already; those of other grids are counted too."""
    reused_simulations: int
    done_shards: int
    done_simulations: int
    failures: tuple[Failure, ...]
    damaged: tuple[Damage, ...]
    """Files that were not as they were written; their work was done again."""


def run_sweep(
    plan: Plan,
    store: Store,
    open_executor: Callable[[], Executor],
    *,
    attempts: int = ATTEMPTS,
    in_process_below: float = 0.0,
    report: SweepReport = no_sweep_report,
) -> SweepResult:
    """Do what is left of a plan, and gather the table.

    Parameters
    ----------
    plan
        What is wanted.
    store
        What is done, and where results are kept.
    open_executor
        Opens the place where shards are done; called if there is anything to do, and closed
        at the end.
    attempts
        How often a shard is tried before it is given up; the others go on.
    in_process_below
        If less rough work is left [s of one core], it is done here and now.
    report
        Told of the progress.

    Raises
    ------
    StoreError
        If results can't be kept. What was done before is.
    InputError
        If a package that is needed is not installed, or the store can't be written.
    """
    if plan.trajectories:
        optional_module("zarr", "trajectories")
    store.prepare()
    store.tidy()
    store.keep_grid(plan.grid.name, plan.grid.text)
    before = left = _repaired(plan, store)
    damaged = list(before.damaged)
    failures: list[Failure] = []
    if before.left:
        work = sum(shard.seconds for shard in before.left)
        here = work < in_process_below
        with closing(InProcessExecutor() if here else open_executor()) as executor:
            # Again if a file was damaged as soon as it was written, but not for ever.
            for _ in range(attempts):
                failures = _drive(plan, store, executor, left.left, attempts, report)
                left = _repaired(plan, store)
                damaged += left.damaged
                if {shard.id for shard in left.left} <= {failure.shard for failure in failures}:
                    break
    return SweepResult(
        table=gather(plan, store, left.files.values()),
        reused_shards=len(before.files),
        reused_simulations=plan.simulations - before.simulations,
        done_shards=len(before.left) - len(failures),
        done_simulations=before.simulations - left.simulations,
        failures=tuple(failures),
        damaged=tuple(damaged),
    )


def _repaired(plan: Plan, store: Store, shards: Sequence[Shard] | None = None) -> Survey:
    """What is left, after damaged files have been removed."""
    state = survey(plan, store, shards)
    for damage in state.damaged:
        store.discard(damage)
    return state


def _drive(
    plan: Plan,
    store: Store,
    executor: Executor,
    shards: Sequence[Shard],
    attempts: int,
    report: SweepReport,
) -> list[Failure]:
    """Do shards, again if they fail; returns those that were given up."""
    named = {shard.id: shard for shard in shards}
    tally = _Tally(shards, report)
    tries: Counter[str] = Counter()
    failures: list[Failure] = []
    tally.tell()
    while named:
        tasks = (task_of(plan, shard, store.folder) for shard in list(named.values()))
        for result in executor.run(tasks, tally.tell):
            if result.outcome == "store":
                raise StoreError(result.message)
            if result.outcome == "done":
                tally.done(named.pop(result.task))
            elif result.outcome != "busy":
                tries[result.task] += 1
                tally.failed += 1
                if tries[result.task] == attempts:
                    del named[result.task]
                    failures.append(Failure(result.task, attempts, result.message))
                    store.keep_failure(failures[-1])
            tally.tell()
        if named:
            time.sleep(_PATIENCE)
    return failures


class _Tally:
    """Counts what is done, and reports it."""

    def __init__(self, shards: Sequence[Shard], report: SweepReport) -> None:
        self._report = report
        self._all = len(shards), sum(s.simulations for s in shards), sum(s.seconds for s in shards)
        self._shards = self._simulations = self.failed = 0
        self._seconds = 0.0
        self._under_way: tuple[int, float] = 0, 0.0

    def done(self, shard: Shard) -> None:
        self._shards += 1
        self._simulations += shard.simulations
        self._seconds += shard.seconds
        simulations, seconds = self._under_way
        self._under_way = max(0, simulations - shard.simulations), max(0.0, seconds - shard.seconds)

    def tell(self, simulations: int = 0, seconds: float = 0.0) -> None:
        self._under_way = self._under_way[0] + simulations, self._under_way[1] + seconds
        all_shards, all_simulations, all_seconds = self._all
        self._report(
            SweepProgress(
                shards=self._shards,
                all_shards=all_shards,
                # Tries that failed were counted as under way, too.
                simulations=min(all_simulations, self._simulations + self._under_way[0]),
                all_simulations=all_simulations,
                seconds=min(all_seconds, self._seconds + self._under_way[1]),
                all_seconds=all_seconds,
                failed=self.failed,
            )
        )


def parse_part(text: str, shard_count: int) -> tuple[int, int]:
    """Which shards a task of a job array does, from what it was told.

    Parameters
    ----------
    text
        ``I``, the number of one shard, or ``I/K``, every K-th from number I on.
    shard_count
        Number of shards.

    Returns
    -------
    part, parts
        As for `run_part`.

    Raises
    ------
    InputError
        If it is anything else, or there is no such shard.

    Examples
    --------
    >>> parse_part("3", 100), parse_part("3/10", 100)
    ((3, 100), (3, 10))
    """
    first, slash, step = text.partition("/")
    parts = shard_count if not slash else int(step) if step.isdecimal() else 0
    if not first.isdecimal() or parts < 1 or int(first) >= parts:
        raise InputError(
            f"shard: expected a number from 0 to {shard_count - 1}, or I/K, found {text!r}"
        )
    return int(first), parts


def run_part(
    plan: Plan, store: Store, part: int, parts: int, report: SweepReport = no_sweep_report
) -> Iterator[TaskResult]:
    """Do every `parts`-th shard from number `part` on, here and now; for a task of a job array.

    Shards are done one by one as the results are taken; a failure is kept at once.

    Parameters
    ----------
    plan
        What is wanted.
    store
        Where results are kept.
    part, parts
        Which shards; with as many parts as there are shards it is just one.
    report
        Told of the progress.
    """
    store.prepare()
    left = _repaired(plan, store, plan.shards[part::parts]).left
    tally = _Tally(left, report)
    tally.tell()
    for shard in left:
        result = task_of(plan, shard, store.folder).run(tally.tell)
        tally.done(shard)
        if result.outcome == "failed":
            store.keep_failure(Failure(result.task, 1, result.message))
        yield result
