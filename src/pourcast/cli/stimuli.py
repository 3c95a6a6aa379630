"""The command that makes what participants see: stimuli."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pourcast.cli.app import app
from pourcast.cli.options import (
    ClusterOption,
    ExecutorName,
    ExecutorOption,
    JsonOption,
    SchedulerOption,
    StudyArgument,
    pixels,
)
from pourcast.cli.terminal import print_json, progress_bar
from pourcast.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from pourcast.stimuli.recipe import Recipe
    from pourcast.sweep.executors import Executor

_PREVIEW_RESOLUTION = 60


class SolverName(StrEnum):
    """What pours the liquid."""

    LBM = "lbm"
    SPH = "sph"


class RendererName(StrEnum):
    """What makes the pictures."""

    PREVIEW = "preview"
    CYCLES = "cycles"


class StimulusLiquid(StrEnum):
    """Liquids of stimuli."""

    WATER = "water"
    HONEY = "honey"


@app.command()
def stimuli(
    study: StudyArgument,
    solver: Annotated[
        SolverName,
        typer.Option(help="lbm: lattice Boltzmann, as in the paper; sph: the models' own engine."),
    ] = SolverName.LBM,
    renderer: Annotated[
        RendererName,
        typer.Option(
            help="preview: flat, at once; cycles: Blender's path tracer, as in the paper."
        ),
    ] = RendererName.PREVIEW,
    preview: Annotated[
        bool, typer.Option("--preview", help="A quick look: preview, at resolution 60.")
    ] = False,
    scenes: Annotated[
        int | None, typer.Option(min=1, help="Only the first so many scenes, without practice.")
    ] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="Only this scene, by number or id; several times.")
    ] = None,
    liquid: Annotated[
        StimulusLiquid | None, typer.Option(help="Only this liquid [those of the design].")
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Length of the films [4 s of water, 10 s of honey].")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Pixels [preview 600, cycles 640x960]."),
    ] = None,
    samples: Annotated[int, typer.Option(min=1, help="cycles: paths per pixel.")] = 64,
    denoise: Annotated[
        bool, typer.Option("--denoise/--no-denoise", help="cycles: smooth noise away.")
    ] = True,
    resolution: Annotated[
        int | None, typer.Option(help="lbm: cells along the longest side [100; paper 300].")
    ] = None,
    real_size: Annotated[
        float, typer.Option(help="lbm: real length of that side, in metres (paper: 0.5).")
    ] = 0.5,
    honey_viscosity: Annotated[
        float | None, typer.Option(help="lbm: in Pa s (paper: 0.1 and 0.002; real honey: 10).")
    ] = None,
    honey_slip: Annotated[
        float, typer.Option(help="lbm: 1 lets honey slip along walls (paper), 0 holds it.")
    ] = 1.0,
    honey_adhesion: Annotated[
        float, typer.Option(help="lbm: pull of walls on honey [m/s2].")
    ] = 0.0,
    webm: Annotated[bool, typer.Option("--webm", help="Make WebM films, too.")] = False,
    replace: Annotated[
        bool, typer.Option("--replace", help="Make all anew if they were made otherwise.")
    ] = False,
    executor: ExecutorOption = ExecutorName.LOCAL,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Films at a time [all cores; 1 for cycles].")
    ] = None,
    scheduler: SchedulerOption = None,
    cluster: ClusterOption = None,
    as_json: JsonOption = False,
) -> None:
    """Film a study's scenes: stills, films, outcomes and a contact sheet.

    Goes on where it stopped, film by film, and with cycles picture by picture. The experiment
    shows the best set that is whole: cycles before preview, lbm before sph.

    Example: pourcast stimuli my-study --preview
    """
    from pourcast.experiment.design.materials import study_trials
    from pourcast.stimuli.contact_sheet import write_contact_sheet
    from pourcast.stimuli.make import make_stimuli
    from pourcast.stimuli.manifest import Wanted
    from pourcast.study.folder import load_practice, pick_scene, study_scenes

    recipe = _recipe(
        solver,
        RendererName.PREVIEW if preview else renderer,
        seconds=seconds,
        size=pixels(size),
        cycles={"samples": samples, "denoise": denoise},
        lattice={
            "resolution": resolution or (_PREVIEW_RESOLUTION if preview else None),
            "real_size": real_size,
            "honey_viscosity": honey_viscosity,
            "honey_slip": honey_slip,
            "honey_adhesion": honey_adhesion,
        },
        webm=webm,
    )
    known, practice = study_scenes(study), load_practice(study)
    chosen = {one.id for one in (known[:scenes] if scenes else [*known, *practice])}
    if scene:
        chosen = {pick_scene([*known, *practice], name, study).id for name in scene}
    wanted = [
        Wanted(trial.shown_scene, trial.liquid, film=True)
        for trial in study_trials(study)
        if trial.scene.id in chosen and liquid in (None, trial.liquid)
    ]
    with progress_bar() as report:
        made = make_stimuli(
            study,
            wanted,
            recipe,
            replace=replace,
            workers=workers,
            open_executor=_opener(study, executor, workers, scheduler, cluster),
            report=report,
        )
    sheet = write_contact_sheet(made, [*known, *practice])
    if as_json:
        print_json(made.manifest.model_dump(mode="json"))
        return
    typer.echo(f"{made.folder}: {len(made.manifest.stimuli)} stimuli ({recipe.name})\n{sheet}")


def _opener(
    study: Path,
    executor: ExecutorName,
    workers: int | None,
    scheduler: str | None,
    cluster: Path | None,
) -> "Callable[[], Executor] | None":
    """What opens a cluster; None for this machine."""
    from functools import partial

    from pourcast.sweep.executors.choose import ClusterOptions, make_executor, read_cluster

    if executor is ExecutorName.LOCAL:
        return None
    options = read_cluster(cluster) if cluster else ClusterOptions()
    return partial(make_executor, executor.value, workers, study / "stimuli", scheduler, options)


def _recipe(
    solver: SolverName,
    renderer: RendererName,
    *,
    seconds: float | None,
    size: tuple[int, ...],
    cycles: dict[str, Any],
    lattice: dict[str, Any],
    webm: bool,
) -> "Recipe":
    """How the stimuli are made; options that don't concern the solver or renderer are left out."""
    from pydantic import ValidationError

    from pourcast.errors import one_line
    from pourcast.stimuli.recipe import Recipe

    look = dict(zip(("width", "height"), size, strict=False))
    if renderer is RendererName.CYCLES:
        look |= cycles
    elif len(size) > 1:
        del look["height"]  # follows from the box
    flow = lattice if solver is SolverName.LBM else {}
    given = {
        "flow": {"solver": solver.value} | {k: v for k, v in flow.items() if v is not None},
        "look": {"renderer": renderer.value} | look,
        "seconds": seconds,
        "webm": webm,
    }
    try:
        return Recipe.model_validate(given)
    except ValidationError as error:
        raise InputError(one_line(error)) from None
