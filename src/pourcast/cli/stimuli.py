"""The command that makes what participants see: stimuli."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pourcast.cli.app import app
from pourcast.cli.interruption import end_in_own_time
from pourcast.cli.options import (
    ClusterOption,
    ExecutorName,
    ExecutorOption,
    JsonOption,
    SchedulerOption,
    StudyArgument,
    complete_liquid,
    pixels,
)
from pourcast.cli.terminal import print_json, progress_bar, resumable

if TYPE_CHECKING:
    from collections.abc import Callable

    from pourcast.sweep.executors import Executor


@app.command()
def stimuli(
    study: StudyArgument,
    solver: Annotated[
        str,
        typer.Option(help="lbm: lattice Boltzmann, as in the paper; sph: the models' own engine."),
    ] = "lbm",
    renderer: Annotated[
        str,
        typer.Option(
            help="preview: flat, at once; cycles: Blender's path tracer, as in the paper."
        ),
    ] = "preview",
    preview: Annotated[
        bool, typer.Option("--preview", help="A quick look: at resolution 60.")
    ] = False,
    scenes: Annotated[
        int | None, typer.Option(min=1, help="Only the first so many scenes, without practice.")
    ] = None,
    scene: Annotated[
        list[str] | None, typer.Option(help="Only this scene, by number or id; several times.")
    ] = None,
    liquid: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            autocompletion=complete_liquid,
            help="Only this liquid, any there is [those of the design].",
        ),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Length of the films [4 s of water, 10 s of honey].")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Pixels [preview 600, cycles 640x960]."),
    ] = None,
    samples: Annotated[
        int | None, typer.Option(min=1, help="cycles: paths per pixel [64].")
    ] = None,
    denoise: Annotated[
        bool | None, typer.Option("--denoise/--no-denoise", help="cycles: smooth noise away [yes].")
    ] = None,
    resolution: Annotated[
        int | None, typer.Option(help="lbm: cells along the longest side [100; paper 300].")
    ] = None,
    layers: Annotated[
        int | None,
        typer.Option(help="lbm: cells through the depth; few, and fine cells are cheap [all]."),
    ] = None,
    real_size: Annotated[
        float | None,
        typer.Option(help="lbm: real length of that side, in metres [0.5, as in the paper]."),
    ] = None,
    webm: Annotated[bool, typer.Option("--webm", help="Make WebM films, too.")] = False,
    replace: Annotated[
        bool,
        typer.Option(
            "--replace", help="Begin the set anew if it was made otherwise: what was in it goes."
        ),
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
    from pourcast.experiment.design.films import film_study
    from pourcast.stimuli.settings import PREVIEW_RESOLUTION, stimulus_settings

    quick = preview and resolution is None and solver == "lbm"
    settings = stimulus_settings(
        solver,
        renderer,
        size=pixels(size),
        seconds=seconds,
        webm=webm,
        options={
            "resolution": PREVIEW_RESOLUTION if quick else resolution,
            "layers": layers,
            "real_size": real_size,
            "samples": samples,
            "denoise": denoise,
        },
    )
    with resumable(study / "stimuli"), progress_bar() as report:
        made, sheet = film_study(
            study,
            settings,
            first=scenes,
            names=scene or (),
            liquid=liquid,
            replace=replace,
            workers=workers,
            open_executor=_opener(study, executor, workers, scheduler, cluster),
            report=report,
        )
    if as_json:
        print_json(made.manifest.content())
        return
    typer.echo(f"{made.folder}: {len(made.manifest.stimuli)} stimuli ({settings.name})\n{sheet}")


def _opener(
    study: Path,
    executor: ExecutorName,
    workers: int | None,
    scheduler: str | None,
    cluster: Path | None,
) -> "Callable[[], Executor] | None":
    """What opens a cluster; None for this machine."""
    from pourcast.sweep.executors.choose import ClusterOptions, make_executor, read_cluster

    if executor is ExecutorName.LOCAL:
        return None
    end_in_own_time()
    options = read_cluster(cluster) if cluster else ClusterOptions()
    return partial(make_executor, executor.value, workers, study / "stimuli", scheduler, options)
