"""What a report shows: figures with their captions, films, and what the design could tell apart."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import PAPER
from pourcast.comparison.compare import Comparison
from pourcast.comparison.design import Design, model_recovery_table, power_table
from pourcast.comparison.recovery import along, parameter_recovery_table
from pourcast.errors import InputError
from pourcast.pictures.show import show
from pourcast.prediction import predict
from pourcast.progress import Report
from pourcast.report.figures import design, fits, models, people, scenes
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.correlation import mean_judgments
from pourcast.statistics.jackknife import FEWEST, over_words
from pourcast.statistics.observer import Population
from pourcast.study.experiments.base import (
    observer_model,
    truth_of,
)
from pourcast.study.folder import study_liquids

POWER_OBSERVERS = (5, 10, 20, 40)
POWER_SCENES = (12, 30, 60, 120)

MOST_HISTOGRAMS = 4
"""Models whose answers are shown beside people's."""

CAPTIONS = {
    "stimuli": "Some of the scenes, as they are seen at first.",
    "against_null": "Participants' correlations with the ground truth, beside those of responses "
    "drawn from a beta distribution fitted to all responses; two-sample Kolmogorov-Smirnov test, "
    "and p of their mean with the scenes permuted.",
    "correlations": "Correlation of each model with people's mean judgments; lines: 95 % "
    "intervals; diamonds, if any: published values.",
    "best": "The best model of each family, {liquid} trials; a dot a scene.",
    "differences": "Who beats whom, {liquid} trials.",
    "predictive_checks": "Likelihood of single answers, {liquid} trials: share of answers in each "
    "tenth of the scale (bars), and of answers that the fitted response model makes for the same "
    "participants and scenes (line: mean; band: 95 % of data sets).",
    "zeta_profiles": "Correlation with people along the damping, other parameters as chosen; "
    "dots: the choice.",
    "alpha_zeta": "Correlation of the uncertain IFE with people by viscosity and damping; "
    "circle: the best.",
    "profiles": "Correlation of other fitted models with people along each parameter, at the best "
    "values of the others; dots: the choice.",
    "particle_engine": "The Intuitive Fluids Engine: smoothing kernel, and one moment with few "
    "particles and with many.",
    "heuristics": "Models without a liquid: paths of the gravity heuristic and of SimpleSim, "
    "blobs half-way, and marbles.",
    "model_recovery": "Model recovery, {liquid} trials: each model was planted in simulated "
    "observers, models that are fitted here with any of the values that were swept, and fitted "
    "anew to each study. Which one agrees best with them; and (told) how often the planted one "
    "does, and is told from all others as in the table of differences?",
    "power": "Power, {liquid} trials: chance that {first}, if it is in people's heads, is told "
    "from {second} as in the table of differences (over {over}, p < .05 for all pairs).{again}",
    "zeta_recovery": "Recovery of zeta, {liquid} trials: each damping of {first} was planted in "
    "simulated observers; which one fits them best?",
}


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the report.

    Parameters
    ----------
    name
        Its file, without extension.
    section
        Where it stands.
    caption
        What it shows.
    figure
        The figure.
    of_people
        Whether people's or observers' answers are in it.
    raster
        Whether the page holds the PNG rather than the SVG.
    table
        Numbers that it shows, if no other table has them.
    """

    name: str
    section: str
    caption: str
    figure: Figure
    of_people: bool = True
    raster: bool = False
    table: pd.DataFrame | None = None


@dataclass(frozen=True)
class Film:
    """A scene of the gallery."""

    scene: str
    liquid: str
    why: str
    models: tuple[str, ...]
    path: Path


def figures(comparison: Comparison) -> Iterator[ReportFigure]:
    """All figures of a comparison, in the order of the page."""
    tables, experiment = comparison.tables, comparison.experiment
    own = study_liquids(comparison.study)

    def drawn(
        name: str, section: str, figure: Figure, liquid: str = "", **more: Any
    ) -> ReportFigure:
        file = f"{name}_{liquid}" if liquid else name
        return ReportFigure(file, section, CAPTIONS[name].format(liquid=liquid), figure, **more)

    look: dict[str, Any] = {"of_people": False, "raster": True}
    yield drawn("stimuli", "stimuli", scenes.stimuli(comparison.scenes), **look)
    if comparison.individuals.against:
        yield drawn("against_null", "people", people.against_null(comparison.individuals, own))
    yield drawn("correlations", "models", models.correlations(tables["agreement"], experiment, own))
    for one in comparison.compared:
        short = called(one.trials.liquid)
        best = models.best_of_each_family(one)
        yield drawn("best", "models", models.scatter(one, best, own), short)
        if len(one.models) > 1:
            matrix = models.differences(tables["differences"], one.trials.liquid)
            yield drawn("differences", "models", matrix, short)
        if "predictive_tenths" in tables:
            histograms = models.answers_by_tenths(_best_predicted(tables, one.trials.liquid))
            yield drawn("predictive_checks", "models", histograms, short)
    if "choice" in tables:
        yield from _fits(tables["scores"], tables["choice"], drawn)
    example = comparison.scenes[0]
    liquids = tuple(called(one.trials.liquid) for one in comparison.compared)
    engine = scenes.particle_engine(example, liquids, own)
    yield drawn("particle_engine", "explained", engine, **look)
    yield drawn("heuristics", "explained", scenes.heuristics(example), **look)


def _best_predicted(tables: dict[str, pd.DataFrame], liquid: str) -> pd.DataFrame:
    """Histograms of the models that predict single answers of a liquid best."""
    rows = tables["predictive_tenths"]
    rows = rows[rows["liquid"] == liquid]
    ranked = tables.get("loo", rows)
    best = ranked.loc[ranked["liquid"] == liquid, "model"].drop_duplicates()[:MOST_HISTOGRAMS]
    return rows.set_index("model").loc[best].reset_index()


def _fits(
    scores: pd.DataFrame, choice: pd.DataFrame, drawn: Callable[..., ReportFigure]
) -> Iterator[ReportFigure]:
    """Figures of chosen parameters: the paper's models have theirs, any other its profiles."""
    if set(fits.DAMPED) & set(choice["model"]):
        yield drawn("zeta_profiles", "parameters", fits.zeta_profiles(scores, choice))
    if set(fits.WATER_IN_HEAD) & set(choice["model"]):
        yield drawn("alpha_zeta", "parameters", fits.alpha_zeta(scores))
    if not choice["model"].isin(PAPER).all():
        yield drawn("profiles", "parameters", fits.profiles(scores, choice))


def design_figures(comparison: Comparison, studies: int, tell: Report) -> Iterator[ReportFigure]:
    """What this design could have told apart, with observers as many as there were.

    Parameters
    ----------
    comparison
        From `comparison.compare.compare_study`.
    studies
        Simulated for each case.
    tell
        Told of the progress.
    """
    common: dict[str, Any] = {"studies": studies, "population": Population(), "report": tell}
    settings = comparison.settings
    for one in comparison.compared:
        if one.trials.participant_count == 0:
            continue  # As many observers as there were participants can't be simulated.
        if len(one.models) > 1:
            compared = Design.of(one, comparison.candidates)
            yield _model_recovery(one, compared, settings, common)
            yield from _power(one, compared, settings, common)
        yield from _zeta_recovery(one, comparison, common)


def _model_recovery(
    one: PeopleAndModels, compared: Design, settings: Settings, common: dict[str, Any]
) -> ReportFigure:
    short, count = called(one.trials.liquid), len(one.trials.participants)
    table = model_recovery_table(compared, observers=count, settings=settings, **common)
    title = f"{short} trials: {count} participants, {len(one.trials.scenes)} scenes"
    return ReportFigure(
        f"model_recovery_{short}", "design", CAPTIONS["model_recovery"].format(liquid=short),
        design.recovery(table, title), table=table.reset_index(),
    )  # fmt: skip


def _power(
    one: PeopleAndModels, compared: Design, settings: Settings, common: dict[str, Any]
) -> Iterator[ReportFigure]:
    best, short = models.best_of_each_family(one, 2), called(one.trials.liquid)
    if len(best) < 2:
        return
    people, scenes = one.trials.responses.shape
    table = power_table(
        compared, *best, settings=settings,
        observers=sorted({*POWER_OBSERVERS, max(FEWEST, people)}),
        scenes=sorted({*(n for n in POWER_SCENES if n <= 2 * scenes), max(FEWEST, scenes)}),
        **common,
    )  # fmt: skip
    again = f" Of more than {scenes} scenes some are drawn twice: that power is too high."
    caption = CAPTIONS["power"].format(
        liquid=short, first=best[0], second=best[1], over=over_words(settings.over),
        again=again if table["drawn_again"].any() else "",
    )  # fmt: skip
    figure = design.power(table, f"{best[0]} / {best[1]}")
    yield ReportFigure(f"power_{short}", "design", caption, figure, table=table)


def _zeta_recovery(
    one: PeopleAndModels, comparison: Comparison, common: dict[str, Any]
) -> Iterator[ReportFigure]:
    short = called(one.trials.liquid)
    spec = observer_model(comparison.experiment, short)
    there = comparison.judged.on(one.trials.scenes)
    try:
        values, judgments = along(there, one.trials.liquid, spec, "damping_zeta")
    except InputError:
        return  # No grid was swept; the page says so.
    table = parameter_recovery_table(
        values, judgments, observers=len(one.trials.participants), spread=0.0,
        seed=comparison.settings.seed, **common,
    )  # fmt: skip
    yield ReportFigure(
        f"zeta_recovery_{short}", "design",
        CAPTIONS["zeta_recovery"].format(liquid=short, first=spec),
        design.recovery(table, f"{spec}: zeta [1/s]"), table=table.reset_index(),
    )  # fmt: skip


# Films -------------------------------------------------------------------------------


def films(comparison: Comparison, folder: Path, count: int, tell: Report) -> list[Film]:
    """Film the scenes in which people and the truth, or the IFE and the truth, differ most.

    Parameters
    ----------
    comparison
        From `comparison.compare.compare_study`.
    folder
        Where the films go.
    count
        How many.
    tell
        Told of the progress.
    """
    by_id = {scene.id: scene for scene in comparison.scenes}
    own = study_liquids(comparison.study)
    made = []
    wanted = list(_disagreements(comparison, count).items())[:count]
    for liquid in dict.fromkeys(liquid for (_, liquid), _ in wanted):
        filmed = {scene: shown for (scene, name), (_, shown) in wanted if name == liquid}
        names = list(dict.fromkeys(name for shown in filmed.values() for name in shown))
        # All together here; `show` then finds them poured.
        predict(
            [by_id[scene] for scene in filmed], names, liquid, own=own, record=names,
            report=lambda _, done, total: tell("simulating films", done, total),
        )  # fmt: skip
    for done, ((scene, liquid), (why, shown)) in enumerate(wanted):
        tell(f"filming {scene}", done, len(wanted))
        path = folder / f"{scene}-{called(liquid)}.mp4"
        show(by_id[scene], path, shown, liquid, own=own)
        made.append(Film(scene, called(liquid), why, shown, path))
    return made


def _filmed_models(comparison: Comparison, one: PeopleAndModels) -> tuple[str, str]:
    """Names of the model in people's heads, as it may be, and of the truth of some trials."""
    liquid = called(one.trials.liquid)
    model = observer_model(comparison.experiment, liquid)
    return model, one.truth_name or truth_of(comparison.experiment, liquid)


def why_no_films(comparison: Comparison) -> str:
    """Which models of the films are not compared; empty if none is missing for all liquids."""
    missing = [
        [name for name in _filmed_models(comparison, one) if name not in one.models]
        for one in comparison.compared
    ]
    if not all(missing):
        return ""
    names = dict.fromkeys(name for some in missing for name in some)
    return f"they show {' and '.join(names)}, which was not compared"


def _disagreements(
    comparison: Comparison, count: int
) -> dict[tuple[str, str], tuple[str, tuple[str, str]]]:
    """(Scene, liquid) -> why it is shown, and the two models that are filmed."""
    found: dict[tuple[str, str], tuple[str, tuple[str, str]]] = {}
    said = "simulated observers" if comparison.simulated else "people"
    each = -(-count // (2 * len(comparison.compared)))
    for one in comparison.compared:
        liquid = one.trials.liquid
        ife, truth = _filmed_models(comparison, one)
        if {ife, truth} - set(one.models):
            continue
        mean, right, imagined = (
            mean_judgments(one.trials.responses), one.models[truth], one.models[ife]
        )  # fmt: skip
        for label, gap in ((said, mean - right), (ife, imagined - right)):
            ranked = [one.trials.scenes[k].id for k in np.argsort(-np.abs(gap), kind="stable")]
            for scene in [name for name in ranked if (name, liquid) not in found][:each]:
                k = next(k for k, other in enumerate(one.trials.scenes) if other.id == scene)
                why = (
                    f"{label} and {truth} differ most: {said} {mean[k]:.2f}, {ife} "
                    f"{imagined[k]:.2f}, {truth} {right[k]:.2f}"
                )
                found[scene, liquid] = why, (truth, ife)
    return found
