"""A Dask cluster: a scheduler that runs already, or one that dask-jobqueue starts on SLURM."""

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from typing import Any

from pourcast.errors import ClusterError, InputError
from pourcast.extras import optional_module
from pourcast.sweep.executors import Heartbeat, run_futures
from pourcast.sweep.task import Task, TaskResult, run_task

_WAITING = 2
"""Tasks on their way for each one that is being done."""

_CONNECT_SECONDS = 15

_DEFAULTS: dict[str, Any] = {
    "cores": 1,
    "memory": "2GB",
    # Any free port for its dashboard: there may be another cluster on this machine.
    "scheduler_options": {"dashboard_address": ":0"},
}
"""Arguments of `dask_jobqueue.SLURMCluster`, unless the file says other."""


class DaskExecutor:
    """Workers of a `dask.distributed` cluster; they must see the study's folder.

    Parameters
    ----------
    client
        A connected `distributed.Client`.
    work
        What a worker does with a task.
    on_close
        Ends what was started for the client.
    """

    def __init__(
        self,
        client: Any,
        work: Callable[[Task], TaskResult] = run_task,
        on_close: Callable[[], None] | None = None,
    ) -> None:
        self._client = client
        self._work = work
        self._on_close = on_close
        # A task whose worker died is given to another; the one that was at it may be to blame.
        self._pool = client.get_executor(pure=False, retries=0)

    @property
    def workers(self) -> int:
        """Tasks that are done at a time: threads of all workers that are there now."""
        return max(1, sum(int(n) for n in self._client.nthreads().values()))

    def run(self, tasks: Iterable[Task], heartbeat: Heartbeat) -> Iterator[TaskResult]:
        """Do tasks; see `Executor`."""

        def submit(task: Task) -> Future[TaskResult]:
            future: Future[TaskResult] = self._pool.submit(self._work, task)
            return future

        room = _Often(lambda: _WAITING * self.workers)
        for result in run_futures(submit, tasks, room, lambda: heartbeat(0, 0.0)):
            if self._client.status != "running":
                raise ClusterError(
                    f"the Dask scheduler is gone ({result.message or 'no answer'}); what was "
                    "finished is kept, the same command goes on from there"
                )
            yield result

    def close(self) -> None:
        """Give up what is on its way, and disconnect."""
        if self._client.status == "running":
            self._pool.shutdown(wait=False)
        self._client.close()
        if self._on_close is not None:
            self._on_close()


class _Often:
    """A number that is costly to ask for, asked for every hundredth time."""

    def __init__(self, ask: Callable[[], int]) -> None:
        self._ask, self._calls, self._value = ask, 0, 0

    def __call__(self) -> int:
        if self._calls % 100 == 0:
            self._value = self._ask()
        self._calls += 1
        return self._value


def connect(scheduler: str) -> DaskExecutor:
    """Executor of a scheduler that runs already.

    Parameters
    ----------
    scheduler
        Its address, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        If there is none.
    """
    distributed = optional_module("distributed", "cluster")
    try:
        client = distributed.Client(scheduler, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"scheduler {scheduler}: no answer ({error})") from None
    return DaskExecutor(client)


def start_on_slurm(options: Mapping[str, Any], workers: int, source: str) -> DaskExecutor:
    """Executor of a cluster that dask-jobqueue starts, each worker a SLURM job.

    Parameters
    ----------
    options
        Arguments of `dask_jobqueue.SLURMCluster`; by default 1 core and 2 GB a job.
    workers
        Number of jobs.
    source
        Name of the file of the options, for error messages.

    Raises
    ------
    InputError
        If an option is wrong.
    """
    if shutil.which("sbatch") is None:
        raise InputError("executor dask: there is no SLURM here (no `sbatch`)")
    distributed = optional_module("distributed", "cluster")
    jobqueue = optional_module("dask_jobqueue", "cluster")
    try:
        cluster = jobqueue.SLURMCluster(**{**_DEFAULTS, **options})
    except (TypeError, ValueError) as error:
        raise InputError(f"{source}: dask: {error}") from None
    _check_job(cluster.job_script(), source)
    cluster.scale(jobs=workers)
    client = distributed.Client(cluster, timeout=_CONNECT_SECONDS, set_as_default=False)
    return DaskExecutor(client, on_close=cluster.close)


def _check_job(script: str, source: str) -> None:
    """Refuse a job that SLURM would refuse; dask-jobqueue would wait for its worker for ever."""
    answer = subprocess.run(
        ["sbatch", "--test-only"], input=script, capture_output=True, text=True, check=False
    )
    if answer.returncode != 0:
        reason = " ".join(answer.stderr.split())
        raise InputError(f"{source}: dask: SLURM refuses a worker's job ({reason})")
