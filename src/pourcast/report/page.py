"""The report: figures, tables, methods and provenance of a comparison, in one HTML file."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

from pourcast.comparison.compare import TABLES, Comparison
from pourcast.files import write_text
from pourcast.pictures.style import save_figure
from pourcast.progress import Report, no_report
from pourcast.report import contents
from pourcast.report.contents import Film, ReportFigure
from pourcast.report.display import readable
from pourcast.report.methods import methods, provenance
from pourcast.report.numbers import how_drawn
from pourcast.scenes.liquids.registry import called, colour_of
from pourcast.statistics.correlation import mean_judgments
from pourcast.study.chosen import read_chosen
from pourcast.study.experiments.base import Experiment, published_with_people
from pourcast.study.folder import study_liquids
from pourcast.tables import marked, write_table, write_tables

ONLY_IN_FILES = ("scores", "judgments", "participants", "predictive_tenths")
"""Tables too long for the page, or shown as a figure; they lie in `tables/`."""

_TOO_WIDE = {"choice": ["candidates", "paper"]}
"""Columns of tables that have no room on the page; they are in `tables/`."""

_FOLDED = 60
"""Tables with more rows are folded up at first."""

_KINDS = {".png": "image/png", ".svg": "image/svg+xml", ".mp4": "video/mp4"}


@dataclass(frozen=True)
class Options:
    """What the report is to hold.

    Parameters
    ----------
    films
        Scenes in the gallery, each with an animation.
    studies
        Simulated studies for each cell of the recovery and power figures; 0 for none.
    """

    films: int = 4
    studies: int = 50


def write_report(
    comparison: Comparison,
    folder: Path,
    options: Options | None = None,
    report: Report = no_report,
) -> Path:
    """Write figures, tables and the page.

    Parameters
    ----------
    comparison
        From `comparison.compare.compare_study`.
    folder
        Where to: `report.html`, `results.json`, `figures/`, `films/`, `tables/`.
    options
        What it is to hold.
    report
        Told of the progress.

    Returns
    -------
    Path
        The page.
    """
    options, tell = options or Options(), report
    figures = list(contents.figures(comparison))
    if options.studies:
        figures += contents.design_figures(comparison, options.studies, tell)
    for done, shown in enumerate(figures):
        tell(f"drawing {shown.name}", done, len(figures))
        # Recovery and power are made of simulated observers, whoever took part.
        simulated = shown.section == "design" or (comparison.simulated and shown.of_people)
        save_figure(shown.figure, folder / "figures" / shown.name, simulated=simulated)
    films = contents.films(comparison, folder / "films", options.films, tell)
    write_tables(folder / "tables", marked(comparison.tables, simulated=comparison.simulated))
    for shown in figures:
        if shown.table is not None:
            flagged = shown.table.rename(columns=str).assign(simulated=True)
            write_table(folder / "tables" / f"{shown.name}.csv", flagged)
    write_text(folder / "results.json", results_json(comparison))
    page = folder / "report.html"
    write_text(page, _render(comparison, figures, films, folder))
    return page


def results_json(comparison: Comparison) -> str:
    """Everything that the tables say, and what they were made from, for programs."""
    tables = {
        name: json.loads(table.to_json(orient="records", double_precision=15))
        for name, table in comparison.tables.items()
        if name not in ONLY_IN_FILES
    }
    content = {
        "simulated": comparison.simulated,
        "over": comparison.settings.over,
        "level": comparison.settings.level,
        "answers": comparison.answers,
        "remarks": list(comparison.remarks),
        "tables": tables,
        "provenance": dict(provenance(comparison)),
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _render(
    comparison: Comparison, figures: Sequence[ReportFigure], films: Sequence[Film], folder: Path
) -> str:
    environment = Environment(
        loader=PackageLoader("pourcast.report", "templates"), autoescape=True,
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["data_uri"] = data_uri
    script = files("pourcast.report").joinpath("templates", "explore.js").read_text("utf-8")
    experiment, chosen = comparison.experiment, read_chosen(comparison.study)
    tables = {
        name: _as_shown(name, with_published(table, experiment) if name == "agreement" else table)
        for name, table in comparison.tables.items()
        if name not in ONLY_IN_FILES
    }
    return environment.get_template("report.html").render(
        comparison=comparison,
        chosen=chosen,
        how_drawn=how_drawn(chosen) if chosen else [],
        experiment=(experiment.heading or experiment.name) if experiment else "own scenes",
        tables=tables,
        figures=[
            (one, folder / "figures" / f"{one.name}{'.png' if one.raster else '.svg'}")
            for one in figures
        ],
        films=films,
        why_no_films=contents.why_no_films(comparison),
        methods=methods(comparison),
        provenance=provenance(comparison),
        explore=_safe_json(_explorable(comparison)),
        script=script,
    )


def data_uri(path: Path) -> str:
    """A file's content as an address, so that the page needs no other file."""
    content = base64.b64encode(path.read_bytes()).decode()
    return f"data:{_KINDS[path.suffix]};base64,{content}"


def with_published(agreement: pd.DataFrame, experiment: Experiment | None) -> pd.DataFrame:
    """The agreement table with the published correlations beside, as far as there are any."""
    known = [
        published_with_people(experiment, called(liquid)).get(model)
        for liquid, model in zip(agreement["liquid"], agreement["model"], strict=True)
    ]
    if not any(known):
        return agreement
    rows = [(np.nan, np.nan, np.nan) if one is None else tuple(one) for one in known]
    names = ["published_r", "published_r_low", "published_r_high"]
    beside = pd.DataFrame(rows, index=agreement.index, columns=names)
    place = list(agreement.columns).index("rmse")
    return pd.concat([agreement.iloc[:, :place], beside, agreement.iloc[:, place:]], axis=1)


def _as_shown(name: str, table: pd.DataFrame) -> dict[str, Any]:
    text = readable(table.drop(columns=_TOO_WIDE.get(name, []), errors="ignore"))
    return {
        "title": TABLES[name],
        "columns": list(text.columns),
        "rows": [[_unbroken(cell) for cell in row] for row in text.to_numpy()],
        "long": len(text) > _FOLDED,
    }


def _unbroken(cell: str) -> str:
    """A number and its interval, kept on one line."""
    return cell.replace(" ", "\u00a0") if cell.endswith("]") else cell


def _safe_json(content: Mapping[str, Any]) -> str:
    """JSON that may stand inside a script element."""
    return json.dumps(content, allow_nan=False).replace("<", "\\u003c")


def _explorable(comparison: Comparison) -> dict[str, Any]:
    """What the interactive scatter plot needs."""
    own = study_liquids(comparison.study)
    return {
        "liquids": [
            {
                "liquid": called(one.trials.liquid),
                "colour": colour_of(one.trials.liquid, own),
                "scenes": [scene.id for scene in one.trials.scenes],
                "people": _rounded(mean_judgments(one.trials.responses)),
                "models": {name: _rounded(values) for name, values in one.models.items()},
            }
            for one in comparison.compared
        ],
        "scenes": {
            scene.id: {
                "width": scene.box.width,
                "height": scene.box.height,
                "obstacles": scene.obstacles,
                "goal": scene.goal.solids,
                "liquid": [*scene.liquid.centre, scene.liquid.diameter / 2],
            }
            for scene in comparison.scenes
        },
        "people": "simulated observers" if comparison.simulated else "people",
    }


def _rounded(values: Any) -> list[float]:
    return [round(float(value), 4) for value in values]
