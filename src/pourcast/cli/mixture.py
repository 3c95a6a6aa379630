"""Command that says which model is in each participant's head: mixture."""

from pathlib import Path
from typing import Annotated

import typer

from pourcast.cli.app import app
from pourcast.cli.compare import (
    ColumnsOption,
    ExcludeOption,
    ResponsesOption,
    ScaleOption,
    options_of,
    print_about,
    print_by_liquid,
)
from pourcast.cli.options import JsonOption, ModelOption, SeedOption, StudyArgument
from pourcast.cli.terminal import print_json, progress_bar, records


@app.command()
def mixture(
    study: StudyArgument,
    responses: ResponsesOption = None,
    model: ModelOption = None,
    columns: ColumnsOption = None,
    scale: ScaleOption = None,
    exclude: ExcludeOption = None,
    draws: Annotated[
        int, typer.Option(min=50, help="Of each of four chains, after half as many to adapt.")
    ] = 800,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for the tables (.csv), figures.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Which model is in each head, with which parameters? Models' shares among people.

    Of what was swept (NAME:fitted) every setting may be in a head; without -m all that was swept,
    and gravity. A minute or so; needs the extra bayes.

    Example: pourcast mixture my-study -m water-ife:fitted -m water-simple:fitted -o heads
    """
    from pourcast.comparison.mixture import TABLES, study_mixture
    from pourcast.extras import require_extra
    from pourcast.files import check_writable
    from pourcast.pictures.style import save_figure
    from pourcast.report.figures.people import heads
    from pourcast.tables import marked, write_tables

    require_extra("bayes")
    from pourcast.statistics.sampling import Sampling

    if out is not None:
        check_writable(out / "shares.csv")
    options = options_of(responses, model, columns, scale, exclude, seed=seed)
    sampling = Sampling(warmup=draws // 2, draws=draws, seed=seed)
    with progress_bar() as report:
        found = study_mixture(study, options, sampling, report)
    if out is not None:
        write_tables(out, marked(found.tables, simulated=found.simulated))
        figure = heads(found.tables["people"])
        save_figure(figure, out / "people", simulated=found.simulated)
    if as_json:
        tables = {name: records(table) for name, table in found.tables.items()}
        print_json({"simulated": found.simulated, "remarks": found.remarks, "tables": tables})
        return
    print_about(found.simulated, (), found.exclusions, found.remarks)
    for name in ("shares", "population"):
        typer.echo(f"\n{TABLES[name]}")
        table = found.tables[name]
        print_by_liquid(table, [str(column) for column in table if column != "liquid"])
    if out is not None:
        typer.echo(f"\n{out}: single participants and their parameters, too")
