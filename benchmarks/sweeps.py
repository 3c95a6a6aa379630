"""What the sweep costs beside the engine, how it scales, and whether a cluster is kept busy.

    python -m benchmarks.sweeps

Needs the extra `cluster`; about seven minutes on two cores.
"""

import logging
import os
import tempfile
import time
from pathlib import Path

from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.scenes.scene import Scene
from pourcast.simulation.run import simulate
from pourcast.study.selection import drawn_scene
from pourcast.sweep.executors.dask import DaskExecutor
from pourcast.sweep.executors.local import LocalExecutor
from pourcast.sweep.grid import parse_grid
from pourcast.sweep.plan import Plan, make_plan
from pourcast.sweep.run import run_sweep
from pourcast.sweep.shard import ShardTask, task_of
from pourcast.sweep.store import Store
from pourcast.sweep.task import TaskResult

GRID = """
[[models]]
model = "ife"
parameters.liquid = ["water", "honey"]
parameters.damping_zeta = { from = 0, to = 20, step = 1 }
parameters.zeta_sigma = 0
"""
"""The paper's two liquids at its N = 50: 42 settings; on 120 scenes 5,040 simulations."""

SCENES = 120
DASK_WORKERS = 64
SLEEP = 2.0
SLEEPS_PER_WORKER = 10


def scenes(count: int) -> list[Scene]:
    draws = (drawn_scene(VoronoiFamily(), 7, k) for k in range(2 * count))
    return [scene for scene in draws if scene is not None][:count]


def engine_seconds(plan: Plan) -> float:
    """Time of all simulations in one call, on one core, kinds one after another as in a sweep."""
    pours = [
        pour
        for setting in plan.settings
        for scene in plan.scenes
        for pour in setting.pours_in(scene)
    ]
    simulate(pours[:1] + pours[-1:], threads=1)  # For the compiler.
    start = time.perf_counter()
    simulate(pours, threads=1)
    return time.perf_counter() - start


def sweep_seconds(plan: Plan, workers: int) -> float:
    """Time of a sweep, from the start of its processes to the table."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        run_sweep(plan, Store(Path(folder)), lambda: LocalExecutor(workers))
        return time.perf_counter() - start


def sleep_through(task: ShardTask) -> TaskResult:
    """What a worker does instead of a shard: sleep, and leave a file that says when."""
    begin = time.time()
    time.sleep(SLEEP)
    name = task.store / f"{task.shard.id}-{os.getpid()}"
    name.write_text(f"{begin} {time.time()}")
    return TaskResult(task.shard.id, "done")


def busy_share(plan: Plan, workers: int) -> float:
    """Share of their time that Dask workers spend in shards, from the first begin to the end."""
    # Not above: the workers of the other figures import this file.
    import distributed

    with tempfile.TemporaryDirectory() as folder:
        cluster = distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None,
            silence_logs="CRITICAL",
        )  # fmt: skip
        executor = DaskExecutor(distributed.Client(cluster), sleep_through, cluster.close)
        shards = plan.shards[: SLEEPS_PER_WORKER * workers]
        tasks = (task_of(plan, shard, Path(folder)) for shard in shards)
        results = list(executor.run(tasks, lambda *_: None))
        executor.close()
        assert len(results) == len(shards)
        times = [tuple(map(float, p.read_text().split())) for p in Path(folder).iterdir()]
        slept = sum(end - begin for begin, end in times)
        whole = max(end for _, end in times) - min(begin for begin, _ in times)
        return slept / (workers * whole)


def main() -> None:
    """Print the three figures."""
    logging.disable(logging.CRITICAL)  # Dask's workers tell at length how they end.
    plan = make_plan(parse_grid(GRID, "benchmark", "benchmark"), scenes(SCENES))
    print(f"{plan.simulations} simulations, {len(plan.shards)} shards")
    engine = engine_seconds(plan)
    one, two = sweep_seconds(plan, 1), sweep_seconds(plan, 2)
    print(f"engine alone {engine:.1f} s; sweep with one worker {one:.1f} s, two {two:.1f} s")
    print(f"overhead of the sweep: {100 * (one / engine - 1):.1f} % of the engine's time")
    print(f"two workers / one: {one / two:.2f}")
    many = make_plan(parse_grid(f"shard_seconds = 0.001\n{GRID}", "many", "many"), scenes(20))
    share = busy_share(many, DASK_WORKERS)
    print(f"{DASK_WORKERS} Dask workers, shards of {SLEEP:g} s: busy {100 * share:.0f} %")


if __name__ == "__main__":
    main()
