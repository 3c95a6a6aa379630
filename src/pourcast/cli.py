"""The command line: parse, call the library, print.

Exit codes: 0 done; 1 the work failed; 2 the input or the call is wrong.
Errors are one line on stderr.
"""

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from pourcast.errors import InputError

app = typer.Typer(
    name="pourcast",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="How do people think this liquid will flow? Start with: pourcast demo",
)


class Experiment(StrEnum):
    """The paper's two kinds of scene."""

    EXP1 = "exp1"
    EXP2 = "exp2"


class LiquidName(StrEnum):
    """Liquids that a trial can show."""

    WATER = "water"
    HONEY = "honey"
    HONEY_EXP1 = "honey-exp1"
    HONEY_EXP2 = "honey-exp2"


class ForeignFormat(StrEnum):
    """Formats of scenes made elsewhere."""

    SVG = "svg"
    PLINKO = "plinko"
    SPLISHSPLASH = "splishsplash"


class Plan(StrEnum):
    """Grids of simulations whose time can be told."""

    PAPER = "paper"


ScenesArgument = Annotated[
    Path, typer.Argument(metavar="SCENES", help="A scene file, or a study folder.")
]
ModelOption = Annotated[
    list[str] | None,
    typer.Option(
        "--model", "-m", metavar="NAME[:parameter=value,...]",
        help="A model; may be given several times. `pourcast models` lists them.",
    ),
]  # fmt: skip
LiquidOption = Annotated[LiquidName, typer.Option(help="Liquid shown in the trials.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Source of all randomness.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
CandidatesOption = Annotated[
    int, typer.Option(min=1, help="exp2: size of the pool that the scenes are chosen from.")
]


@contextmanager
def progress_bar() -> Iterator[Any]:
    """Progress bar on stderr, if that is a terminal; yields report(what, done, all)."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Remaining())
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("starting", total=None)

        def report(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total)

        yield report


def print_table(frame: Any, *, decimals: int = 2) -> None:
    """Print a small table with rich, its index first."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column(str(frame.index.name or ""))
    for name in frame.columns:
        numeric = frame[name].dtype.kind in "fiu"
        table.add_column(str(name), justify="right" if numeric else "left", overflow="fold")
    for label, *row in frame.itertuples(name=None):
        cells = [f"{v:.{decimals}f}" if isinstance(v, float) else str(v) for v in row]
        table.add_row(str(label), *("-" if cell == "nan" else cell for cell in cells))
    Console().print(table)


def print_json(content: Any) -> None:
    """Print JSON, numbers that are none as null."""
    import math

    def clean(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(k): clean(v) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [clean(v) for v in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    typer.echo(json.dumps(clean(content), indent=2))


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--output", "-o", help="Folder to write to.")] = Path("demo"),
    as_json: JsonOption = False,
) -> None:
    """Watch a pour, and read what every model says about it; takes under a minute.

    Example: pourcast demo -o demo
    """
    from pourcast.demo import run_demo

    with progress_bar() as report:
        result = run_demo(out, report)
    if as_json:
        files = {str(path): meaning for path, meaning in result.files.items()}
        print_json({"judgments": result.table.to_dict(), "files": files})
        return
    print_table(result.table)
    typer.echo("\nJudgments: share of the liquid in the right basin (exp1), in the cup (exp2).")
    for path, meaning in result.files.items():
        typer.echo(f"{path}  {meaning}")


@app.command()
def scenes(
    experiment: Annotated[Experiment, typer.Argument(help="exp1: basins; exp2: cup.")],
    out: Annotated[Path, typer.Option("--output", "-o", help="Scene file to write (.json).")],
    count: Annotated[
        int | None, typer.Option("-n", "--scenes", min=1, help="How many [120 or 60].")
    ] = None,
    seed: SeedOption = 0,
    candidates: CandidatesOption = 1000,
    as_json: JsonOption = False,
) -> None:
    """Generate scenes: drawn at random, filtered by simulation, for exp2 chosen for contrast.

    Example: pourcast scenes exp1 -n 120 --seed 1 -o scenes.json
    """
    from pourcast.files import check_writable
    from pourcast.scene import write_scenes
    from pourcast.study import DEFAULT_SCENES, SceneRequest, generate_scenes

    wanted = count or DEFAULT_SCENES[experiment.value]
    request = SceneRequest(experiment.value, wanted, seed, candidates)
    check_writable(out)
    with progress_bar() as report:
        selection = generate_scenes(request, report)
    write_scenes(out, selection.scenes)
    _print_selection(selection, out, as_json=as_json)


def _print_selection(selection: Any, path: Path, *, as_json: bool) -> None:
    facts = {
        "file": str(path),
        "scenes": len(selection.scenes),
        "drawn": selection.drawn,
        "kept": selection.kept,
        "acceptance": selection.kept / selection.drawn,
        "correlation": selection.correlation,
        "pool_correlation": selection.pool_correlation,
    }
    if as_json:
        print_json(facts)
        return
    typer.echo(
        f"{path}: {facts['scenes']} scenes; the filter kept {selection.kept} of {selection.drawn} "
        f"draws ({100 * selection.kept / selection.drawn:.0f} %)"
    )
    if selection.correlation is not None:
        typer.echo(
            f"correlation of water-ife and honey-ife-1: {selection.correlation:+.2f} over the "
            f"chosen scenes ({selection.pool_correlation:+.2f} over all candidates)"
        )


@app.command()
def new(
    experiment: Annotated[Experiment, typer.Argument(help="exp1: basins; exp2: cup.")],
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make.")],
    count: Annotated[
        int | None, typer.Option("-n", "--scenes", min=1, help="How many [120 or 60].")
    ] = None,
    seed: SeedOption = 0,
    candidates: CandidatesOption = 1000,
    as_json: JsonOption = False,
) -> None:
    """Make a study folder with freshly generated scenes.

    Example: pourcast new exp1 my-study --scenes 40
    """
    from pourcast.study import DEFAULT_SCENES, SceneRequest, new_study

    wanted = count or DEFAULT_SCENES[experiment.value]
    request = SceneRequest(experiment.value, wanted, seed, candidates)
    with progress_bar() as report:
        selection = new_study(folder, request, report)
    _print_selection(selection, folder / "scenes.json", as_json=as_json)


@app.command()
def predict(
    scenes: ScenesArgument,
    model: ModelOption = None,
    liquid: LiquidOption = LiquidName.WATER,
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
    from pourcast.judgments import check_table_path, summarise, write_table
    from pourcast.judgments import predict as predict_scenes
    from pourcast.study import load_scenes

    loaded = load_scenes(scenes)
    if out is not None:
        check_table_path(out)
        check_writable(out)
    with progress_bar() as report:
        table = predict_scenes(loaded, model or ["water-ife"], liquid.value, seed, report=report)
    if out is not None:
        write_table(out, table)
    if as_json:
        print_json(json.loads(table.to_json(orient="records")))
        return
    if len(loaded) <= 10:
        wide = table.pivot(index="scene", columns="model", values="judgment")
        print_table(wide[list(dict.fromkeys(table["model"]))])
        typer.echo()
    print_table(summarise(table))
    if out is not None:
        typer.echo(f"\n{out}: {len(table)} judgments")


@app.command()
def show(
    scenes: ScenesArgument,
    out: Annotated[Path, typer.Option("--output", "-o", help="A .png, .svg, .gif or .mp4 file.")],
    scene: Annotated[str, typer.Option(help="Which scene: a number from 1, or its id.")] = "1",
    model: ModelOption = None,
    liquid: LiquidOption = LiquidName.WATER,
    seed: SeedOption = 0,
) -> None:
    """Look at a scene, at a pour in six moments (.png, .svg) or as a film (.gif, .mp4).

    Several models stand side by side, each with its judgment.

    Example: pourcast show scenes.json --scene 3 -m water-ife -m honey-ife-1 -o pour.mp4
    """
    from pourcast.pictures import show as show_scene
    from pourcast.study import load_scenes, pick_scene

    chosen = pick_scene(load_scenes(scenes), scene, scenes)
    with progress_bar() as report:
        imagined = show_scene(
            chosen, out, model or [], liquid.value, seed,
            progress=lambda done, total: report("drawing", done, total),
        )  # fmt: skip
    for one in imagined:
        typer.echo(f"{one.name}: J = {one.judgment:.2f}")
    typer.echo(f"{out}: {chosen.id}")


@app.command(name="import")
def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Files to read.")],
    out: Annotated[Path, typer.Option("--output", "-o", help="Scene file to write (.json).")],
    kind: Annotated[
        ForeignFormat | None, typer.Option("--format", help="By default found from the file.")
    ] = None,
    width: Annotated[
        float, typer.Option(min=0.05, max=20.0, help="Width of the box [m] (SVG, plinko).")
    ] = 1.0,
) -> None:
    """Read scenes made elsewhere: SVG drawings, plinko JSON, SPlisHSPlasH JSON.

    In an SVG, name the shapes (or fill them): liquid (blue), cup (green) or divider
    (red); all other filled shapes are obstacles.

    Example: pourcast import drawing.svg -o mine.json
    """
    from pourcast.generate.importers import import_scene
    from pourcast.scene import write_scenes

    imported = [import_scene(p, kind=kind.value if kind else None, width=width) for p in files]
    names = [scene.id for scene in imported]
    if len(set(names)) < len(names):
        imported = [
            scene.model_copy(update={"id": f"{scene.id}-{k}"})
            for k, scene in enumerate(imported, start=1)
        ]
    write_scenes(out, imported)
    for scene in imported:
        typer.echo(f"{out}: {scene.id}, {len(scene.obstacles)} convex obstacles, {scene.goal.kind}")


@app.command()
def export(
    scenes: ScenesArgument,
    out: Annotated[Path, typer.Option("--output", "-o", help="JSON file to write.")],
    scene: Annotated[str, typer.Option(help="Which scene: a number from 1, or its id.")] = "1",
) -> None:
    """Write a scene for SPlisHSPlasH, an independent SPH engine, with its meshes beside it.

    Example: pourcast export scenes.json --scene 3 -o splish/scene.json
    """
    from pourcast.generate.importers.splishsplash import write
    from pourcast.study import load_scenes, pick_scene

    written = write(pick_scene(load_scenes(scenes), scene, scenes), out)
    typer.echo(f"{out}: and {len(written) - 1} meshes beside it")


@app.command()
def bench(
    n_particles: Annotated[
        list[int] | None, typer.Option("-N", min=1, max=300, help="Number of particles; several.")
    ] = None,
    plan: Annotated[
        Plan | None, typer.Option(help="Instead: how long a grid of simulations takes here.")
    ] = None,
    share: Annotated[
        float, typer.Option(min=0.001, max=1.0, help="Share of the plan that is run for it.")
    ] = 0.05,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Measure how fast this machine simulates: ratios first, simulations of 4 s per second second.

    Example: pourcast bench --plan paper
    """
    from pourcast.bench import COUNTS, paper_grid, plan_table, speed_table

    with progress_bar() as report:
        if plan is None:
            table = speed_table(n_particles or COUNTS, report)
        else:
            table = plan_table(paper_grid(), share, seed, report)
    if as_json:
        print_json(json.loads(table.reset_index().to_json(orient="records")))
        return
    print_table(table.reset_index().set_index(table.index.names[0]))
    if plan is not None:
        typer.echo(
            f"\n{table['simulations'].sum()} simulations: {table['minutes'].sum():.0f} minutes "
            f"on this machine (measured on {table['run'].sum()} of them)"
        )


@app.command()
def models(as_json: JsonOption = False) -> None:
    """List the models, their parameters and ranges.

    Example: pourcast models
    """
    import pandas as pd

    from pourcast.model import family_names, parameter_table, presets, third_party

    if as_json:
        listed = {name: parameter_table(name) for name in (*family_names(), *third_party())}
        print_json({"presets": presets(), "models": listed})
        return
    rows = {name: [entry["model"], entry["source"]] for name, entry in presets().items()}
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=["model", "what it is"])
    frame.index.name = "preset"
    print_table(frame)
    for name in (*family_names(), *third_party()):
        typer.echo(f"\n{name}")
        parameters = pd.DataFrame(parameter_table(name)).set_index("parameter")
        print_table(parameters)


def main() -> None:
    """Run the command line; the entry point of `pourcast`."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run a command, print errors as one line, and return the exit code."""
    try:
        result = typer.main.get_command(app).main(
            arguments or ["--help"], prog_name="pourcast", standalone_mode=False
        )
    except InputError as error:
        return _complain(str(error), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", 128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except typer.TyperException as error:
        return _complain(error.format_message(), 2)
    except Exception as error:
        if os.environ.get("POURCAST_TRACEBACK"):
            raise
        hint = "set POURCAST_TRACEBACK=1 to see where"
        return _complain(f"{type(error).__name__}: {error} ({hint})", 1)
    return result if isinstance(result, int) else 0


def _complain(message: str, code: int) -> int:
    typer.echo(f"pourcast: {' '.join(message.split())}", err=True)
    return code
