"""Simulated observers: how they answer, and the command that lets them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pourcast.cli.app import app
from pourcast.cli.options import SeedOption, StudyArgument
from pourcast.cli.terminal import progress_bar
from pourcast.errors import InputError

if TYPE_CHECKING:
    from pourcast.statistics.observer import Population

BiasOption = Annotated[
    float | None, typer.Option(help="Observers: mean of what is added to all answers [0].")
]
SlopeOption = Annotated[
    float | None,
    typer.Option(help="Observers: mean slope; below 1 keeps nearer to the middle [0.85]."),
]
PrecisionOption = Annotated[
    float | None, typer.Option(help="Observers: median precision of the noise [4].")
]
LapseOption = Annotated[
    float | None, typer.Option(help="Observers: share of trials answered anywhere [0.03].")
]
GranularityOption = Annotated[
    float | None, typer.Option(help="Observers: step of the slider [0.01].")
]

experiment_app = typer.Typer(
    help="The experiment with people: serve it in their browsers, rehearse it, take the data out.",
    rich_markup_mode=None,
)
app.add_typer(experiment_app, name="experiment")


def population_of(**given: float | None) -> "Population":
    """Observers as the options say, else as usual."""
    from pourcast.statistics.observer import Population

    return Population(**{name: value for name, value in given.items() if value is not None})


@experiment_app.command("simulate")
def simulate(
    study: StudyArgument,
    observers: Annotated[
        int | None, typer.Option(min=1, help="How many observers [as the experiment had].")
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            "-m",
            metavar="[LIQUID=]NAME[:...]",
            help="Model in the heads, in all trials or in a liquid's; several times "
            "[as the experiment says].",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER=SD",
            help="How much observers differ in a parameter [damping_zeta=1.5, m=0.02, g=0.1].",
        ),
    ] = None,
    bias: BiasOption = None,
    slope: SlopeOption = None,
    precision: PrecisionOption = None,
    lapse: LapseOption = None,
    granularity: GranularityOption = None,
    out: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Table to write [STUDY/responses/simulated.csv]."),
    ] = None,
    browser: Annotated[
        bool,
        typer.Option("--browser", help="Through the real page, into the study's database."),
    ] = False,
    visual: Annotated[
        bool, typer.Option("--visual", help="--browser, in a window to watch, at a human pace.")
    ] = False,
    seed: SeedOption = 0,
) -> None:
    """Rehearse a study: observers with a model in their heads answer, with noise and lapses.

    Every row says that it is simulated. Observers see the liquids that their group sees by the
    study's design, or by its experiment. With --browser they take part as people will, from consent
    to completion code.

    Example: pourcast experiment simulate my-study --observers 65 --model water-ife
    """
    from pourcast.files import check_writable
    from pourcast.observers.observers import SPREADS
    from pourcast.observers.responses import models_by_liquid, observers_of, rehearse, study_groups
    from pourcast.study.folder import study_experiment, study_liquids, study_scenes
    from pourcast.tables import check_table_path

    scenes = study_scenes(study)
    if out is not None:
        check_table_path(out)
        check_writable(out)
    experiment = study_experiment(study, scenes)
    groups = study_groups(study, experiment)
    who = observers_of(
        experiment,
        observers,
        models=models_by_liquid(model or [], groups),
        groups=groups,
        own=study_liquids(study),
        population=population_of(
            bias=bias, slope=slope, precision=precision, lapse=lapse, granularity=granularity
        ),
        spreads=_spreads(vary) if vary else dict(SPREADS),
        seed=seed,
    )
    if browser or visual:
        if out is not None:
            raise InputError("simulate: --output does not go with --browser: the database keeps it")
        from pourcast.extras import require_extra

        require_extra("experiment")
        from pourcast.observers.browser import take_part_in_browser

        with progress_bar() as report:
            database = take_part_in_browser(study, who, visual=visual, report=report)
        typer.echo(f"{database}: {who.count} simulated observers took part")
        return
    with progress_bar() as report:
        path = rehearse(study, scenes, who, out, report)
    trials = len(scenes) * len(who.seen_by(0))
    typer.echo(f"{path}: {who.count} simulated observers, {trials} trials each")


def _spreads(options: list[str]) -> dict[str, float]:
    spreads = {}
    for option in options:
        name, _, text = (part.strip() for part in option.partition("="))
        try:
            spreads[name] = float(text)
        except ValueError:
            raise InputError(f"vary: expected PARAMETER=SD, found {option!r}") from None
    return spreads
