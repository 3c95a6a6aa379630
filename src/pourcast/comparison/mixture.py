"""Which model is in each head, with which parameters: `statistics.mixture`, labelled."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.comparison.agreement import FEWEST_SCENES
from pourcast.comparison.candidates import Candidates, candidates, is_fitted, not_fitted
from pourcast.comparison.matching import ComparisonOptions, study_trials
from pourcast.comparison.posterior_checks import LARGEST_R_HAT, LEAST_ESS
from pourcast.errors import InputError, unknown
from pourcast.extras import require_extra
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.registry import called
from pourcast.study.folder import study_scenes
from pourcast.study.responses import Exclusion
from pourcast.study.trials import Trials
from pourcast.sweep.judgments import judge_in_study, study_judgments, sweep_words

if TYPE_CHECKING:
    from pourcast.statistics.mixture import Head, Mixture
    from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]

HEURISTICS = ("gravity",)
"""Models without swept parameters that may be in a head, unless models are named."""

NO_MODEL = "no-model"
"""Answers that have nothing to do with the scene; always among the models."""

_STEPS = 16
"""Between swept values that lie further apart than this part of their range, judgments are
interpolated."""

_FEWEST_VALUES = 3
"""Of a parameter that has a distribution over people."""

_LIKELY = 0.05
"""Parameters are told of models that are as probable in a head."""

_GRID = "mixture"

TABLES = {
    "shares": "Models in people's heads: shares of the population",
    "people": "Participants: the model in each head, and how probable each is",
    "people_parameters": "Participants: parameters of the models that may be in their heads",
    "population": "The population: models' parameters, and how answers are given",
}
"""Tables of a mixture, and what they say."""


@dataclass(frozen=True)
class StudyMixture:
    """A study's mixtures.

    Parameters
    ----------
    simulated
        Whether any of the responses are simulated.
    exclusions, remarks
        What was taken out, and what else a reader should know.
    tables
        Name -> table; see `TABLES`.
    """

    simulated: bool
    exclusions: tuple[Exclusion, ...]
    remarks: tuple[str, ...]
    tables: dict[str, pd.DataFrame]


def study_mixture(
    study: Path, options: ComparisonOptions, sampling: "Sampling", report: Report = no_report
) -> StudyMixture:
    """Fit a mixture of models to the people of a study, for each liquid.

    Parameters
    ----------
    study
        The study folder.
    options
        Responses, exclusions and models. ``NAME:fitted`` has all settings that were swept; others
        have one. By default everything that was swept, and `HEURISTICS`.
    sampling
        How posteriors are drawn.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the study, the responses or a model is wrong, or the extra is missing.
    StoreError
        If judgments could not be made.
    """
    require_extra("bayes")
    from pourcast.statistics.mixture import MixtureModel  # noqa: PLC0415 (JAX, only for this)

    read = study_trials(study, options)
    scenes, settings = study_scenes(study), options.settings
    swept = candidates(study_judgments(study, scenes), read.trials)
    parts: dict[str, list[pd.DataFrame]] = {name: [] for name in TABLES}
    there: dict[str, list[str]] = {}
    for number, one in enumerate(read.trials):
        if one.means_of is not None:
            raise InputError(f"{read.path}: a mixture needs single answers, and these are means")
        if len(one.scenes) < FEWEST_SCENES:
            raise InputError(f"{read.path}: {one.liquid}: {len(one.scenes)} scenes were answered")
        heads = _heads(study, one, swept, options.models, report)
        there[one.liquid] = list(heads)
        report(f"mixture of {len(heads)} models, {one.liquid}", number, len(read.trials))
        found = MixtureModel(heads, sampling).fit(one.responses)
        for name, table in _tables(one, found, settings.level).items():
            table.insert(0, "liquid", one.liquid)
            parts[name].append(table)
    tables = {name: pd.concat(part, ignore_index=True) for name, part in parts.items()}
    remarks = (
        *read.told, *not_fitted(options.models, there), *read.remarks,
        *_doubts(tables["population"]),
    )  # fmt: skip
    return StudyMixture(read.simulated, read.exclusions, remarks, tables)


def _heads(
    study: Path,
    trials: Trials,
    swept: Mapping[str, Candidates],
    models: Sequence[str],
    report: Report,
) -> "dict[str, Head]":
    """Models of the trials of one liquid, and no model."""
    from pourcast.statistics.mixture import Head  # noqa: PLC0415 (JAX, only for this)

    own = {
        one.fitted_name: one
        for one in swept.values()
        if one.trials.liquid == trials.liquid and len(one.judgments) > 1
    }
    asked = list(dict.fromkeys(models or [*own, *HEURISTICS]))
    single = [spec for spec in asked if not is_fitted(spec)]
    missing = [spec for spec in asked if is_fitted(spec) and spec not in own]
    if missing and not any(missing[0] == one.fitted_name for one in swept.values()):
        known = unknown(missing[0], own) if own else "nothing was swept"
        raise InputError(f"model {missing[0]}: {known}")
    scenes, liquid = study_scenes(study), called(trials.liquid)
    judged = judge_in_study(
        study, scenes, [(liquid, spec) for spec in single], _GRID,
        report=sweep_words(report, "judging"),
    )  # fmt: skip
    index = {scene.id: k for k, scene in enumerate(scenes)}
    shown = [index[scene.id] for scene in trials.scenes]
    heads = {
        spec: head_of(own[spec]) if spec in own else Head(judged[liquid, spec][shown][None], {})
        for spec in asked
        if spec not in missing
    }
    return heads | {NO_MODEL: Head(np.full((1, len(shown)), 0.5), {})}


def head_of(one: Candidates) -> "Head":
    """A swept model as it may be in a head, interpolated where its values lie far apart.

    Parameters
    ----------
    one
        The model's settings.
    """
    from pourcast.statistics.mixture import Head  # noqa: PLC0415 (JAX, only for this)

    numeric = {
        axis: np.asarray(column, dtype=float)
        for axis, column in one.axes.items()
        if np.asarray(column).dtype.kind in "fiu" and len(np.unique(column)) >= _FEWEST_VALUES
    }
    if not numeric:
        return Head(one.judgments, {})
    densest = max(numeric, key=lambda axis: len(np.unique(numeric[axis])))
    table = pd.DataFrame({axis: np.asarray(column) for axis, column in one.axes.items()})
    others = [axis for axis in table if axis != densest]
    groups = table.groupby(others, sort=False, dropna=False).ngroup() if others else 0 * table.index
    judgments, values = [], []
    for number in range(int(max(groups)) + 1):
        group = np.flatnonzero(np.asarray(groups) == number)
        order = group[np.argsort(numeric[densest][group], kind="stable")]
        along = _between(numeric[densest][order])
        judgments.append(_interpolated(along, numeric[densest][order], one.judgments[order]))
        rest = {axis: np.full(len(along), numeric[axis][order[0]]) for axis in numeric}
        values.append(rest | {densest: along})
    parameters = {axis: np.concatenate([value[axis] for value in values]) for axis in numeric}
    return Head(np.concatenate(judgments), parameters)


def _between(values: Array) -> Array:
    """Values, and evenly spaced ones between those that lie far apart."""
    step = (values[-1] - values[0]) / _STEPS
    if not step > 0.0:
        return values
    counts = np.maximum(1, np.ceil(np.diff(values) / step - 1e-9).astype(int))
    inner = [
        np.linspace(first, last, count, endpoint=False)
        for first, last, count in zip(values[:-1], values[1:], counts, strict=True)
    ]
    return np.concatenate([*inner, values[-1:]])


def _interpolated(along: Array, values: Array, judgments: Array) -> Array:
    """Judgments between swept values, scene by scene; shape [len(along), scene_count]."""
    return np.stack([np.interp(along, values, scene) for scene in judgments.T], axis=1)


def _tables(trials: Trials, found: "Mixture", level: float) -> dict[str, pd.DataFrame]:
    probabilities = found.probabilities()
    names = list(found.heads)
    people = pd.DataFrame(
        {
            "participant": trials.participants,
            "trials": np.isfinite(trials.responses).sum(axis=1),
            "model": [names[best] for best in probabilities.argmax(axis=1)],
            "probability": probabilities.max(axis=1),
        }
    )
    each = pd.DataFrame(probabilities, columns=[f"p_{name}" for name in names])
    return {
        "shares": found.shares(level),
        "people": pd.concat([people, each], axis=1),
        "people_parameters": pd.DataFrame(list(_own(trials, found, probabilities, level))),
        "population": found.posterior.summary(found.names, level),
    }


def _own(
    trials: Trials, found: "Mixture", probabilities: Array, level: float
) -> Iterator[dict[str, object]]:
    """Rows of what each participant's parameters are, if a model is in the head."""
    tails = (0.5 - level / 2.0, 0.5 + level / 2.0)
    for number, (model, head) in enumerate(found.heads.items()):
        for parameter in head.parameters:
            drawn = found.values(model, parameter)
            for who, values in enumerate(drawn):
                if probabilities[who, number] >= _LIKELY:
                    low, high = np.quantile(values, tails)
                    yield {
                        "participant": trials.participants[who], "model": model,
                        "probability": probabilities[who, number], "parameter": parameter,
                        "mean": values.mean(), "low": low, "high": high,
                    }  # fmt: skip


def _doubts(population: pd.DataFrame) -> list[str]:
    """What can't be relied on, and why."""
    doubts = []
    for liquid, rows in population.groupby("liquid", sort=False):
        bad = rows[
            (rows["r_hat"] > LARGEST_R_HAT)
            | (rows[["ess_bulk", "ess_tail"]].min(axis=1) < LEAST_ESS)
        ]
        if len(bad):
            doubts.append(
                f"{liquid}: chains don't agree well enough on {', '.join(bad['parameter'])} "
                f"(R-hat above {LARGEST_R_HAT} or fewer than {LEAST_ESS:g} effective draws): "
                "draw more (--draws)"
            )
        if diverging := int(rows["divergences"].iloc[0]):
            doubts.append(f"{liquid}: {diverging} divergent draws: intervals may be too narrow")
    return doubts
