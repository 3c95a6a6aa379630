"""SLURM: job arrays through submitit, or a plain script for `sbatch`."""

import contextlib
import io
import secrets
import shlex
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pourcast.errors import InputError
from pourcast.extras import optional_module
from pourcast.sweep.executors import Heartbeat
from pourcast.sweep.task import Task, TaskResult, run_task

LONGEST_ARRAY = 1000
"""Tasks of an array: SLURM's own default limit is 1001."""

DEFAULTS: dict[str, Any] = {"time": 60, "mem": "2G", "cpus_per_task": 1}
"""Minutes, memory and cores of a task, unless the file says other."""

_LOST_AFTER = 20.0
"""A task that the queue doesn't know and that left no result is given up after this [s]."""

_ASK_EVERY = 5.0


class SlurmExecutor:
    """Job arrays, through submitit.

    Parameters
    ----------
    folder
        Folder for submitit's files and logs; on a file system that all nodes share.
    workers
        Tasks at a time.
    options
        Parameters of `submitit.SlurmExecutor`: `partition`, `account`, `time` [min], `mem`,
        `setup` (lines of shell), `additional_parameters` ...
    source
        Name of the file of the options, for error messages.
    """

    def __init__(self, folder: Path, workers: int, options: Mapping[str, Any], source: str) -> None:
        # A name of its own, by which its jobs can be cancelled whenever it is interrupted.
        self._name = f"{options.get('job_name', 'pourcast')}-{secrets.token_hex(4)}"
        submitit = optional_module("submitit", "cluster")
        self._submission_error = optional_module("submitit.core.utils", "cluster").FailedJobError
        try:
            self._submitit = submitit.SlurmExecutor(folder.absolute())
            self._submitit.update_parameters(
                **{**DEFAULTS, **options, "job_name": self._name, "array_parallelism": workers}
            )
        except RuntimeError as error:
            raise InputError(f"executor slurm: {error}") from None
        except (TypeError, ValueError) as error:
            raise InputError(f"{source}: slurm: {' '.join(str(error).split())}") from None

    def run(self, tasks: Iterable[Task], heartbeat: Heartbeat) -> Iterator[TaskResult]:
        """Do tasks; see `Executor`. Many of ours share the tasks of one array."""
        ours = list(tasks)
        parts = [ours[k::LONGEST_ARRAY] for k in range(min(LONGEST_ARRAY, len(ours)))]
        if not parts:
            return
        waiting = dict(zip(self._submit(parts), parts, strict=True))
        missing_since: dict[Any, float] = {}
        asked = 0.0
        while waiting:
            heartbeat(0, 0.0)
            time.sleep(0.5)
            for job in [job for job in waiting if job.paths.result_pickle.exists()]:
                yield from _results(job, waiting.pop(job))
            if not waiting or time.monotonic() - asked < _ASK_EVERY:
                continue
            asked = time.monotonic()
            known = _known_tasks({job.job_id.partition("_")[0] for job in waiting})
            if known is None:
                continue
            for job in list(waiting):
                if job.job_id in known:
                    missing_since.pop(job, None)
                elif asked - missing_since.setdefault(job, asked) > _LOST_AFTER:
                    yield from _lost(job, waiting.pop(job))

    def _submit(self, parts: list[list[Task]]) -> list[Any]:
        try:
            # What sbatch says is in the error as well.
            with contextlib.redirect_stderr(io.StringIO()):
                return list(self._submitit.map_array(run_tasks, parts))
        except self._submission_error as error:
            raise InputError(_last_line(str(error))) from None

    def close(self) -> None:
        """Cancel what is still in the queue."""
        subprocess.run(["scancel", f"--name={self._name}"], check=False, capture_output=True)


def run_tasks(tasks: list[Task]) -> list[TaskResult]:
    """Do some of our tasks, one after the other; what a task of the array does."""
    return [run_task(task) for task in tasks]


def _results(job: Any, tasks: list[Task]) -> list[TaskResult]:
    error = job.exception()
    if error is None:
        results: list[TaskResult] = job.result()
        job.paths.submitted_pickle.unlink(missing_ok=True)
        job.paths.result_pickle.unlink(missing_ok=True)
        return results
    return _lost(job, tasks, _last_line(str(error)))


def _lost(job: Any, tasks: list[Task], reason: str = "") -> list[TaskResult]:
    reason = reason or f"killed, or out of time or memory; see {job.paths.stderr}"
    message = f"SLURM task {job.job_id} ended without a result ({reason})"
    return [TaskResult(task.id, "lost", message) for task in tasks]


def _last_line(text: str) -> str:
    lines = [line.strip(" -") for line in text.splitlines() if line.strip(" -")]
    return lines[-1] if lines else "no reason given"


def _known_tasks(arrays: set[str]) -> set[str] | None:
    """Tasks of some arrays that are in the queue; None if the queue can't be asked now."""
    command = ["squeue", "--noheader", "--array", "--format=%F_%K", f"--jobs={','.join(arrays)}"]
    command += ["--states=PENDING,RUNNING,SUSPENDED,COMPLETING,CONFIGURING,REQUEUED,PREEMPTED"]
    answer = subprocess.run(command, check=False, capture_output=True, text=True)
    if answer.returncode != 0 and "Invalid job id" not in answer.stderr:
        return None
    lines = set(answer.stdout.split())
    return lines | {line.partition("_")[0] for line in lines if line.endswith("_N/A")}


# A plain script ----------------------------------------------------------------------

_NOT_FLAGS = ("setup", "additional_parameters", "array_parallelism", "job_name")


def sbatch_script(
    command: list[str], name: str, shard_count: int, workers: int, options: Mapping[str, Any]
) -> str:
    """Script for `sbatch` whose tasks each do their shards; needs nothing but pourcast.

    Parameters
    ----------
    command
        The `pourcast sweep` command, without ``--shard``.
    name
        Name of the job.
    shard_count
        Number of shards.
    workers
        Tasks at a time.
    options
        As for `SlurmExecutor`.
    """
    tasks = min(shard_count, LONGEST_ARRAY)
    settings = {**DEFAULTS, **options}
    flags = {
        "job-name": settings.get("job_name", f"pourcast-{name}"),
        "array": f"0-{tasks - 1}%{workers}",
        "requeue": True,
        **{key.replace("_", "-"): v for key, v in settings.items() if key not in _NOT_FLAGS},
        **settings.get("additional_parameters", {}),
    }
    lines = [f"#SBATCH --{k}" if v is True else f"#SBATCH --{k}={v}" for k, v in flags.items()]
    shard = '"$SLURM_ARRAY_TASK_ID"' if tasks == shard_count else f'"$SLURM_ARRAY_TASK_ID/{tasks}"'
    return "\n".join(
        [
            "#!/bin/bash",
            *lines,
            f"# {shard_count} shards. When all tasks are done, the same command without --shard",
            "# gathers the table (and does what is still missing).",
            *settings.get("setup", []),
            f"exec {shlex.join([sys.executable, '-m', 'pourcast', *command])} --shard {shard}",
            "",
        ]
    )
