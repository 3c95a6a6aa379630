"""The command that sweeps parameters: sweep."""

import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pourcast.cli.app import app
from pourcast.cli.interruption import end_in_own_time, said_if_interrupted
from pourcast.cli.options import (
    ClusterOption,
    ExecutorName,
    ExecutorOption,
    JsonOption,
    SchedulerOption,
    StudyArgument,
)
from pourcast.cli.terminal import (
    InterruptedWorkError,
    print_json,
    print_table,
    progress_bar,
    told_on_stderr,
)
from pourcast.errors import InputError
from pourcast.progress import duration_in_words

if TYPE_CHECKING:
    from pourcast.sweep.plan import Plan
    from pourcast.sweep.run import SweepProgress, SweepReport, SweepResult
    from pourcast.sweep.status import Status
    from pourcast.sweep.store import Store

_FAILURES_SHOWN = 10
"""Failures that are told at the end; `--status` tells all."""


@app.command()
def sweep(
    study: StudyArgument,
    grid: Annotated[
        str | None,
        typer.Option(
            "--grid",
            "-g",
            metavar="FILE or NAME",
            help="What to sweep: a TOML file, an experiment's name, or quick.",
        ),
    ] = None,
    executor: ExecutorOption = ExecutorName.LOCAL,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Shards at a time [all cores; 16 on a cluster].")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say how much it is, and how long it takes.")
    ] = False,
    status: Annotated[
        bool, typer.Option("--status", help="Only say how far it is; all grids without --grid.")
    ] = False,
    trajectories: Annotated[
        bool, typer.Option("--trajectories", help="Keep all particles' paths too (Zarr).")
    ] = False,
    attempts: Annotated[
        int, typer.Option(min=1, help="How often a shard is tried before it is given up.")
    ] = 3,
    scheduler: SchedulerOption = None,
    cluster: ClusterOption = None,
    print_script: Annotated[
        bool, typer.Option("--print-script", help="slurm: print a script for sbatch instead.")
    ] = False,
    shard: Annotated[
        str | None,
        typer.Option(metavar="I or I/K", help="Do only shard I, or every K-th from I; no table."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run a grid of models and parameters over a study's scenes; resumes where it stopped.

    Every finished piece is kept: the same command goes on after a crash or Ctrl-C, and a
    larger grid runs only what is new. Ends with STUDY/judgments/GRID.parquet.

    Example: pourcast sweep my-study --grid quick --workers 2
    """
    from pourcast.study.folder import study_liquids, study_scenes
    from pourcast.sweep.grid import read_grid
    from pourcast.sweep.plan import make_plan
    from pourcast.sweep.status import all_statuses, status_of
    from pourcast.sweep.store import Store

    scenes, store = study_scenes(study), Store(study / "sweep")
    if grid is None:
        if not status:
            raise InputError("grid: expected --grid FILE or NAME (or --status)")
        _print_statuses(all_statuses(store, scenes, study_liquids(study)), as_json=as_json)
        return
    asked = read_grid(grid, study_liquids(study))
    plan = make_plan(asked.with_trajectories() if trajectories else asked, scenes)
    if status:
        _print_statuses([status_of(plan, store)], as_json=as_json)
    elif dry_run:
        _print_estimate(plan, store, workers, as_json=as_json)
    elif shard is not None:
        _run_part(plan, store, shard)
    elif print_script:
        arguments = [str(study.absolute()), "--grid", _absolute(grid)]
        arguments += ["--trajectories"] if trajectories else []
        _print_script(plan, arguments, workers, cluster)
    else:
        kind = executor.value
        result = _run(plan, store, kind, workers, scheduler, cluster, attempts)
        _print_result(plan, store, result, study, as_json=as_json)


def _absolute(grid: str) -> str:
    from pourcast.sweep.grid import grid_names

    return grid if grid in grid_names() else str(Path(grid).absolute())


def _run(
    plan: "Plan",
    store: "Store",
    kind: str,
    workers: int | None,
    scheduler: str | None,
    cluster: Path | None,
    attempts: int,
) -> "SweepResult":
    from pourcast.sweep.executors.choose import ClusterOptions, make_executor, read_cluster
    from pourcast.sweep.run import run_sweep
    from pourcast.sweep.survey import survey

    options = read_cluster(cluster) if cluster else ClusterOptions()
    if kind != ExecutorName.LOCAL:
        end_in_own_time()
    # A job that is cancelled or preempted ends like one that is interrupted by hand.
    signal.signal(signal.SIGTERM, signal.getsignal(signal.SIGINT))
    opened = partial(make_executor, kind, workers, store.folder, scheduler, options)
    rest = "the same command goes on from there"
    try:
        with said_if_interrupted(f"interrupted; {rest}"), _sweep_bar() as report:
            return run_sweep(plan, store, opened, attempts=attempts, report=report)
    except KeyboardInterrupt:
        left = len(survey(plan, store).left)
        done = len(plan.shards) - left
        raise InterruptedWorkError(
            f"interrupted: {done} of {len(plan.shards)} shards are done; {rest}"
        ) from None


@contextmanager
def _sweep_bar() -> Iterator["SweepReport"]:
    """Progress of a sweep; the time left goes by the work in it, as simulations are unlike."""
    begin = time.monotonic()
    with told_on_stderr() as tell:

        def report(now: "SweepProgress") -> None:
            rate = now.simulations / max(1e-9, time.monotonic() - begin)
            words = (
                f"{now.shards} of {now.all_shards} shards, {now.simulations} of "
                f"{now.all_simulations} simulations, {rate:.0f}/s"
            )
            words += f", {now.failed} failed tries" if now.failed else ""
            tell(words, now.seconds, now.all_seconds)

        yield report


def _print_result(
    plan: "Plan", store: "Store", result: "SweepResult", study: Path, *, as_json: bool
) -> None:
    from pourcast.sweep.table import write_judgments

    missing = int(result.table["judgment"].isna().sum())
    path = write_judgments(study / "judgments", plan.grid.name, result.table)
    if as_json:
        facts = {name: value for name, value in vars(result).items() if name != "table"}
        facts["failures"] = [asdict(failure) for failure in result.failures]
        facts["damaged"] = [str(damage) for damage in result.damaged]
        print_json(facts | {"file": str(path), "judgments": len(result.table), "missing": missing})
    else:
        for damage in result.damaged:
            typer.echo(f"{damage}; removed, and done again")
        typer.echo(
            f"reused {result.reused_simulations} of {plan.simulations} simulations "
            f"({result.reused_shards} shards); ran {result.done_simulations} "
            f"({result.done_shards} shards)"
        )
        typer.echo(f"{path}: {len(result.table) - missing} judgments")
        if plan.trajectories:
            typer.echo(f"{store.trajectories}: the particles' paths")
    for failure in result.failures[:_FAILURES_SHOWN]:
        typer.echo(
            f"shard {failure.shard} failed {failure.attempts} times: {failure.message}", err=True
        )
    if result.failures or missing:
        typer.echo(
            f"pourcast: {len(result.failures)} shards failed, {missing} judgments are missing; "
            "the same command tries them again",
            err=True,
        )
        raise typer.Exit(1)


def _print_statuses(statuses: "list[Status]", *, as_json: bool) -> None:
    if as_json:
        found = []
        for one in statuses:
            facts = asdict(one)
            facts["damaged"] = [str(damage) for damage in one.damaged]
            found.append(facts)
        print_json(found)
        return
    if not statuses:
        typer.echo("nothing was swept here yet")
    for one in statuses:
        typer.echo(
            f"{one.grid}: {one.done_shards} of {one.shards} shards done, "
            f"{one.done_simulations} of {one.simulations} simulations; {one.running} at work; "
            f"last finished: {one.last_written or 'none'}"
        )
        for failure in one.failures:
            typer.echo(
                f"  shard {failure.shard} failed {failure.attempts} times: {failure.message}"
            )
        for damage in one.damaged:
            typer.echo(f"  {damage}; the next run does it again")


def _print_estimate(plan: "Plan", store: "Store", workers: int | None, *, as_json: bool) -> None:
    from rich.filesize import decimal

    from pourcast.sweep.estimate import estimate_rest

    with progress_bar() as report:
        rest = estimate_rest(plan, store, workers, report=report)
    if as_json:
        facts = {"grid": plan.grid.name, "simulations": plan.simulations, "shards": rest.shards}
        facts |= {"to_do": rest.simulations, "workers": rest.workers}
        facts |= {"minutes": rest.minutes, "bytes": rest.bytes}
        print_json(facts | {"parts": rest.parts.reset_index().to_dict(orient="records")})
        return
    if len(rest.parts):
        print_table(rest.parts)
    typer.echo(
        f"\n{plan.grid.name} on {len(plan.listed)} scenes: {plan.simulations} simulations, of "
        f"which {plan.simulations - rest.simulations} are done; {rest.simulations} to do, "
        f"in {rest.shards} shards"
    )
    typer.echo(
        f"about {duration_in_words(60 * rest.minutes)} with {rest.workers} workers like this "
        f"machine's cores (measured on {rest.parts['run'].sum()} simulations); about "
        f"{decimal(rest.bytes)} on disk"
    )


def _run_part(plan: "Plan", store: "Store", shard: str) -> None:
    from pourcast.sweep.run import parse_part, run_part

    bad, part = False, parse_part(shard, len(plan.shards))
    with _sweep_bar() as report:
        for result in run_part(plan, store, *part, report):
            bad |= result.outcome not in ("done", "busy")
            typer.echo(f"shard {result.task}: {result.outcome} {result.message}".rstrip(), err=True)
    if bad:
        raise typer.Exit(1)


def _print_script(
    plan: "Plan", arguments: list[str], workers: int | None, cluster: Path | None
) -> None:
    from pourcast.sweep.executors.choose import CLUSTER_WORKERS, ClusterOptions, read_cluster
    from pourcast.sweep.executors.slurm import sbatch_script

    options = read_cluster(cluster) if cluster else ClusterOptions()
    sys.stdout.write(
        sbatch_script(
            ["sweep", *arguments], plan.grid.name, len(plan.shards),
            workers or CLUSTER_WORKERS, options.slurm,
        )
    )  # fmt: skip
