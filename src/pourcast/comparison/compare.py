"""A study's people and models, compared: everything that `compare` prints and `report` shows."""

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pandas as pd

from pourcast.comparison import (
    agreement,
    choice,
    liquid_effect,
    posterior_checks,
    stimulus,
    window,
)
from pourcast.comparison.agreement import Individuals, PeopleAndModels, Settings
from pourcast.comparison.answer import answers
from pourcast.comparison.candidates import Candidates, candidates, is_fitted, not_fitted
from pourcast.comparison.retest import retest_table, unknown_retest
from pourcast.errors import InputError
from pourcast.experiment.data.responses import study_responses
from pourcast.extras import require_extra
from pourcast.files import finished_files
from pourcast.models.base import averages_pours, typical_pour
from pourcast.models.registry import complete_presets, labels_of, make_model
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import called, resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.statistics.jackknife import FEWEST
from pourcast.statistics.sampling import Sampling
from pourcast.study.experiments.base import Experiment, truth_of
from pourcast.study.folder import study_experiment, study_liquids, study_scenes
from pourcast.study.responses import Exclusion, exclude
from pourcast.study.scale import Scale
from pourcast.study.trials import Trials, arrange, remarks, repeats, uncompared
from pourcast.sweep.judgments import (
    Judgments,
    LiquidAndModel,
    judge_in_study,
    study_judgments,
    sweep_words,
)

LARGEST_R_HAT = 1.01
"""Chains of a posterior that differ by more are told of (rank-normalised R-hat)."""

LEAST_ESS = 400.0
"""Effective draws, of the bulk and of the tails, fewer than which are told of."""


@dataclass(frozen=True)
class ComparisonOptions:
    """What is to be compared.

    Parameters
    ----------
    responses
        Table of responses, or a folder of them; by default the only one in the study's folder.
    models
        Model specs, or names with ``:fitted`` at their end for those whose parameters are chosen
        on these responses; the paper's presets and all that were swept by default.
    scale
        Of the responses in a table, if they aren't shares and its mapping doesn't say it.
    columns
        A mapping of a table's columns; see `study.columns.find_columns`.
    exclude
        Rules; see `responses.exclude`.
    settings
        How intervals are made.
    carried
        A `choice_table` of another experiment, to be carried over unchanged.
    bayes
        Fit the likelihood of single answers too; takes minutes, and the extra ``bayes``.
    """

    responses: Path | None = None
    models: tuple[str, ...] = ()
    scale: Scale | None = None
    columns: str | None = None
    exclude: tuple[str, ...] = ()
    settings: Settings = field(default_factory=Settings)
    carried: pd.DataFrame | None = None
    bayes: bool = False


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

    def marked_tables(self) -> dict[str, pd.DataFrame]:
        """The tables; if observers were simulated, with a column that says so."""
        if not self.simulated:
            return self.tables
        return {name: table.assign(simulated=True) for name, table in self.tables.items()}


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


@dataclass(frozen=True)
class StudyTrials:
    """Responses to a study, without what was excluded.

    Parameters
    ----------
    trials
        One for each liquid.
    path
        Where they come from.
    columns
        The mapping of the table's columns, if there is one.
    simulated
        Whether any is simulated.
    exclusions
        What was taken out.
    told, remarks
        How the table was read; what else a reader should know of it.
    """

    trials: tuple[Trials, ...]
    path: Path
    columns: str
    simulated: bool
    exclusions: tuple[Exclusion, ...]
    told: tuple[str, ...]
    remarks: tuple[str, ...]


def study_trials(study: Path, options: ComparisonOptions) -> StudyTrials:
    """Responses to a study, as they are asked for.

    Raises
    ------
    InputError
        If there are none, or something is wrong with them; names file, row and column.
    """
    scenes = study_scenes(study)
    table, path = study_responses(
        study, options.responses, scenes, scale=options.scale, columns=options.columns
    )
    told, mapping = table.attrs.get("told", ()), table.attrs.get("columns", "")
    table, exclusions = exclude(table, options.exclude)
    trials = arrange(table, scenes, str(path))
    return StudyTrials(
        tuple(trials), path, mapping, bool(table["simulated"].any()), tuple(exclusions),
        tuple(told), (*uncompared(table), *repeats(table), *remarks(trials, scenes)),
    )  # fmt: skip


@dataclass(frozen=True)
class Matched:
    """People and models on the same scenes, before anything is computed.

    Parameters
    ----------
    read
        The responses.
    experiment
        What the study was made from, if it was.
    own
        The study's own liquids.
    specs, labels
        Models with parameters given beforehand, and what they are called.
    wanted
        (Liquid, spec) of all that were judged.
    judged, candidates
        All judgments that were swept, and what parameters are chosen from.
    people
        People and models, one for each liquid; fitted models among them.
    carried
        The same with the models that are carried over; empty if there are none.
    fitted
        Fitted models that were asked for.
    """

    read: StudyTrials
    experiment: Experiment | None
    own: tuple[Liquid, ...]
    specs: list[str]
    labels: Mapping[str, str]
    wanted: list[LiquidAndModel]
    judged: Judgments
    candidates: Mapping[str, Candidates]
    people: tuple[PeopleAndModels, ...]
    carried: tuple[PeopleAndModels, ...]
    fitted: list[str]


def match_study(study: Path, options: ComparisonOptions, report: Report = no_report) -> Matched:
    """People's responses to a study beside the models' judgments of the same scenes.

    Judgments that are not there yet are simulated, through the study's store.

    Parameters
    ----------
    study, options, report
        As for `compare_study`.

    Raises
    ------
    InputError
        If the study, the responses or a model is wrong; names file, row and column.
    StoreError
        If judgments could not be made.
    """
    if options.bayes:
        require_extra("bayes")
    scenes = study_scenes(study)
    read = study_trials(study, options)
    trials, path = read.trials, read.path
    if options.bayes and any(one.means_of is not None for one in trials):
        raise InputError(f"{path}: --bayes needs single answers, and only means are known")
    for one in trials:
        if len(one.scenes) < agreement.FEWEST_SCENES:
            raise InputError(
                f"{path}: {one.liquid}: {len(one.scenes)} scenes were answered, expected at "
                f"least {agreement.FEWEST_SCENES}"
            )
    experiment = study_experiment(study, scenes)
    usual = (experiment and experiment.models) or complete_presets()
    asked = list(options.models or usual)
    fitted = [spec for spec in options.models if is_fitted(spec)]
    specs = [spec for spec in asked if spec not in (stimulus.NAME, *fitted)]
    carried = [] if options.carried is None else list(options.carried["spec"])
    wanted = [
        (called(one.liquid), spec) for one in trials for spec in dict.fromkeys([*specs, *carried])
    ]
    judgments = judge_in_study(
        study, scenes, wanted, "compare", report=sweep_words(report, "judging")
    )
    for liquid in {called(one.liquid) for one in trials}:
        if stimulus.NAME in asked:
            judgments[liquid, stimulus.NAME] = stimulus.required_truth(study, scenes, liquid)
        elif (
            not options.models
            and (truth := stimulus.stimulus_truth(study, scenes, liquid)) is not None
        ):
            judgments[liquid, stimulus.NAME] = truth
    index = {scene.id: k for k, scene in enumerate(scenes)}
    labels = labels_of([*specs, *carried, stimulus.NAME])

    def compared(names: Sequence[str]) -> tuple[PeopleAndModels, ...]:
        return tuple(
            PeopleAndModels(
                one,
                {
                    labels[spec]: judgments[called(one.liquid), spec][
                        [index[s.id] for s in one.scenes]
                    ]
                    for spec in names
                    if (called(one.liquid), spec) in judgments
                },
                labels.get(truth_of(experiment, called(one.liquid)), ""),
            )
            for one in trials
        )

    judged = study_judgments(study, scenes)
    sets = candidates(judged, trials)
    people = choice.with_fitted(compared([*specs, stimulus.NAME]), sets, options.settings)
    return Matched(
        read=read,
        experiment=experiment,
        own=tuple(study_liquids(study)),
        specs=specs,
        labels=labels,
        wanted=wanted,
        judged=judged,
        candidates=sets,
        people=_only(people, fitted, path) if options.models else people,
        carried=compared(carried) if carried else (),
        fitted=fitted,
    )


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
            *_doubts_of_posteriors(tables, people, found.experiment),
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


def _only(
    people: Sequence[PeopleAndModels], wanted: Sequence[str], source: Path
) -> tuple[PeopleAndModels, ...]:
    """Of the fitted models only those that were asked for."""
    there = {name for one in people for name in one.names if is_fitted(name)}
    for name in wanted:
        if name not in there:
            known = f"there are {', '.join(sorted(there))}" if there else "there is none"
            raise InputError(
                f"model {name}: not fitted on {source} ({known}): it needs a sweep of the study "
                f"with several values of its parameters (`pourcast sweep STUDY --grid FILE`), and "
                f"{choice.FEWEST_SCENES} scenes that were answered"
            )
    left_out = there - set(wanted)
    kept = tuple(
        replace(one, models={name: j for name, j in one.models.items() if name not in left_out})
        for one in people
    )
    for one in kept:
        if not one.models:
            raise InputError(
                f"model: none of these was fitted on {called(one.trials.liquid)} trials, and there "
                f"are some in {source}: name one for them, too"
            )
    return kept


def _fitted_remarks(people: Sequence[PeopleAndModels]) -> list[str]:
    """What it means that a model's parameters were chosen on these responses."""
    fitted = [name for one in people for name in one.names if is_fitted(name)]
    if not fitted:
        return []
    return [
        f"{', '.join(dict.fromkeys(fitted))}: each half of the scenes is judged with parameters "
        "that were chosen on the other half, so that r, intervals and tests are not flattered by "
        f"the choice (of {choice.FITTED_HALVINGS} random halvings, drawn by --seed, the one of "
        "median r; another seed may yet tell what is on the edge)"
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


def _doubts_of_posteriors(
    tables: dict[str, pd.DataFrame],
    people: Sequence[PeopleAndModels],
    experiment: Experiment | None,
) -> list[str]:
    """What of the likelihood of single answers is not to be relied on, or is not there, and why."""
    if "posterior" not in tables:
        return []
    doubts = list(_not_converged(tables["posterior"], ""))
    if len(effects := tables["liquid_effect"]):
        doubts += _not_converged(effects, " of the liquid's effect")
    doubts += posterior_checks.unlike_people(tables["predictive_checks"])
    doubts += posterior_checks.sensitive_to_priors(tables["posterior"])
    doubts += [_unknown_loo(one.trials) for one in people]
    doubts += liquid_effect.unknown_liquid_effects(people, experiment)
    return [doubt for doubt in doubts if doubt]


def _not_converged(table: pd.DataFrame, what: str) -> Iterator[str]:
    """Which posteriors are not to be relied on, and why."""
    for (liquid, model), rows in table.groupby(["liquid", "model"], sort=False):
        why = []
        if (r_hat := rows["r_hat"].max()) > LARGEST_R_HAT:
            why.append(f"its chains disagree (R-hat {r_hat:.3f}, above {LARGEST_R_HAT})")
        if (ess := rows[["ess_bulk", "ess_tail"]].to_numpy().min()) < LEAST_ESS:
            why.append(f"it is worth {ess:.0f} draws (fewer than {LEAST_ESS:.0f})")
        if divergences := rows["divergences"].max():
            why.append(f"{divergences} of its trajectories diverged")
        if why:
            yield f"{liquid}: trust the posterior{what} by {model} less: {', '.join(why)}"


def _unknown_loo(trials: Trials) -> str:
    """What can't be left out one at a time, as there is too little of it; empty if all can."""
    counts = dict(zip(("participants", "scenes"), trials.responses.shape, strict=True))
    few = [f"{what} ({count})" for what, count in counts.items() if count < FEWEST]
    if not few:
        return ""
    return f"{trials.liquid}: no leaving out of {' or '.join(few)}: it needs at least {FEWEST}"
