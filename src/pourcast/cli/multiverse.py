"""Command that analyses a study in every way that could be defended: multiverse."""

from pathlib import Path
from typing import Annotated

import typer

from pourcast.cli.app import app
from pourcast.cli.compare import (
    BayesOption,
    ColumnsOption,
    ResponsesOption,
    ScaleOption,
    options_of,
    print_about,
    print_by_liquid,
)
from pourcast.cli.options import JsonOption, ModelOption, SeedOption, StudyArgument
from pourcast.cli.terminal import print_json, progress_bar, records


@app.command()
def multiverse(
    study: StudyArgument,
    claim: Annotated[
        str | None,
        typer.Option(metavar="MODEL", help="Claimed to be nearest to people [the one that is]."),
    ] = None,
    responses: ResponsesOption = None,
    model: ModelOption = None,
    columns: ColumnsOption = None,
    scale: ScaleOption = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option(
            "--exclude",
            metavar="RULE",
            help="Tried with and without all others; as for compare [the usual ones].",
        ),
    ] = None,
    bayes: BayesOption = False,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the tables (.csv), figure.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Does the conclusion stand, however the data are analysed? All ways at once, in one figure.

    Exclusions x measure (r, RMSE, with --bayes the likelihood) x what a conclusion holds over;
    participants beside chance by each ground truth that is compared.

    Example: pourcast multiverse my-study --exclude min-sd=0.1 --exclude max-rt=30 -o multiverse
    """
    from pourcast.comparison.multiverse import TABLES, study_multiverse
    from pourcast.files import check_writable
    from pourcast.pictures.style import save_figure
    from pourcast.report.figures import multiverse as figures
    from pourcast.tables import marked, write_tables

    if out is not None:
        check_writable(out / "findings.csv")
    options = options_of(responses, model, columns, scale, exclude, seed=seed, bayes=bayes)
    with progress_bar() as report:
        found = study_multiverse(study, options, claim or "", report)
    if out is not None:
        write_tables(out, marked(found.tables, simulated=found.simulated))
        figure = figures.multiverse(found.tables, options.settings.level)
        save_figure(figure, out / "multiverse", simulated=found.simulated)
    if as_json:
        tables = {name: records(table) for name, table in found.tables.items()}
        print_json(
            {
                "simulated": found.simulated,
                "answers": found.answers,
                "remarks": found.remarks,
                "tables": tables,
            }
        )
        return
    print_about(found.simulated, found.answers, (), found.remarks)
    for name in ("choices", "chance"):
        if name in found.tables:
            typer.echo(f"\n{TABLES[name]}")
            print_by_liquid(found.tables[name], _PRINTED[name])
    if out is not None:
        typer.echo(f"\n{out}: every analysis, and the figure")


_PRINTED = {
    "choices": ("choice", "option", "analyses", "nearest", "told_from"),
    "chance": ("exclusions", "truth", "mean_r", "beat_chance", "participants", "permutation_p"),
}
"""Columns that fit a terminal; the files have them all."""
