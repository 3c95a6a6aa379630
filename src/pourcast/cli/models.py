"""Commands that let models judge, list them and time them: demo, predict, models, bench."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from pourcast.cli.app import app
from pourcast.cli.options import (
    JsonOption,
    LiquidOption,
    ModelOption,
    ScenesArgument,
    SeedOption,
)
from pourcast.cli.terminal import (
    print_columns,
    print_json,
    print_rows,
    print_table,
    progress_bar,
    records,
)


class Plan(StrEnum):
    """Grids of simulations whose time can be told."""

    PAPER = "paper"


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path("demo"),
    as_json: JsonOption = False,
) -> None:
    """Watch a pour, and read what every model says about it; takes some seconds.

    Example: pourcast demo -o demo
    """
    from pourcast.pictures.demo import run_demo

    with progress_bar() as report:
        result = run_demo(out, report)
    if as_json:
        files = {str(path): meaning for path, meaning in result.files.items()}
        print_json({"judgments": result.table.to_dict(), "files": files})
        return
    print_table(result.table)
    typer.echo(f"\nJudgments: {'; '.join(f'{k}: {share}' for k, share in result.shares.items())}.")
    for path, meaning in result.files.items():
        typer.echo(f"{path}  {meaning}")


@app.command()
def predict(
    scenes: ScenesArgument,
    model: ModelOption = None,
    liquid: LiquidOption = "water",
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Table to write (.csv or .parquet).")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Let models judge scenes: one row per scene and model, every judgment in 0..1.

    Example: pourcast predict scenes.json -m water-ife -m gravity -m truth-water -o judgments.csv
    """
    from pourcast.files import check_writable
    from pourcast.models.registry import make_model
    from pourcast.prediction import by_model, judge_scenes, summary_columns, table_of
    from pourcast.study.folder import load_scenes, study_liquids

    loaded, own = load_scenes(scenes), study_liquids(scenes)
    if out is not None:
        from pourcast.tables import check_table_path, write_table  # loads pandas

        check_table_path(out)
        check_writable(out)
    with progress_bar() as report:
        said = judge_scenes(loaded, model or ["water-ife"], liquid, seed, own=own, report=report)
    if out is not None:
        write_table(out, table_of(said))
    if as_json:
        print_json([judgment._asdict() for judgment in said])
        return
    if len(loaded) <= 10:
        print_columns({"scene": [scene.id for scene in loaded], **by_model(said)})
        typer.echo()
    print_columns(summary_columns(by_model(said)))
    for spec in dict.fromkeys(model or ()):
        if remark := make_model(spec, own).remark:
            typer.echo(f"note: {spec}: {remark}")
    if out is not None:
        typer.echo(f"\n{out}: {len(said)} judgments")


@app.command()
def bench(
    n_particles: Annotated[
        list[int] | None, typer.Option("-N", min=1, max=300, help="Number of particles; several.")
    ] = None,
    latency: Annotated[
        bool, typer.Option("--latency", help="Instead: how long one pour takes, start to answer.")
    ] = False,
    plan: Annotated[
        Plan | None, typer.Option(help="Instead: how long a grid of simulations takes here.")
    ] = None,
    share: Annotated[
        float, typer.Option(min=0.001, max=1.0, help="Share of the plan that is run for it.")
    ] = 0.05,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Measure how fast this machine simulates: batches, in under a minute; one pour; or a grid.

    Example: pourcast bench --latency
    """
    from pourcast.errors import InputError
    from pourcast.sweep.bench import COUNTS, plan_table, speed_table
    from pourcast.sweep.latency import latency_table
    from pourcast.sweep.machine import describe_machine

    if plan is not None and (latency or n_particles):
        other = "--latency" if latency else "-N"
        raise InputError(f"bench: expected --plan or {other}, found both")
    machine = describe_machine()
    with progress_bar() as report:
        if plan is not None:
            table = plan_table(share, seed, report)
        elif latency:
            table = latency_table(n_particles or COUNTS, report)
        else:
            table = speed_table(n_particles or COUNTS, report)
    if as_json:
        print_json({"machine": machine, "table": records(table.reset_index())})
        return
    typer.echo(", ".join(f"{what}: {value}" for what, value in machine.items()) + "\n")
    print_table(table.reset_index().set_index(table.index.names[0]))
    if plan is not None:
        typer.echo(
            f"\n{table['simulations'].sum()} simulations: {table['minutes'].sum():.0f} minutes "
            f"on this machine (measured on {table['run'].sum()} of them)"
        )
    elif latency:
        typer.echo("\nOn all cores; without what the first run of a process loads or compiles.")
    else:
        typer.echo("\nSimulations of 4 s per second, contacts included.")


@app.command(name="list")
def list_(as_json: JsonOption = False) -> None:
    """List what commands know by name: experiments, goals, liquids (`models` lists models).

    Example: pourcast list
    """
    from pourcast.scenes.goals.registry import GOALS
    from pourcast.scenes.liquids.registry import LIQUIDS, known_liquids
    from pourcast.study.experiments.registry import EXPERIMENTS

    experiments, broken_experiments = EXPERIMENTS.all()
    goals, broken_goals = GOALS.all()
    _, broken_liquids = LIQUIDS.all()
    tables: dict[str, list[dict[str, Any]]] = {
        "experiments": [
            {
                "experiment": one.name, "scenes": one.scene_count, "goal": one.goal,
                "liquids": " | ".join(", ".join(group) for group in one.groups),
                "participants": one.participants, "what it is": one.title,
            }
            for one in experiments.values()
        ],
        "goals": [
            {"goal": name, "judgment": goal.share} for name, goal in goals.items()
        ],
        "liquids": [
            {
                "liquid": one.name, "called": one.called, "alpha": f"{one.viscosity_alpha:g}",
                "cohesion [m3/s2]": f"{one.cohesion:g}",
                "adhesion [1/s]": f"{one.adhesion_normal:g}, {one.adhesion_tangential:g}",
                "viscosity [m2/s]": f"{one.kinematic_viscosity:g}", "colour": one.colour,
            }
            for one in known_liquids()
        ],
    }  # fmt: skip
    if as_json:
        print_json(tables)
        return
    for rows in tables.values():
        print_rows(rows)
        typer.echo()
    for problem in (broken_experiments | broken_goals | broken_liquids).values():
        typer.echo(f"note: {problem}")


@app.command()
def models(as_json: JsonOption = False) -> None:
    """List the models, their parameters and ranges.

    Example: pourcast models
    """
    from pourcast.models.registry import MODELS, parameter_table, presets

    if as_json:
        listed = {name: parameter_table(name) for name in MODELS.all()[0]}
        print_json({"presets": presets(), "models": listed})
        return
    print_rows(
        [
            {"preset": name, "model": entry["model"], "what it is": entry["source"]}
            for name, entry in presets().items()
        ]
    )
    families, broken = MODELS.all()
    for name in families:
        typer.echo(f"\n{name}")
        if rows_of := parameter_table(name):
            print_rows(rows_of)
    for problem in broken.values():
        typer.echo(f"\nnote: {problem}")
