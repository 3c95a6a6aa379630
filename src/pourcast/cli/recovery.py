"""Commands that say what a study could tell apart: recover, power."""

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
    LiquidOption,
    ModelOption,
    Over,
    OverOption,
    SeedOption,
    StudyArgument,
)
from pourcast.cli.terminal import print_json, print_table, progress_bar, records

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
    over: Annotated[Over, typer.Option(help="models: what tests hold over.")] = Over.BOTH,
    level: Annotated[
        float, typer.Option(min=0.5, max=0.999, help="models: told apart if p is below 1 - level.")
    ] = 0.95,
    spread: Annotated[
        float, typer.Option(min=0, help="parameters: observers differ by so many grid steps (SD).")
    ] = 0.0,
    liquid: LiquidOption = "water",
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
    from pourcast.comparison.agreement import Settings
    from pourcast.comparison.recovery import recover_models, recover_parameter
    from pourcast.report.figures.design import recovery
    from pourcast.statistics.jackknife import FEWEST, unknowable

    common: dict[str, Any] = {
        "observers": observers, "studies": studies,
        "population": population_of(
            bias=bias, slope=slope, precision=precision, lapse=lapse, granularity=granularity
        ),
    }  # fmt: skip
    with progress_bar() as bar:
        if what is Recovered.PARAMETERS:
            spec = model[0] if model else None
            title, table = recover_parameter(
                study, parameter, liquid, spec, spread=spread, seed=seed, report=bar, **common
            )
        else:
            title, table = recover_models(
                study,
                liquid,
                model or (),
                settings=Settings(over.value, level, seed),
                report=bar,
                **common,
            )
    if out is not None:
        _write(out, f"{what.value}_recovery", table.reset_index(), recovery(table, title))
    if as_json:
        print_json(records(table.reset_index()))
        return
    typer.echo(f"{title}; {studies} simulated studies of {observers} observers each")
    # Of scenes, which the study's folder has, there may be too few as well.
    if what is Recovered.MODELS and (why := unknowable(over.value, observers, FEWEST)):
        typer.echo(f"(no model is told from others: {why})")
    shown = table.copy()
    shown.columns = [
        f"{name:g}" if isinstance(name, int | float) else str(name).replace("_", " ")
        for name in table
    ]
    print_table(shown)
    if out is not None:
        typer.echo(f"{out}: table and figure")


def _write(folder: Path, name: str, table: "pd.DataFrame", figure: Any) -> None:
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
        list[int] | None,
        typer.Option(min=5, help="Participants, beside the study's; several [5, 10, 20, 40]."),
    ] = None,
    scenes: Annotated[
        list[int] | None,
        typer.Option("-n", "--scenes", min=5, help="Scenes, beside the study's; several."),
    ] = None,
    studies: StudiesOption = 100,
    over: OverOption = Over.BOTH,
    level: Annotated[float, typer.Option(min=0.5, max=0.999, help="Of the intervals.")] = 0.95,
    liquid: LiquidOption = "water",
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

    Studies are analysed as `compare` does it: of these models, with p corrected for all pairs.

    Example: pourcast power my-study -m water-ife -m water-marble --observers 10 --observers 30
    """
    from pourcast.comparison.agreement import Settings
    from pourcast.comparison.recovery import study_power
    from pourcast.report.figures import design as figures
    from pourcast.statistics.jackknife import over_words

    with progress_bar() as bar:
        title, table = study_power(
            study, liquid, model or (),
            observers=observers or (), scenes=scenes or (), studies=studies,
            population=population_of(
                bias=bias, slope=slope, precision=precision, lapse=lapse, granularity=granularity
            ),
            settings=Settings(over.value, level, seed), report=bar,
        )  # fmt: skip
    if out is not None:
        _write(out, "power", table, figures.power(table, title))
    if as_json:
        print_json(records(table))
        return
    typer.echo(
        f"{title}: differences over {over_words(over.value)}, {studies} simulated studies each"
    )
    print_table(table.drop(columns="drawn_again").set_index("observers"))
    if table["drawn_again"].any():
        most = table["scenes"][~table["drawn_again"]].max()
        typer.echo(f"(of more than {most} scenes, some are drawn twice: that power is too high)")
    if out is not None:
        typer.echo(f"{out}: table and figure")
