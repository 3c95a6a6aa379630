"""Commands that make scenes and show them: scenes, new, import, export, show."""

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
    complete_experiment,
)
from pourcast.cli.terminal import print_json, print_rows, progress_bar


class ForeignFormat(StrEnum):
    """Formats of scenes made elsewhere."""

    SVG = "svg"
    PLINKO = "plinko"
    SPLISHSPLASH = "splishsplash"


EXPERIMENT_HELP = "An experiment by name, such as exp1; `pourcast list` lists them."
ExperimentArgument = Annotated[
    str,
    typer.Argument(metavar="EXPERIMENT", help=EXPERIMENT_HELP, autocompletion=complete_experiment),
]
CountOption = Annotated[
    int | None, typer.Option("-n", "--scenes", min=1, help="How many [as the experiment has].")
]
CandidatesOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Size of the pool that scenes are chosen from, if they are [as the experiment says].",
    ),
]


@app.command()
def scenes(
    experiment: ExperimentArgument,
    out: Annotated[Path, typer.Option("--output", "-o", help="Scene file to write (.json).")],
    count: CountOption = None,
    seed: SeedOption = 0,
    candidates: CandidatesOption = None,
    as_json: JsonOption = False,
) -> None:
    """Generate an experiment's scenes: drawn at random, filtered by simulation, and chosen.

    Example: pourcast scenes exp1 -n 120 --seed 1 -o scenes.json
    """
    from pourcast.files import check_writable
    from pourcast.scenes.scene_file import write_scenes
    from pourcast.study.folder import SceneRequest, generate_scenes

    request = SceneRequest(experiment, count, seed, candidates)
    check_writable(out)
    with progress_bar() as report:
        selection = generate_scenes(request, report)
    write_scenes(out, selection.scenes)
    _print_selection(selection, request.choice, out, as_json=as_json)


def _print_selection(selection: Any, choice: Any, path: Path, *, as_json: bool) -> None:
    from pourcast.study.chosen import stages_of

    chosen = [one.model_dump() for one in stages_of(choice, selection)]
    if as_json:
        facts = {
            "file": str(path), "scenes": len(selection.scenes), "drawn": selection.drawn,
            "kept": selection.kept, "acceptance": selection.kept / selection.drawn,
            "chosen": chosen, "figures": dict(selection.figures),
        }  # fmt: skip
        print_json(facts)
        return
    typer.echo(f"{path}: {len(selection.scenes)} scenes")
    print_rows(chosen)
    for words, value in selection.figures.items():
        typer.echo(f"{words}: {value:.3g}")


@app.command()
def new(
    experiment: ExperimentArgument,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to make.")],
    count: CountOption = None,
    seed: SeedOption = 0,
    candidates: CandidatesOption = None,
    practice: Annotated[
        int | None,
        typer.Option(min=0, help="Scenes that participants practise with [as the experiment has]."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Make a study folder with freshly generated scenes.

    Example: pourcast new exp1 my-study --scenes 40
    """
    from pourcast.study.experiments.registry import EXPERIMENTS
    from pourcast.study.folder import SceneRequest, new_study

    if practice is None:
        practice = EXPERIMENTS.get(experiment).practice_count
    request = SceneRequest(experiment, count, seed, candidates, practice)
    with progress_bar() as report:
        selection = new_study(folder, request, report)
    _print_selection(selection, request.choice, folder / "scenes.json", as_json=as_json)


@app.command()
def show(
    scenes: ScenesArgument,
    out: Annotated[Path, typer.Option("--output", "-o", help="A .png, .svg, .gif or .mp4 file.")],
    scene: Annotated[
        str, typer.Option(help="Which scene: a number from 1, its id, or `all` on one page.")
    ] = "1",
    model: ModelOption = None,
    liquid: LiquidOption = "water",
    seed: SeedOption = 0,
) -> None:
    """Look at a scene, at a pour in six moments (.png, .svg) or as a film (.gif, .mp4).

    Several models stand side by side, each with its judgment. With `--scene all`, all scenes
    stand on one page (.png, .svg), with the liquid's way and end by each model.

    Example: pourcast show scenes.json --scene 3 -m water-ife -m honey-ife-1 -o pour.mp4
    """
    from pourcast.pictures.show import show as show_scene
    from pourcast.pictures.show import show_all
    from pourcast.study.folder import load_scenes, pick_scene, study_liquids

    loaded = load_scenes(scenes)
    if scene == "all":
        own = study_liquids(scenes)
        with progress_bar() as report:
            show_all(loaded, out, model or [], liquid, seed, own=own, report=report)
        typer.echo(f"{out}: {len(loaded)} scenes")
        return
    chosen = pick_scene(loaded, scene, scenes)
    with progress_bar() as report:
        predictions = show_scene(
            chosen, out, model or [], liquid, seed, own=study_liquids(scenes), report=report
        )
    for one in predictions:
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
    from pourcast.scenes.importers import import_scene
    from pourcast.scenes.scene_file import write_scenes

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
    from pourcast.scenes.importers.splishsplash import write
    from pourcast.study.folder import load_scenes, pick_scene

    written = write(pick_scene(load_scenes(scenes), scene, scenes), out)
    typer.echo(f"{out}: and {len(written) - 1} meshes beside it")
