"""What a design could have told apart: recovery of parameters and models, and power, as tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError, unknown
from pourcast.models.registry import complete_presets, family_of, make_model, name_of
from pourcast.progress import Progress, Report, no_report
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.statistics.jackknife import Over
from pourcast.statistics.observer import Population
from pourcast.statistics.recovery import confusion, power_of, recover_parameters
from pourcast.study.experiments.base import observer_model
from pourcast.study.folder import study_experiment, study_liquids, study_scenes
from pourcast.sweep.judgments import (
    OWN_ALPHA,
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
    values = sorted(judgments_at, key=lambda value: -1.0 if value == OWN_ALPHA else float(value))
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


def model_recovery_table(
    models: Mapping[str, Array],
    *,
    observers: int,
    studies: int,
    population: Population,
    seed: int,
    report: Report = no_report,
) -> pd.DataFrame:
    """Each model planted in turn, and which model fits its studies best: shares of the studies.

    Returns
    -------
    DataFrame
        A row a planted model (the index), a column a recovered one.
    """
    names = list(models)
    recovered = recover_parameters(
        np.stack(list(models.values())), range(len(names)), observers=observers, studies=studies,
        population=population, rng=np.random.default_rng(seed), progress=_planting(report),
    )  # fmt: skip
    shares = confusion(recovered, len(names)) / studies
    return pd.DataFrame(shares, columns=names, index=pd.Index(names, name="planted"))


def power_table(
    models: Mapping[str, Array],
    *,
    observers: Sequence[int],
    scenes: Sequence[int],
    studies: int,
    population: Population,
    over: Over,
    level: float,
    seed: int,
    report: Report = no_report,
) -> pd.DataFrame:
    """Power to tell two models apart, for designs of several sizes.

    Parameters
    ----------
    models
        Two models: the one in the observers' heads, then its rival.
    observers, scenes
        Sizes.
    studies
        Simulated for each size.
    population
        How observers answer.
    over, level
        What the difference must hold over, and the level of its test.
    seed
        Source of all randomness.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        A row a size: `observers`, `scenes`, `power`, `low`, `high`, `wrong`.
    """
    (true_name, true), (rival_name, rival) = models.items()
    sizes = [(people, shown) for people in observers for shown in scenes]
    rows = []
    for done, (people, shown) in enumerate(sizes):
        report(f"{true_name} against {rival_name}: {people} x {shown}", done, len(sizes))
        power = power_of(
            true, rival, observers=people, scenes=shown, studies=studies, population=population,
            rng=np.random.default_rng([seed, people, shown]), over=over, level=level,
        )  # fmt: skip
        rows.append({"observers": people, "scenes": shown, **vars(power)})
    return pd.DataFrame(rows)


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
    seed: int,
    report: Report = no_report,
) -> Recovery:
    """Plant each of some models in a study; see `model_recovery_table`.

    Parameters
    ----------
    study
        The study folder.
    liquid
        Liquid of the trials.
    specs
        The models, at least two; all presets by default.
    observers, studies, population, seed
        As for `statistics.recovery.recover_parameters`.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study or a model is wrong.
    """
    scenes, specs = study_scenes(study), list(dict.fromkeys(specs or complete_presets()))
    if len(specs) < 2:
        raise InputError("model: expected at least two models to tell apart")
    table = model_recovery_table(
        _judged(study, liquid, specs), observers=observers, studies=studies,
        population=population, seed=seed, report=report,
    )  # fmt: skip
    title = f"{liquid} trials: {observers} participants, {len(scenes)} scenes"
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
    over: Over,
    level: float,
    seed: int,
    report: Report = no_report,
) -> Recovery:
    """Power to tell two models apart with a study's scenes; see `power_table`.

    Parameters
    ----------
    study
        The study folder.
    liquid
        Liquid of the trials.
    specs
        The model in people's heads, and its rival; `OPPONENTS` by default.
    observers, scenes
        Sizes; `OBSERVER_COUNTS`, and all scenes, by default.
    studies, population, over, level, seed
        As for `power_table`.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study or a model is wrong, or they are not two.
    """
    there, specs = study_scenes(study), list(specs or OPPONENTS)
    if len(set(specs)) != 2 or len(specs) != 2:
        raise InputError(f"model: expected two models to tell apart, found {len(specs)}")
    table = power_table(
        _judged(study, liquid, specs), observers=observers or OBSERVER_COUNTS,
        scenes=scenes or [len(there)], studies=studies, population=population,
        over=over, level=level, seed=seed, report=report,
    )  # fmt: skip
    return Recovery(f"{specs[0]} in people's heads, told from {specs[1]}", table)


def _judged(study: Path, liquid: str, specs: Sequence[str]) -> dict[str, Array]:
    """Judgments of models on a study's scenes, by their specs."""
    requests = [(liquid, spec) for spec in specs]
    judgments = judge_in_study(study, study_scenes(study), requests, _GRID)
    return {spec: judgments[liquid, spec] for spec in specs}
