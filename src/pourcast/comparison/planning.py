"""What a design could have told apart: recovery of parameters and models, and power, as tables."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError, unknown
from pourcast.models.registry import family_of, make_model, name_of
from pourcast.progress import Progress, Report, no_report
from pourcast.statistics.bootstrap import Resampled
from pourcast.statistics.observer import Population
from pourcast.statistics.recovery import confusion, power_of, recover_parameters
from pourcast.sweep.judged import OWN_ALPHA, Judged, columns_of

Array = NDArray[np.float64]


def along(judged: Judged, liquid: str, spec: str, axis: str) -> tuple[list[Any], Array]:
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
    parameters = make_model(spec).parameters()
    if axis not in parameters or axis == "liquid":
        known = [name for name in parameters if name != "liquid"]
        raise InputError(f"parameter: {unknown(axis, known)}")
    fixed = columns_of(parameters) | {"family": family_of(name_of(spec))}
    del fixed[axis]
    found: dict[Any, Array] = {}
    for row in judged.on_trials(liquid, **fixed):
        found.setdefault(judged.rows[axis].iloc[row], judged.judgments[row])
    if len(found) < 2:
        raise InputError(
            f"parameter {axis}: {len(found)} of its values were swept with {spec}, expected at "
            "least 2; run `pourcast sweep STUDY --grid ...` first"
        )
    values = sorted(found, key=lambda value: -1.0 if value == OWN_ALPHA else float(value))
    return values, np.stack([found[value] for value in values])


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
    resampled: Resampled,
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
    resampled, level
        The interval that must not hold 0.
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
        found = power_of(
            true, rival, observers=people, scenes=shown, studies=studies, population=population,
            rng=np.random.default_rng([seed, people, shown]), resampled=resampled, level=level,
        )  # fmt: skip
        rows.append({"observers": people, "scenes": shown, **vars(found)})
    return pd.DataFrame(rows)
