"""Commands that compare models with people: compare, report, reproduce, recover, power."""

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pourcast.cli.app import app
from pourcast.cli.options import JsonOption, ModelOption, SeedOption
from pourcast.cli.scenes import Experiment
from pourcast.cli.terminal import print_json, print_table, progress_bar
from pourcast.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from pourcast.analysis.comparison import Comparison, Request
    from pourcast.compare.observer import Population


class Resampled(StrEnum):
    """What is drawn again for intervals."""

    PARTICIPANTS = "participants"
    SCENES = "scenes"
    BOTH = "both"


class Recovered(StrEnum):
    """What is planted in simulated studies."""

    PARAMETERS = "parameters"
    MODELS = "models"


StudyArgument = Annotated[Path, typer.Argument(metavar="STUDY", help="A study folder.")]
ResponsesOption = Annotated[
    Path | None,
    typer.Option("--responses", metavar="FILE", help="Responses (.csv, .parquet) [the study's]."),
]
PercentOption = Annotated[bool, typer.Option("--percent", help="The responses are 0..100.")]
ExcludeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude", metavar="RULE",
        help="min-sd=0.05, min-trials=N, min-attention=SHARE, min-rt=S, max-rt=S, "
        "participant=NAME, repeats=first; several, in their order.",
    ),
]  # fmt: skip
ResampleOption = Annotated[
    Resampled, typer.Option(help="What the intervals' bootstrap draws again.")
]
ResamplesOption = Annotated[int, typer.Option(min=100, max=1_000_000, help="Bootstrap resamples.")]
CarryOption = Annotated[
    Path | None,
    typer.Option("--carry-from", metavar="STUDY", help="Carry over the parameters chosen there."),
]
ObserversOption = Annotated[int, typer.Option(min=1, help="Observers in a simulated study.")]
StudiesOption = Annotated[int, typer.Option(min=1, help="Simulated studies for each case.")]
BiasOption = Annotated[float, typer.Option(help="Observers: mean of what is added to all answers.")]
SlopeOption = Annotated[
    float, typer.Option(help="Observers: mean slope; below 1 keeps nearer to the middle.")
]
PrecisionOption = Annotated[float, typer.Option(help="Observers: median precision of the noise.")]
LapseOption = Annotated[float, typer.Option(help="Observers: share of trials answered anywhere.")]
GranularityOption = Annotated[float, typer.Option(help="Observers: step of the slider.")]

_BIAS, _SLOPE, _PRECISION, _LAPSE, _GRANULARITY = 0.0, 0.85, 10.0, 0.02, 0.01

experiment_app = typer.Typer(
    help="Responses to a study: for now, those of simulated observers.",
    rich_markup_mode=None,
)
app.add_typer(experiment_app, name="experiment")


def _population(
    bias: float, slope: float, precision: float, lapse: float, granularity: float
) -> "Population":
    from pourcast.compare.observer import Population

    return Population(
        bias=bias, slope=slope, precision=precision, lapse=lapse, granularity=granularity
    )


def _scenes_of(study: Path) -> list[Any]:
    from pourcast.study import load_scenes

    if not study.is_dir():
        raise InputError(f"{study}: expected a study folder; `pourcast new` makes one")
    return load_scenes(study)


@experiment_app.command("simulate")
def simulate(
    study: StudyArgument,
    observers: Annotated[
        int | None, typer.Option(min=1, help="How many observers [65; 21 for a cup].")
    ] = None,
    model: Annotated[
        str, typer.Option("--model", "-m", help="Model in the heads, water trials.")
    ] = "water-ife",
    honey_model: Annotated[
        str, typer.Option("--honey-model", help="Model in the heads, honey trials.")
    ] = "honey-ife-2",
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PARAMETER=SD",
            help="How much observers differ in a parameter [damping_zeta=1.5, m=0.02, g=0.1].",
        ),
    ] = None,
    bias: BiasOption = _BIAS,
    slope: SlopeOption = _SLOPE,
    precision: PrecisionOption = _PRECISION,
    lapse: LapseOption = _LAPSE,
    granularity: GranularityOption = _GRANULARITY,
    out: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Table to write [STUDY/responses/simulated.csv]."),
    ] = None,
    seed: SeedOption = 0,
) -> None:
    """Rehearse a study: observers with a model in their heads answer, with noise and lapses.

    Every row says that it is simulated. In a study with basins each observer sees one liquid, with
    cups both.

    Example: pourcast experiment simulate my-study --observers 65 --model water-ife
    """
    from pourcast.analysis.rehearsal import OBSERVERS, rehearse
    from pourcast.experiment.observers import SPREADS, Observers
    from pourcast.files import check_writable
    from pourcast.judgments import check_table_path

    scenes = _scenes_of(study)
    if out is not None:
        check_table_path(out)
        check_writable(out)
    basins = scenes[0].goal.kind == "basins"
    who = Observers(
        observers or OBSERVERS["exp1" if basins else "exp2"],
        {"water": model, "honey": honey_model},
        between=basins,
        population=_population(bias, slope, precision, lapse, granularity),
        spreads=_spreads(vary) if vary else dict(SPREADS),
        seed=seed,
    )
    with progress_bar() as report:
        path = rehearse(study, scenes, who, out, report)
    trials = len(scenes) * (1 if basins else 2)
    typer.echo(f"{path}: {who.count} simulated observers, {trials} trials each")


def _spreads(given: list[str]) -> dict[str, float]:
    found = {}
    for one in given:
        name, _, text = (part.strip() for part in one.partition("="))
        try:
            found[name] = float(text)
        except ValueError:
            raise InputError(f"vary: expected PARAMETER=SD, found {one!r}") from None
    return found


def _request(
    responses: Path | None,
    model: list[str] | None,
    percent: bool,
    exclude: list[str] | None,
    resample: Resampled,
    resamples: int,
    seed: int,
    carry_from: Path | None,
) -> "Request":
    from pourcast.analysis.agreement import Settings
    from pourcast.analysis.comparison import Request
    from pourcast.reproduce import read_choice

    return Request(
        responses=responses,
        models=tuple(model or ()),
        percent=percent,
        exclude=tuple(exclude or ()),
        settings=Settings(resample.value, resamples, seed=seed),
        carried=None if carry_from is None else read_choice(carry_from),
    )


@app.command()
def compare(
    study: StudyArgument,
    responses: ResponsesOption = None,
    model: ModelOption = None,
    percent: PercentOption = False,
    exclude: ExcludeOption = None,
    resample: ResampleOption = Resampled.PARTICIPANTS,
    resamples: ResamplesOption = 10_000,
    carry_from: CarryOption = None,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the tables (.csv).")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Compare models with people: correlations, intervals, reliability, differences, fits.

    Models that were not swept are simulated first. Without -m, the paper's presets.

    Example: pourcast compare my-study --exclude min-sd=0.05
    """
    from pourcast.analysis.comparison import compare_study
    from pourcast.judgments import write_table

    request = _request(responses, model, percent, exclude, resample, resamples, seed, carry_from)
    with progress_bar() as report:
        found = compare_study(study, request, report)
    if out is not None:
        for name, table in found.tables.items():
            write_table(out / f"{name}.csv", table)
    if as_json:
        tables = {name: _records(table) for name, table in found.tables.items()}
        print_json({"simulated": found.simulated, "remarks": found.remarks, "tables": tables})
        return
    _print_comparison(found)
    if out is not None:
        typer.echo(f"\n{out}: {len(found.tables)} tables")


def _records(table: "pd.DataFrame") -> Any:
    return json.loads(table.to_json(orient="records"))


_PRINTED = ("reliability", "chance", "agreement", "differences", "choice", "carried",
            "cross_validation", "variance", "variance_tests")  # fmt: skip
_MOST_ROWS = 24


def _print_comparison(found: "Comparison") -> None:
    from pourcast.analysis.comparison import TABLES
    from pourcast.report.display import readable

    if found.simulated:
        typer.echo("SIMULATED observers: this says nothing about people.\n")
    for one in found.exclusions:
        who = f", participants {', '.join(one.participants)}" if one.participants else ""
        typer.echo(f"excluded by {one.rule}: {one.trials} trials{who}")
    for remark in found.remarks:
        typer.echo(f"note: {remark}")
    for name in _PRINTED:
        if name not in found.tables:
            continue
        table = readable(found.tables[name])
        typer.echo(f"\n{TABLES[name]}")
        shown = table.head(_MOST_ROWS)
        print_table(shown.set_index(shown.columns[0]))
        if len(table) > len(shown):
            typer.echo(f"... {len(table)} rows in all; -o DIR writes them")


@app.command()
def report(
    study: StudyArgument,
    responses: ResponsesOption = None,
    model: ModelOption = None,
    percent: PercentOption = False,
    exclude: ExcludeOption = None,
    resample: ResampleOption = Resampled.PARTICIPANTS,
    resamples: ResamplesOption = 10_000,
    carry_from: CarryOption = None,
    films: Annotated[int, typer.Option(min=0, help="Scenes in the gallery.")] = 4,
    studies: Annotated[
        int, typer.Option(min=0, help="Simulated studies for recovery and power; 0 for none.")
    ] = 50,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder to write [STUDY/report].")
    ] = None,
    seed: SeedOption = 0,
) -> None:
    """Write a report: one HTML page that opens anywhere, with its figures and tables beside.

    Example: pourcast report my-study --exclude max-rt=60
    """
    from pourcast.analysis.comparison import compare_study
    from pourcast.files import check_writable
    from pourcast.report.page import Options, write_report

    folder = out or study / "report"
    request = _request(responses, model, percent, exclude, resample, resamples, seed, carry_from)
    _scenes_of(study)
    check_writable(folder / "report.html")
    with progress_bar() as bar:
        found = compare_study(study, request, bar)
        page = write_report(found, folder, Options(films=films, studies=studies), bar)
    _print_report(found, page)


def _print_report(found: "Comparison", page: Path) -> None:
    for remark in found.remarks:
        typer.echo(f"note: {remark}")
    said = " (SIMULATED observers)" if found.simulated else ""
    typer.echo(f"{page}: open it in a browser{said}")
    typer.echo(f"{page.parent / 'figures'}, {page.parent / 'tables'}: what is in it, as files")


@app.command()
def reproduce(
    experiment: Annotated[Experiment, typer.Argument(help="exp1: basins; exp2: cup.")],
    out: Annotated[
        Path, typer.Option("--output", "-o", help="Study folder to make, or go on with.")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="24 scenes, a small grid.")] = False,
    scenes: Annotated[
        int | None, typer.Option("-n", "--scenes", min=3, help="How many [120 or 60].")
    ] = None,
    responses: ResponsesOption = None,
    percent: PercentOption = False,
    exclude: ExcludeOption = None,
    carry_from: CarryOption = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes [all cores].")] = None,
    seed: SeedOption = 1,
) -> None:
    """Reproduce the paper's experiment, from nothing to a report beside the published values.

    Simulated observers answer, unless --responses gives people's. The same command goes on after
    an interruption.

    Example: pourcast reproduce exp1 --quick -o out
    """
    from pourcast.reproduce import Reproduction
    from pourcast.reproduce import reproduce as run

    wanted = Reproduction(
        experiment.value, quick, seed, scenes, responses, carry_from, tuple(exclude or ()), percent
    )
    with progress_bar() as bar:
        found, page = run(out, wanted, workers, bar)
    _print_report(found, page)


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
    bias: BiasOption = _BIAS,
    slope: SlopeOption = _SLOPE,
    precision: PrecisionOption = _PRECISION,
    lapse: LapseOption = _LAPSE,
    granularity: GranularityOption = _GRANULARITY,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the table and the figure.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Which parameters, or models, could this design have told apart? Plant each, and recover it.

    Example: pourcast recover parameters my-study -m water-ife -p damping_zeta
    """
    from pourcast.analysis import design
    from pourcast.analysis.judged import judge_in_study, read_judged
    from pourcast.model import presets, resolve_liquid
    from pourcast.report.figures.design import recovery

    scenes = _scenes_of(study)
    liquid = "honey" if honey else "water"
    population = _population(bias, slope, precision, lapse, granularity)
    common: dict[str, Any] = {
        "observers": observers, "studies": studies, "population": population, "seed": seed
    }  # fmt: skip
    with progress_bar() as bar:
        if what is Recovered.PARAMETERS:
            spec = (model or ["honey-ife-2" if honey else "water-ife"])[0]
            trial_liquid = resolve_liquid(liquid, scenes[0]).name
            values, judged = design.along(read_judged(study, scenes), trial_liquid, spec, parameter)
            table = design.parameter_recovery_table(
                values, judged, spread=spread, report=bar, **common
            )
            title = f"{spec}: {parameter}"
        else:
            specs = list(dict.fromkeys(model or presets()))
            if len(specs) < 2:
                raise InputError("model: expected at least two models to tell apart")
            found = judge_in_study(study, scenes, [(liquid, spec) for spec in specs], "compare")
            models = {spec: found[liquid, spec] for spec in specs}
            table = design.model_recovery_table(models, report=bar, **common)
            title = f"{liquid} trials: {observers} participants, {len(scenes)} scenes"
    if out is not None:
        _write_design(out, f"{what.value}_recovery", table.reset_index(), recovery(table, title))
    if as_json:
        print_json(_records(table.reset_index()))
        return
    typer.echo(f"{title}; {studies} simulated studies of {observers} observers each")
    shown = table.copy()
    shown.columns = [f"{name:g}" if isinstance(name, int | float) else str(name) for name in table]
    print_table(shown)
    if out is not None:
        typer.echo(f"{out}: table and figure")


def _write_design(folder: Path, name: str, table: "pd.DataFrame", figure: Any) -> None:
    from pourcast.judgments import write_table
    from pourcast.report.figures.style import save_figure

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
    bias: BiasOption = _BIAS,
    slope: SlopeOption = _SLOPE,
    precision: PrecisionOption = _PRECISION,
    lapse: LapseOption = _LAPSE,
    granularity: GranularityOption = _GRANULARITY,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the table and the figure.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """How many participants and scenes tell two models apart? The first is in people's heads.

    Example: pourcast power my-study -m water-ife -m water-marble --observers 10 --observers 30
    """
    from pourcast.analysis.design import power_table
    from pourcast.analysis.judged import judge_in_study
    from pourcast.report.figures import design as figures

    there = _scenes_of(study)
    specs = model or ["water-ife", "water-marble"]
    if len(set(specs)) != 2 or len(specs) != 2:
        raise InputError(f"model: expected two models to tell apart, found {len(specs)}")
    liquid = "honey" if honey else "water"
    population = _population(bias, slope, precision, lapse, granularity)
    with progress_bar() as bar:
        found = judge_in_study(study, there, [(liquid, spec) for spec in specs], "compare")
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
        print_json(_records(table))
        return
    typer.echo(f"{title}: {resample.value} resampled, {studies} simulated studies each")
    print_table(table.set_index("observers"))
    if out is not None:
        typer.echo(f"{out}: table and figure")
