"""People's responses to a study beside the models' judgments of the same scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import pandas as pd

from pourcast.comparison import agreement, choice, stimulus
from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import Candidates, candidates, is_fitted
from pourcast.errors import InputError
from pourcast.experiment.data.responses import study_responses
from pourcast.extras import require_extra
from pourcast.models.registry import complete_presets, labels_of
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import called
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
    return match_trials(study, study_trials(study, options), options, report)


def match_trials(
    study: Path, read: StudyTrials, options: ComparisonOptions, report: Report = no_report
) -> Matched:
    """The same for responses that were read already; see `match_study`."""
    scenes, trials, path = study_scenes(study), read.trials, read.path
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
