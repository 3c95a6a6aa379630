"""Commands that say what a design could tell apart: recover, power."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pourcast.cli.app import app
from pourcast.cli.observers import (
    BiasOption,
    GranularityOption,
    LapseOption,
    PrecisionOption,
    SlopeOption,
    population_of,
)
from pourcast.cli.options import (
    JsonOption,
    ModelOption,
    Resampled,
    ResampleOption,
    SeedOption,
    StudyArgument,
)
from pourcast.cli.terminal import print_json, print_table, progress_bar, records
from pourcast.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


class Recovered(StrEnum):
    """What is planted in simulated studies."""

    PARAMETERS = "parameters"
    MODELS = "models"


ObserversOption = Annotated[int, typer.Option(min=1, help="Observers in a simulated study.")]
StudiesOption = Annotated[int, typer.Option(min=1, help="Simulated studies for each case.")]


@app.command()
def recover(
    what: Annotated[Recovered, typer.Argument(help="What is planted in simulated studies.")],
    study: StudyArgument,
    model: ModelOption = None,
    parameter: Annotated[
        str,
        typer.Option("--parameter", "-p", help="parameters: which one, along the swept values."),
    ] = "damping_zeta",
    observers: ObserversOption = 30,
    studies: StudiesOption = 100,
    spread: Annotated[
        float, typer.Option(min=0, help="parameters: observers differ by so many grid steps (SD).")
    ] = 0.0,
    honey: Annotated[bool, typer.Option("--honey", help="Honey trials instead of water.")] = False,
    bias: BiasOption = None,
    slope: SlopeOption = None,
    precision: PrecisionOption = None,
    lapse: LapseOption = None,
    granularity: GranularityOption = None,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the table and the figure.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Which parameters, or models, could this design have told apart? Plant each, and recover it.

    Example: pourcast recover parameters my-study -m water-ife -p damping_zeta
    """
    from pourcast.comparison import planning as design
    from pourcast.models.registry import complete_presets
    from pourcast.report.figures.design import recovery
    from pourcast.scenes.liquids.registry import resolve_liquid
    from pourcast.study.experiments.base import observer_model
    from pourcast.study.folder import study_experiment, study_scenes
    from pourcast.sweep.judged import judge_in_study, read_judged

    scenes = study_scenes(study)
    liquid = "honey" if honey else "water"
    population = population_of(
        bias=bias, slope=slope, precision=precision, lapse=lapse, granularity=granularity
    )
    common: dict[str, Any] = {
        "observers": observers, "studies": studies, "population": population, "seed": seed
    }  # fmt: skip
    with progress_bar() as bar:
        if what is Recovered.PARAMETERS:
            experiment = study_experiment(study, scenes)
            spec = (model or [observer_model(experiment, liquid)])[0]
            trial_liquid = resolve_liquid(liquid, scenes[0]).name
            values, judged = design.along(read_judged(study, scenes), trial_liquid, spec, parameter)
            table = design.parameter_recovery_table(
                values, judged, spread=spread, report=bar, **common
            )
            title = f"{spec}: {parameter}"
        else:
            specs = list(dict.fromkeys(model or complete_presets()))
            if len(specs) < 2:
                raise InputError("model: expected at least two models to tell apart")
            found = judge_in_study(study, scenes, [(liquid, spec) for spec in specs], "design")
            models = {spec: found[liquid, spec] for spec in specs}
            table = design.model_recovery_table(models, report=bar, **common)
            title = f"{liquid} trials: {observers} participants, {len(scenes)} scenes"
    if out is not None:
        _write_design(out, f"{what.value}_recovery", table.reset_index(), recovery(table, title))
    if as_json:
        print_json(records(table.reset_index()))
        return
    typer.echo(f"{title}; {studies} simulated studies of {observers} observers each")
    shown = table.copy()
    shown.columns = [f"{name:g}" if isinstance(name, int | float) else str(name) for name in table]
    print_table(shown)
    if out is not None:
        typer.echo(f"{out}: table and figure")


def _write_design(folder: Path, name: str, table: "pd.DataFrame", figure: Any) -> None:
    from pourcast.pictures.style import save_figure
    from pourcast.tables import write_table

    table.columns = [str(column) for column in table.columns]
    write_table(folder / f"{name}.csv", table.assign(simulated=True))
    save_figure(figure, folder / name, simulated=True)


@app.command()
def power(
    study: StudyArgument,
    model: ModelOption = None,
    observers: Annotated[
        list[int] | None, typer.Option(min=2, help="Participants; several [5, 10, 20, 40].")
    ] = None,
    scenes: Annotated[
        list[int] | None, typer.Option("-n", "--scenes", min=3, help="Scenes; several [all].")
    ] = None,
    studies: StudiesOption = 100,
    resample: ResampleOption = Resampled.BOTH,
    level: Annotated[float, typer.Option(min=0.5, max=0.999, help="Of the intervals.")] = 0.95,
    honey: Annotated[bool, typer.Option("--honey", help="Honey trials instead of water.")] = False,
    bias: BiasOption = None,
    slope: SlopeOption = None,
    precision: PrecisionOption = None,
    lapse: LapseOption = None,
    granularity: GranularityOption = None,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the table and the figure.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """How many participants and scenes tell two models apart? The first is in people's heads.

    Example: pourcast power my-study -m water-ife -m water-marble --observers 10 --observers 30
    """
    from pourcast.comparison.planning import power_table
    from pourcast.report.figures import design as figures
    from pourcast.study.folder import study_scenes
    from pourcast.sweep.judged import judge_in_study

    there = study_scenes(study)
    specs = model or ["water-ife", "water-marble"]
    if len(set(specs)) != 2 or len(specs) != 2:
        raise InputError(f"model: expected two models to tell apart, found {len(specs)}")
    liquid = "honey" if honey else "water"
    population = population_of(
        bias=bias, slope=slope, precision=precision, lapse=lapse, granularity=granularity
    )
    with progress_bar() as bar:
        found = judge_in_study(study, there, [(liquid, spec) for spec in specs], "design")
        table = power_table(
            {spec: found[liquid, spec] for spec in specs},
            observers=observers or (5, 10, 20, 40), scenes=scenes or [len(there)],
            studies=studies, population=population, resampled=resample.value, level=level,
            seed=seed, report=bar,
        )  # fmt: skip
    title = f"{specs[0]} in people's heads, told from {specs[1]}"
    if out is not None:
        _write_design(out, "power", table, figures.power(table, title))
    if as_json:
        print_json(records(table))
        return
    typer.echo(f"{title}: {resample.value} resampled, {studies} simulated studies each")
    print_table(table.set_index("observers"))
    if out is not None:
        typer.echo(f"{out}: table and figure")
