"""What a study could tell apart: its parameters and models planted in simulated studies of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.comparison.agreement import Settings
from pourcast.comparison.candidates import candidates, is_fitted, words_first
from pourcast.comparison.design import Design, model_recovery_table, power_table
from pourcast.errors import InputError, unknown
from pourcast.experiment.data.responses import study_responses
from pourcast.models.registry import complete_presets, family_of, make_model, name_of
from pourcast.progress import Progress, Report, no_report
from pourcast.scenes.liquids.registry import called, resolve_liquid
from pourcast.statistics.jackknife import FEWEST
from pourcast.statistics.observer import Population
from pourcast.statistics.recovery import confusion, recover_parameters
from pourcast.study.experiments.base import observer_model
from pourcast.study.folder import study_experiment, study_liquids, study_scenes
from pourcast.study.trials import Trials, arrange
from pourcast.sweep.judgments import (
    Judgments,
    columns_of,
    judge_in_study,
    study_judgments,
)

Array = NDArray[np.float64]


def along(judged: Judgments, liquid: str, spec: str, axis: str) -> tuple[list[Any], Array]:
    """Judgments along one parameter, the others as in a spec.

    Parameters
    ----------
    judged
        Judgments on a study's scenes.
    liquid
        Liquid of the trials.
    spec
        The model.
    axis
        The parameter.

    Returns
    -------
    list, ndarray
        The values that were swept, and judgments of shape [value_count, scene_count].

    Raises
    ------
    InputError
        If the model has no such parameter, or fewer than two values were swept.
    """
    parameters = make_model(spec, judged.own).parameters()
    if axis not in parameters or axis == "liquid":
        known = [name for name in parameters if name != "liquid"]
        raise InputError(f"parameter: {unknown(axis, known)}")
    fixed = columns_of(parameters) | {"family": family_of(name_of(spec))}
    del fixed[axis]
    judgments_at: dict[Any, Array] = {}
    for row in judged.on_trials(liquid, **fixed):
        judgments_at.setdefault(judged.rows[axis].iloc[row], judged.judgments[row])
    if len(judgments_at) < 2:
        raise InputError(
            f"parameter {axis}: {len(judgments_at)} of its values were swept with {spec}, "
            "expected at least 2; run `pourcast sweep STUDY --grid ...` first"
        )
    values = sorted(judgments_at, key=words_first)
    return values, np.stack([judgments_at[value] for value in values])


def _planting(report: Report) -> Progress:
    return lambda done, total: report("planting", done, total)


def parameter_recovery_table(
    values: Sequence[Any],
    judgments: Array,
    *,
    observers: int,
    studies: int,
    population: Population,
    spread: float,
    seed: int,
    report: Report = no_report,
) -> pd.DataFrame:
    """Each value planted in turn, and which values its studies recovered.

    Returns
    -------
    DataFrame
        A row a planted value (the index), a column a recovered one: shares of the studies;
        then `within_one_step`, the share within one step of the planted value.
    """
    recovered = recover_parameters(
        judgments, range(len(values)), observers=observers, studies=studies,
        population=population, rng=np.random.default_rng(seed), spread=spread,
        progress=_planting(report),
    )  # fmt: skip
    shares = confusion(recovered, len(values)) / studies
    table = pd.DataFrame(shares, columns=pd.Index(values), index=pd.Index(values, name="planted"))
    near = np.abs(recovered - np.arange(len(values))[:, None]) <= 1
    return table.assign(within_one_step=near.mean(axis=1))


# Of a study -----------------------------------------------------------------------------

OPPONENTS = ("water-ife", "water-marble")
"""Models that are told apart unless others are named."""

OBSERVER_COUNTS = (5, 10, 20, 40)
"""Sizes of studies whose power is computed unless others are named."""

_GRID = "recovery"
"""Name by which the study's store keeps what was judged for this."""


class Recovery(NamedTuple):
    """What a study could have told apart: in words whose, and the table."""

    title: str
    table: pd.DataFrame


def recover_parameter(
    study: Path,
    parameter: str,
    liquid: str,
    spec: str | None = None,
    *,
    observers: int,
    studies: int,
    population: Population,
    spread: float,
    seed: int,
    report: Report = no_report,
) -> Recovery:
    """Plant each value of a parameter that was swept in a study; see `parameter_recovery_table`.

    Parameters
    ----------
    study
        The study folder.
    parameter
        The parameter.
    liquid
        Liquid of the trials.
    spec
        The model; by default the one that simulated observers have in their heads.
    observers, studies, population, spread, seed
        As for `statistics.recovery.recover_parameters`.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study or the model is wrong, or too little was swept.
    """
    scenes = study_scenes(study)
    spec = spec or observer_model(study_experiment(study, scenes), liquid)
    shown = resolve_liquid(liquid, scenes[0], study_liquids(study)).name
    values, judgments = along(study_judgments(study, scenes), shown, spec, parameter)
    table = parameter_recovery_table(
        values, judgments, observers=observers, studies=studies, population=population,
        spread=spread, seed=seed, report=report,
    )  # fmt: skip
    return Recovery(f"{spec}: {parameter}", table)


def recover_models(
    study: Path,
    liquid: str,
    specs: Sequence[str] = (),
    *,
    observers: int,
    studies: int,
    population: Population,
    settings: Settings,
    report: Report = no_report,
) -> Recovery:
    """Plant each of some models in a study; see `design.model_recovery_table`.

    Parameters
    ----------
    study
        The study folder.
    liquid
        Liquid of the trials.
    specs
        The models, at least two; by default all that `compare` has, fitted ones too.
    observers, studies, population, settings
        As for `design.model_recovery_table`.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study or a model is wrong.
    """
    design = study_design(study, liquid, specs)
    if len(design.names) < 2:
        raise InputError("model: expected at least two models to tell apart")
    table = model_recovery_table(
        design, observers=observers, studies=studies, population=population, settings=settings,
        report=report,
    )  # fmt: skip
    title = f"{liquid} trials: {observers} participants, {len(design.scenes)} scenes"
    return Recovery(title, table)


def study_power(
    study: Path,
    liquid: str,
    specs: Sequence[str] = (),
    *,
    observers: Sequence[int] = (),
    scenes: Sequence[int] = (),
    studies: int,
    population: Population,
    settings: Settings,
    report: Report = no_report,
) -> Recovery:
    """Power to tell two models apart with a study's scenes; see `design.power_table`.

    Parameters
    ----------
    study
        The study folder.
    liquid
        Liquid of the trials.
    specs
        The model in people's heads, its rival, and what else is compared; `OPPONENTS`, among all
        that `compare` has, by default.
    observers, scenes
        Sizes, beside the study's own; `OBSERVER_COUNTS` by default.
    studies, population, settings
        As for `design.power_table`.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study or a model is wrong, or there are not two.
    """
    pair = list(dict.fromkeys(specs or OPPONENTS))[:2]
    if len(pair) < 2:
        raise InputError("model: expected two models to tell apart, found 1")
    (true, rival), design = pair, study_design(study, liquid, specs)
    own = _participants_of(study, design)
    table = power_table(
        design, true, rival,
        observers=sorted({*(observers or OBSERVER_COUNTS), *own}),
        scenes=sorted({*scenes, len(design.scenes)}),
        studies=studies, population=population, settings=settings, report=report,
    )  # fmt: skip
    pairs = len(design.names) * (len(design.names) - 1) // 2
    among = f", p corrected for all {pairs} pairs of {len(design.names)} models"
    return Recovery(
        f"{true} in people's heads, told from {rival}{among if pairs > 1 else ''}", table
    )


def study_design(study: Path, liquid: str, specs: Sequence[str] = ()) -> Design:
    """What a study's trials with one liquid compare, whether or not anybody has taken part.

    Parameters
    ----------
    study
        The study folder.
    liquid
        Liquid of the trials.
    specs
        The models; by default all that `compare` has.

    Raises
    ------
    InputError
        If the study or a model is wrong.
    """
    scenes = study_scenes(study)
    shown = resolve_liquid(liquid, scenes[0], study_liquids(study)).name
    experiment = study_experiment(study, scenes)
    usual = (experiment and experiment.models) or complete_presets()
    asked = list(dict.fromkeys(specs or usual))
    given = [spec for spec in asked if not is_fitted(spec)]
    judgments = judge_in_study(study, scenes, [(liquid, spec) for spec in given], _GRID)
    nobody = Trials(shown, (), tuple(scenes), np.empty((0, len(scenes))))
    sets = candidates(study_judgments(study, scenes), [nobody])
    names = {
        one.fitted_name: name for name, one in sets.items() if len(one.judgments) > 1 and one.free
    }
    for spec in asked:
        if is_fitted(spec) and spec not in names:
            raise InputError(f"model: {unknown(spec, names) if names else f'{spec}: no sweep'}")
    wanted = [names[spec] for spec in asked if spec in names] if specs else list(names.values())
    return Design(
        shown, tuple(scenes), {spec: judgments[liquid, spec] for spec in given},
        {name: sets[name] for name in wanted},
    )  # fmt: skip


def _participants_of(study: Path, design: Design) -> list[int]:
    """How many judge, or shall judge, trials with the liquid; nothing if nobody knows."""
    try:
        table, path = study_responses(study, None, design.scenes)
    except InputError:
        experiment = study_experiment(study, list(design.scenes))
        if experiment is None:
            return []
        seeing = sum(called(design.liquid) in group for group in experiment.groups)
        return [max(FEWEST, experiment.participants * seeing // len(experiment.groups))]
    trials = arrange(table, design.scenes, str(path))
    counts = [one.participant_count for one in trials if one.liquid == design.liquid]
    return [max(FEWEST, count) for count in counts if count]
