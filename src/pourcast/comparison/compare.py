"""A study's people and models, compared: everything that `compare` prints and `report` shows."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from pourcast.comparison import (
    agreement,
    choice,
    liquid_effect,
    posterior_checks,
    window,
)
from pourcast.comparison.agreement import Individuals, PeopleAndModels, Settings
from pourcast.comparison.answer import answers
from pourcast.comparison.candidates import Candidates, is_fitted, not_fitted
from pourcast.comparison.matching import ComparisonOptions, match_study
from pourcast.comparison.retest import retest_table, unknown_retest
from pourcast.files import finished_files
from pourcast.models.base import averages_pours, typical_pour
from pourcast.models.registry import make_model
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.statistics.sampling import Sampling
from pourcast.study.experiments.base import Experiment
from pourcast.study.folder import study_scenes
from pourcast.study.responses import Exclusion
from pourcast.sweep.judgments import (
    Judgments,
    LiquidAndModel,
)


@dataclass(frozen=True)
class Comparison:
    """People and models, compared.

    Parameters
    ----------
    study
        The study folder.
    experiment
        What it was made from; None for scenes that ask what no experiment asks.
    scenes
        Its scenes.
    source
        File of the responses, or their folder, and its SHA-256.
    columns
        What mapped its columns: a file, or a text; empty if nothing did.
    simulated
        Whether any of the responses are simulated.
    settings
        How intervals are made.
    compared
        People and models, one for each liquid.
    judged
        All judgments that were swept.
    candidates
        What parameters were chosen from; see `candidates.candidates`.
    pours
        Of each model that averages pours, the typical one, in a scene of each kind.
    exclusions, remarks
        What was taken out, and what else a reader should know of the data.
    individuals
        Single participants against chance.
    tables
        Name -> table; see `TABLES`.
    """

    study: Path
    experiment: Experiment | None
    scenes: tuple[Scene, ...]
    source: tuple[Path, str]
    columns: str
    simulated: bool
    settings: Settings
    compared: tuple[PeopleAndModels, ...]
    judged: Judgments
    candidates: Mapping[str, Candidates]
    pours: tuple[Pour, ...]
    exclusions: tuple[Exclusion, ...]
    remarks: tuple[str, ...]
    individuals: Individuals
    tables: dict[str, pd.DataFrame]

    @property
    def answers(self) -> list[str]:
        """Which model is nearest to people, and how sure that is; a line a liquid."""
        return answers(self.tables, self.settings.level)


TABLES = {
    "agreement": "Agreement of each model with people's mean judgments",
    "intervals": "Correlations, with intervals over participants, scenes, and both",
    "differences": "Differences in r between models, on the same people and scenes",
    "reliability": "Reliability of people's mean judgments, and the noise ceiling",
    "retest": "Within-person reliability: first and second answers to the same scenes",
    "chance": "Single participants against chance",
    "participants": "Participants",
    "choice": "Parameters chosen on these responses (r is in sample; that of NAME:fitted is not)",
    "cross_validation": "Parameters chosen on half of the scenes, scored on the other half",
    "carried": "Parameters chosen in another experiment, carried over unchanged",
    "loo": "Likelihood of single answers: models by leave-one-out, the best first",
    "loo_differences": "Likelihood of single answers: which model is told from which",
    "liquid_effect": "People's sensitivity to what models say that the liquid changes",
    "posterior": "Likelihood of single answers: parameters of the response model, with intervals",
    "predictive_checks": "Likelihood of single answers: what people answer, beside what the fitted "
    "response model answers in their place (posterior predictive checks)",
    "predictive_tenths": "Likelihood of single answers: share of answers in each tenth of the "
    "scale, beside those of the fitted response model",
    "variance": "Variance of deterministic judgments over the window of dampings",
    "variance_tests": "Unpaired t-tests between these variances",
    "scores": "Correlation of every swept candidate",
    "judgments": "People's means and models' judgments, scene by scene",
}
"""Tables of a comparison, and what they say; those that the data can't fill are left out."""


def compare_study(
    study: Path, options: ComparisonOptions, report: Report = no_report
) -> Comparison:
    """Compare a study's models with people.

    Judgments that are not there yet are simulated, through the study's store.

    Parameters
    ----------
    study
        The study folder.
    options
        What is to be compared.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study, the responses or a model is wrong; names file, row and column.
    StoreError
        If judgments could not be made.
    """
    scenes, settings = study_scenes(study), options.settings
    found = match_study(study, options, report)
    read, people = found.read, found.people
    report("comparing: single participants", 0, 1)
    individuals = agreement.individuals(people, settings)
    tables = _tables(people, found.judged, found.candidates, settings, individuals, report)
    if options.bayes:
        tables |= _bayes(people, found.experiment, settings, report)
    if options.carried is not None:
        tables["carried"] = choice.carried_table(found.carried, options.carried, settings)
    return Comparison(
        study=study,
        experiment=found.experiment,
        scenes=tuple(scenes),
        source=(read.path, _digest(read.path)),
        columns=read.columns,
        simulated=read.simulated,
        settings=settings,
        compared=people,
        judged=found.judged,
        candidates=found.candidates,
        pours=tuple(_pours(scenes, found.wanted, found.own)),
        exclusions=read.exclusions,
        remarks=(
            *read.told,
            *_models_remarks(found.specs, found.labels, found.own),
            *_fitted_remarks(people),
            *not_fitted(found.fitted, {one.trials.liquid: one.names for one in people}),
            *read.remarks,
            *_doubts(tables, found.judged, people, individuals, settings),
            *posterior_checks.doubts_of_posteriors(tables, people, found.experiment),
        ),
        individuals=individuals,
        tables={name: tables[name] for name in TABLES if len(tables.get(name, ()))},
    )


def _digest(path: Path) -> str:
    """SHA-256 of a file; of a folder, that of its files' one after another."""
    if not path.is_dir():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    each = (hashlib.sha256(file.read_bytes()).digest() for file in finished_files(path))
    return hashlib.sha256(b"".join(each)).hexdigest()


def _fitted_remarks(people: Sequence[PeopleAndModels]) -> list[str]:
    """What it means that a model's parameters were chosen on these responses."""
    fitted = [name for one in people for name in one.names if is_fitted(name)]
    if not fitted:
        return []
    return [
        f"{', '.join(dict.fromkeys(fitted))}: each half of the scenes is judged with parameters "
        "that were chosen on the other half, so that r, intervals and tests are not flattered by "
        f"the choice (of {choice.FITTED_HALVINGS} random halvings, drawn by --seed, the one of "
        "median r; another seed may yet tell what is on the edge); their RMSE, bias and slope are "
        "those of both halves at one level and spread"
    ]


def _tables(
    people: Sequence[PeopleAndModels],
    judged: Judgments,
    sets: Mapping[str, Candidates],
    settings: Settings,
    individuals: Individuals,
    report: Report,
) -> dict[str, pd.DataFrame]:
    trials = [one.trials for one in people]
    variances = window.window_variances(judged, trials[0].liquid, settings)
    steps: dict[str, Callable[[], pd.DataFrame]] = {
        "agreement": lambda: _stacked(agreement.agreement_table, people, settings),
        "intervals": lambda: _stacked(agreement.intervals_table, people, settings),
        "differences": lambda: _stacked(agreement.differences_table, people, settings),
        "reliability": lambda: agreement.reliability_table(trials, settings),
        "retest": lambda: retest_table(trials, settings),
        "chance": individuals.summary,
        "participants": lambda: individuals.table,
        "choice": lambda: choice.choice_table(sets, settings),
        "cross_validation": lambda: choice.cross_validation_table(sets, settings),
        "variance": lambda: window.variance_table(variances),
        "variance_tests": lambda: window.variance_tests(variances),
        "scores": lambda: choice.scores_table(sets),
        "judgments": lambda: agreement.people_table(people),
    }
    tables = {}
    for done, (name, make) in enumerate(steps.items()):
        report(f"comparing: {name}", done, len(steps))
        tables[name] = make()
    return tables


def _bayes(
    people: Sequence[PeopleAndModels],
    experiment: Experiment | None,
    settings: Settings,
    report: Report,
) -> dict[str, pd.DataFrame]:
    """Models compared by the likelihood of single answers, for each liquid."""
    # JAX is loaded only for this.
    from pourcast.statistics.loo import compare_models  # noqa: PLC0415

    parts: dict[str, list[pd.DataFrame]] = {
        "loo": [], "loo_differences": [], "posterior": [], "predictive_checks": [],
        "predictive_tenths": [],
    }  # fmt: skip
    for one in people:
        fit = compare_models(
            one.trials.responses, one.models, Sampling(seed=settings.seed), report,
            level=settings.level,
        )  # fmt: skip
        found = (fit.loo, fit.differences, fit.parameters, fit.checks, fit.tenths)
        for part, table in zip(parts.values(), found, strict=True):
            part.append(_labelled(table, one))
    tables = {name: pd.concat(part, ignore_index=True) for name, part in parts.items()}
    return tables | {
        "liquid_effect": liquid_effect.liquid_effect_table(people, experiment, settings, report)
    }


def _labelled(table: pd.DataFrame, one: PeopleAndModels) -> pd.DataFrame:
    table.insert(0, "liquid", one.trials.liquid)
    return table


def _stacked(
    make: Callable[[PeopleAndModels, Settings], pd.DataFrame],
    people: Sequence[PeopleAndModels],
    settings: Settings,
) -> pd.DataFrame:
    return pd.concat([make(one, settings) for one in people], ignore_index=True)


def _pours(
    scenes: Sequence[Scene], judged: Sequence[LiquidAndModel], own: Sequence[Liquid]
) -> Iterator[Pour]:
    """The typical pours of models, in a scene of each kind; none of those without any."""
    kinds = {scene.goal.kind: scene for scene in scenes}.values()
    for liquid, spec in judged:
        model = make_model(spec, own)
        if averages_pours(model):
            for scene in kinds:
                yield typical_pour(model.pours(scene, resolve_liquid(liquid, scene, own)))


def _models_remarks(
    specs: Sequence[str], labels: Mapping[str, str], own: Sequence[Liquid]
) -> list[str]:
    """What is to be known of the models themselves."""
    said = {labels[spec]: make_model(spec, own).remark for spec in specs}
    return [f"{label}: {remark}" for label, remark in said.items() if remark]


def _doubts(
    tables: dict[str, pd.DataFrame],
    judged: Judgments,
    people: Sequence[PeopleAndModels],
    individuals: Individuals,
    settings: Settings,
) -> list[str]:
    """What could not be computed or be relied on, and why."""
    doubts = []
    if tables["choice"].empty and judged.rows.empty:
        doubts.append(
            "no parameters were chosen: no grid was swept (`pourcast sweep STUDY --grid quick`)"
        )
    elif tables["choice"].empty:
        doubts.append(
            "no parameters were chosen: what was swept holds no values of a model's parameters "
            "with these liquids to choose among (`pourcast sweep STUDY --grid quick` does)"
        )
    elif tables["cross_validation"].empty:
        doubts.append(f"no cross-validation: it needs at least {choice.FEWEST_SCENES} scenes")
    for one in people:
        doubts += [
            agreement.unknown_intervals(one.trials, settings, tables["agreement"]),
            agreement.unknown_reliability(one.trials, tables["reliability"]),
            unknown_retest(one.trials, tables["retest"]),
        ]
    doubts += [
        f"{liquid}: single participants are not compared with chance: {why}"
        for liquid, why in individuals.left_out.items()
    ]
    return [doubt for doubt in doubts if doubt]
