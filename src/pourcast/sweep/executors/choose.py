"""From what the user said to an executor."""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pourcast.cores import available_cores
from pourcast.errors import InputError, unknown
from pourcast.sweep.executors import Executor, dask
from pourcast.sweep.executors.local import LocalExecutor
from pourcast.sweep.executors.slurm import SlurmExecutor

CLUSTER_WORKERS = 16
"""Tasks of a cluster at a time, unless it is said."""

_SECTIONS = ("dask", "slurm")


@dataclass(frozen=True)
class ClusterOptions:
    """What a lab must say about its cluster; the content of a cluster file.

    Parameters
    ----------
    source
        Name of the file, for error messages.
    dask
        Arguments of `dask_jobqueue.SLURMCluster`.
    slurm
        Parameters of `submitit.SlurmExecutor`.
    """

    source: str = "--cluster"
    dask: dict[str, Any] = field(default_factory=dict)
    slurm: dict[str, Any] = field(default_factory=dict)


def read_cluster(path: Path) -> ClusterOptions:
    """Read a cluster file: TOML with the tables `[slurm]` and `[dask]`.

    Raises
    ------
    InputError
        If it can't be read, or holds anything else.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a TOML file ({error})") from None
    for name, section in content.items():
        if name not in _SECTIONS:
            raise InputError(f"{path}: {unknown(name, _SECTIONS)}")
        if not isinstance(section, dict):
            raise InputError(f"{path}: {name}: expected a table [{name}]")
    return ClusterOptions(str(path), **content)


def make_executor(
    kind: str, workers: int | None, folder: Path, scheduler: str | None, cluster: ClusterOptions
) -> Executor:
    """Executor of a name.

    Parameters
    ----------
    kind
        ``local``, ``dask`` or ``slurm``.
    workers
        Shards at a time; all cores, or `CLUSTER_WORKERS`, by default.
    folder
        Folder of the store.
    scheduler
        Address of a Dask scheduler that runs already.
    cluster
        What is to be known about the cluster.

    Raises
    ------
    InputError
        If something is missing, not installed, or doesn't answer.
    """
    if kind == "dask":
        if scheduler is not None:
            return dask.connect(scheduler)
        if not cluster.dask:
            raise InputError(
                "executor dask: expected --scheduler ADDRESS, or --cluster FILE with a table [dask]"
            )
        return dask.start_on_slurm(cluster.dask, workers or CLUSTER_WORKERS, cluster.source)
    if kind == "slurm":
        jobs = folder / "slurm"
        return SlurmExecutor(jobs, workers or CLUSTER_WORKERS, cluster.slurm, cluster.source)
    return LocalExecutor(workers or available_cores())
