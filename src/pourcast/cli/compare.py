"""Commands that compare models with people: compare, report, reproduce."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pourcast.cli.app import app
from pourcast.cli.options import (
    JsonOption,
    ModelOption,
    Over,
    OverOption,
    SeedOption,
    StudyArgument,
    WorkersOption,
)
from pourcast.cli.scenes import ExperimentArgument
from pourcast.cli.terminal import (
    print_json,
    print_table,
    progress_bar,
    records,
    resumable,
)
from pourcast.study.programs import SHORT

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from pourcast.comparison.compare import Comparison
    from pourcast.comparison.matching import ComparisonOptions
    from pourcast.study.responses import Exclusion

ResponsesOption = Annotated[
    Path | None,
    typer.Option(
        "--responses", metavar="FILE",
        help="Responses (.csv, .parquet, or a folder of them) [the study's].",
    ),
]  # fmt: skip
ColumnsOption = Annotated[
    str | None,
    typer.Option(
        "--columns", metavar="FILE|NAME=COLUMN,...",
        help="Which column of a table is what: a .toml file [columns.toml or NAME.toml beside "
        "it], or such as participant=PID,response=slider.response,liquid:water.",
    ),
]  # fmt: skip
ScaleOption = Annotated[
    str | None,
    typer.Option(
        metavar="LOW-HIGH", help="Scale of a table's responses, such as 0-100 or -1..1 [0-1]."
    ),
]
ExcludeOption = Annotated[
    list[str] | None,
    typer.Option(
        "--exclude", metavar="RULE",
        help="min-sd=0.05, min-trials=N, min-attention=SHARE, min-rt=S, max-rt=S, "
        "participant=NAME, repeats=first; several, in their order.",
    ),
]  # fmt: skip
CarryOption = Annotated[
    Path | None,
    typer.Option("--carry-from", metavar="STUDY", help="Carry over the parameters chosen there."),
]
BayesOption = Annotated[
    bool,
    typer.Option("--bayes", help="Also the likelihood of single answers, a mixed model; minutes."),
]


_TABLES = "\n\n".join(
    [
        "Tables of other programs, by --columns (a file says more, and keeps it):",
        *(f"{program}: {columns}" for program, columns in SHORT.items()),
    ]
)


def options_of(
    responses: Path | None,
    model: list[str] | None,
    columns: str | None,
    scale: str | None,
    exclude: list[str] | None,
    over: Over = Over.BOTH,
    seed: int = 0,
    carry_from: Path | None = None,
    bayes: bool = False,
) -> "ComparisonOptions":
    """What is to be compared, from what the user said."""
    from pourcast.comparison.agreement import Settings
    from pourcast.comparison.choice import read_choice
    from pourcast.comparison.matching import ComparisonOptions
    from pourcast.study.scale import scale_of

    return ComparisonOptions(
        responses=responses,
        models=tuple(model or ()),
        columns=columns,
        scale=None if scale is None else scale_of(scale),
        exclude=tuple(exclude or ()),
        settings=Settings(over.value, seed=seed),
        carried=None if carry_from is None else read_choice(carry_from),
        bayes=bayes,
    )


@app.command(epilog=_TABLES)
def compare(
    study: StudyArgument,
    responses: ResponsesOption = None,
    model: ModelOption = None,
    columns: ColumnsOption = None,
    scale: ScaleOption = None,
    exclude: ExcludeOption = None,
    over: OverOption = Over.BOTH,
    carry_from: CarryOption = None,
    bayes: BayesOption = False,
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
    from pourcast.comparison.compare import compare_study
    from pourcast.files import check_writable
    from pourcast.tables import marked, write_tables

    if out is not None:
        check_writable(out / "agreement.csv")
    options = options_of(responses, model, columns, scale, exclude, over, seed, carry_from, bayes)
    with progress_bar() as report:
        found = compare_study(study, options, report)
    tables = marked(found.tables, simulated=found.simulated)
    if out is not None:
        write_tables(out, tables)
    if as_json:
        rows = {name: records(table) for name, table in tables.items()}
        print_json(
            {
                "simulated": found.simulated,
                "answers": found.answers,
                "remarks": found.remarks,
                "tables": rows,
            }
        )
        return
    _print_comparison(found)
    if out is not None:
        typer.echo(f"\n{out}: {len(found.tables)} tables")


_PRINTED = {
    "reliability": ("liquid", "participants", "scenes", "split_half", "spearman_brown", "ceiling"),
    "retest": ("liquid", "participants", "repeated", "retest_r", "noise"),
    "chance": ("liquid", "mean_r", "beat_chance", "participants", "permutation_p", "ks_p"),
    "agreement": ("model", "r", "rmse", "bias"),
    "differences": ("model", "rival", "difference", "p_holm", "equivalent_within"),
    "choice": ("model", "liquid", "r", "r_paper"),
    "carried": ("model", "r", "r_where_fitted"),
    "cross_validation": ("model", "liquid", "in_sample", "train", "test", "optimism"),
    "loo": ("model", "unit", "elpd", "elpd_diff", "dse", "told", "refitted"),
    "liquid_effect": ("model", "liquid", "other", "sensitivity", "probability", "relative"),
    "variance": ("model", "variance"),
    "variance_tests": ("model", "rival", "t", "df", "p"),
}
"""Columns that fit a terminal; the files and the report have them all."""

_MOST_ROWS = 12
"""Of a liquid's differences, the largest are told."""


def print_about(
    simulated: bool,
    answers: "Sequence[str]",
    exclusions: "Sequence[Exclusion]",
    remarks: "Sequence[str]",
) -> None:
    """What stands above the tables: whose responses, the answer, and what is to be known."""
    if simulated:
        typer.echo("SIMULATED observers: this says nothing about people.\n")
    for answer in answers:
        typer.echo(answer)
    for one in exclusions:
        who = f", participants {', '.join(one.participants)}" if one.participants else ""
        typer.echo(f"excluded by {one.rule}: {one.trials} trials{who}")
    for remark in remarks:
        typer.echo(f"note: {remark}")


def _print_comparison(found: "Comparison") -> None:
    from pourcast.comparison.compare import TABLES
    from pourcast.statistics.jackknife import over_words

    print_about(found.simulated, found.answers, found.exclusions, found.remarks)
    for name, columns in _PRINTED.items():
        if name not in found.tables:
            continue
        table = found.tables[name]
        said = f"; over {over_words(table['over'].iloc[0])}" if "over" in table else ""
        typer.echo(f"\n{TABLES[name]}{said}")
        if "liquid" not in table or "liquid" in columns:
            _print_columns(table, (*columns, *_parameters(table)))
        else:
            print_by_liquid(table, columns)
    if "choice" in found.tables:
        _print_flat(found.tables["choice"])


def print_by_liquid(table: "pd.DataFrame", columns: "Sequence[str]") -> None:
    """Some columns of a table, for each liquid by itself."""
    for liquid, rows in table.groupby("liquid", sort=False):
        typer.echo(f"{liquid} trials:")
        _print_columns(rows, columns)


def _parameters(table: "pd.DataFrame") -> list[str]:
    """Columns of chosen parameters, if there are any."""
    names = list(table.columns)
    return names[names.index("liquid") + 1 : names.index("fitted")] if "fitted" in names else []


def _print_columns(table: "pd.DataFrame", columns: "Sequence[str]") -> None:
    from pourcast.report.display import readable

    if "difference" in table and len(table) > _MOST_ROWS:
        largest = table["difference"].abs().nlargest(_MOST_ROWS).index
        typer.echo(f"(the {_MOST_ROWS} largest of {len(table)}; -o DIR writes all)")
        table = table.loc[largest]
    limits = ("low", "high", *(f"{name}_{end}" for name in columns for end in ("low", "high")))
    kept = [name for name in table.columns if name in columns or name in limits]
    shown = readable(table[kept])
    print_table(shown.set_index(shown.columns[0]))


def _print_flat(choice: "pd.DataFrame") -> None:
    """Values that do as well as the chosen ones: an optimum may be flat."""
    typer.echo("\nNot told from the chosen values:")
    columns = (choice[name] for name in ("model", "liquid", "flat", "ties"))
    for model, liquid, flat, ties in zip(*columns, strict=True):
        equals = f"; {ties} candidates with the very same r" if ties else ""
        if flat:
            typer.echo(f"  {model} ({liquid} trials): {flat}{equals}")


@app.command()
def report(
    study: StudyArgument,
    responses: ResponsesOption = None,
    model: ModelOption = None,
    columns: ColumnsOption = None,
    scale: ScaleOption = None,
    exclude: ExcludeOption = None,
    over: OverOption = Over.BOTH,
    carry_from: CarryOption = None,
    bayes: BayesOption = False,
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
    from pourcast.comparison.compare import compare_study
    from pourcast.files import check_writable
    from pourcast.report.page import Options, write_report
    from pourcast.study.folder import study_scenes

    folder = out or study / "report"
    options = options_of(responses, model, columns, scale, exclude, over, seed, carry_from, bayes)
    study_scenes(study)
    check_writable(folder / "report.html")
    with progress_bar() as bar:
        found = compare_study(study, options, bar)
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
    experiment: ExperimentArgument,
    out: Annotated[
        Path, typer.Option("--output", "-o", help="Study folder to make, or go on with.")
    ],
    quick: Annotated[bool, typer.Option("--quick", help="24 scenes, a small grid.")] = False,
    scenes: Annotated[
        int | None, typer.Option("-n", "--scenes", min=3, help="How many [as the experiment has].")
    ] = None,
    responses: ResponsesOption = None,
    columns: ColumnsOption = None,
    scale: ScaleOption = None,
    exclude: ExcludeOption = None,
    carry_from: CarryOption = None,
    with_convnet: Annotated[
        bool, typer.Option("--with-convnet", help="Train networks, too (extra convnet; longer).")
    ] = False,
    convnet_scenes: Annotated[
        int | None, typer.Option(min=1, help="Their training scenes [10000, quick 500].")
    ] = None,
    workers: WorkersOption = None,
    seed: SeedOption = 1,
) -> None:
    """Reproduce an experiment, from nothing to a report beside the published values.

    Simulated observers answer, unless --responses gives people's. The same command goes on after
    an interruption.

    Example: pourcast reproduce exp1 --quick -o out
    """
    from pourcast.report.reproduction import Reproduction
    from pourcast.report.reproduction import reproduce as run
    from pourcast.study.scale import scale_of

    wanted = Reproduction(
        experiment, quick, seed, scenes, responses, carry_from, tuple(exclude or ()),
        None if scale is None else scale_of(scale), columns, with_convnet, convnet_scenes,
    )  # fmt: skip
    with resumable(out), progress_bar() as bar:
        found, page = run(out, wanted, workers, bar)
    _print_report(found, page)
