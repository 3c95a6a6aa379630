"""Models compared by how well they predict scenes, and participants, that were left out.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.progress import Report, no_report
from pourcast.statistics.differences import holm
from pourcast.statistics.jackknife import FEWEST, LEVEL, Estimate, over_units
from pourcast.statistics.leave_out import UNITS, LeftOut, Unit, leave_out
from pourcast.statistics.nuts import Sampler
from pourcast.statistics.predictive_checks import predictive_checks
from pourcast.statistics.prior_sensitivity import prior_sensitivity
from pourcast.statistics.response_model import PARAMETERS, Answers, response_model
from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]

_STEPS = 10_000
"""Of the weights' iteration."""


@dataclass(frozen=True)
class LooComparison:
    """Models compared by the likelihood of single answers.

    Parameters
    ----------
    loo
        A row a model and `unit` (what was left out, `scenes` or `participants`), the best first:
        `elpd` (log density of all answers), `se`, `elpd_diff` (below the best), `dse`, `told` (from
        the best; yes or no), `p_loo` (effective parameters), `weight` (stacking), `largest_k`
        (Pareto k), `refitted` (units whose k was too high, and without which the model was fitted
        again), `divergences` (of the posterior of all answers). Standard errors are over units.
    differences
        A row a pair of models and unit: `model`, `rival`, `difference` (the model's elpd minus the
        rival's), `se`, `p` (two-sided, Student's t), `p_holm` (for all pairs of the unit), `told`
        (whether that is below one minus the level).
    parameters
        A row a model and a parameter. See `nuts.Posterior.summary` and
        `prior_sensitivity.prior_sensitivity`.
    checks, tenths
        A row a model and statistic, or tenth of the scale. See `predictive_checks.Checks`.
    """

    loo: pd.DataFrame
    differences: pd.DataFrame
    parameters: pd.DataFrame
    checks: pd.DataFrame
    tenths: pd.DataFrame


def compare_models(
    responses: Array,
    models: Mapping[str, Array],
    sampling: Sampling | None = None,
    report: Report = no_report,
    *,
    level: float = LEVEL,
    checked: bool = True,
) -> LooComparison:
    """Fit the response model with each model's judgments, and compare them by PSIS-LOO.

    Units of which there are fewer than five are not left out.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    models
        Name -> judgments, shape [scene_count].
    sampling
        How posteriors are drawn.
    report
        Told of the progress.
    level
        Of the parameters' intervals, and of telling models apart.
    checked
        Check each fit, which takes its time: `checks`, `tenths` and sensitivities of
        `parameters` are there only then.
    """
    sampler = Sampler(response_model, sampling)
    data = [Answers.of(responses, judgments) for judgments in models.values()]
    units = units_of(responses)
    left_out: dict[Unit, dict[str, LeftOut]] = {unit: {} for unit in units}
    posteriors = sampler.posteriors(data)
    summaries, checks, tenths = [], [], []
    for done, (name, one) in enumerate(zip(models, data, strict=True)):
        report(f"fitting {name}", done, len(models))
        posterior = next(posteriors)
        summary = posterior.summary(PARAMETERS, level)
        if checked:
            summary = summary.join(prior_sensitivity(posterior, one))
            found = predictive_checks(
                posterior, one, sampler.sampling.seed,
                replicates=sampler.sampling.replicates, level=level,
            )  # fmt: skip
            checks.append(_of_model(name, found.statistics))
            tenths.append(_of_model(name, found.tenths))
        summaries.append(_of_model(name, summary))
        for unit in units:
            left_out[unit][name] = leave_out(unit, sampler, posterior, one)
    parameters = _stacked(summaries)
    divergences = dict(zip(parameters["model"], parameters["divergences"], strict=True))
    tables = [_of_unit(unit, left_out[unit], divergences, level) for unit in units]
    loo, pairs = (_stacked([one[k] for one in tables]) for k in range(2))
    return LooComparison(loo, pairs, parameters, _stacked(checks), _stacked(tenths))


def _stacked(tables: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def units_of(responses: Array) -> list[Unit]:
    """Units of which there are enough to leave them out one at a time.

    Examples
    --------
    >>> units_of(np.zeros((1, 30)))
    ['scenes']
    """
    participants, scenes = responses.shape
    counts: dict[Unit, int] = {"scenes": scenes, "participants": participants}
    return [unit for unit in UNITS if counts[unit] >= FEWEST]


def stacking_weights(elpd: Array) -> Array:
    """Weights with which models together predict best (Yao et al. 2018, Bayesian Analysis 13).

    Parameters
    ----------
    elpd
        Of each unit, shape [model_count, unit_count].

    Returns
    -------
    ndarray
        Shape [model_count]; they sum to one.

    Examples
    --------
    >>> stacking_weights(np.array([[0.0, 0.0], [-9.0, -9.0]])).round(3).tolist()
    [1.0, 0.0]
    """
    density = np.exp(elpd - elpd.max(axis=0))
    weights = np.full(len(elpd), 1.0 / len(elpd))
    for _ in range(_STEPS):
        # Expectation maximization, as of a mixture's weights.
        weights = weights * (density / (weights @ density)).mean(axis=1)
    return weights


def _of_model(name: str, table: pd.DataFrame) -> pd.DataFrame:
    table.insert(0, "model", name)
    return table


def compare_pairs(elpd: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Estimate]:
    """Differences of elpd between all pairs of models, over units.

    Errors are those of a sum over units, with Student's t: two standard errors are too few where
    there are thirty units, and fewer still where few of them decide.

    Parameters
    ----------
    elpd
        Of each unit, shape [model_count, unit_count].

    Returns
    -------
    ndarray, ndarray, Estimate
        Numbers of both models, and the first's elpd minus the second's; shape [pair_count].
    """
    first, second = np.triu_indices(len(elpd), 1)
    return first, second, over_units((elpd[first] - elpd[second]).T)


def _of_unit(
    unit: Unit, left_out: Mapping[str, LeftOut], divergences: Mapping[str, int], level: float
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Both tables of a unit."""
    names = np.array(list(left_out), dtype=object)
    elpd = np.stack([one.elpd for one in left_out.values()])
    first, second, found = compare_pairs(elpd)
    p_holm = holm(found.p)
    told = np.where(p_holm < 1.0 - level, "yes", "no")
    pairs = pd.DataFrame(
        {
            "unit": unit,
            "model": names[first],
            "rival": names[second],
            "difference": found.value,
            "se": np.sqrt(found.variance),
            "p": found.p,
            "p_holm": p_holm,
            "told": told,
        }
    )
    best = int(elpd.sum(axis=1).argmax())
    from_best = {
        (set(pair) - {best}).pop(): word
        for *pair, word in zip(first.tolist(), second.tolist(), told, strict=True)
        if best in pair
    }
    below = over_units((elpd[best] - elpd).T)
    loo = pd.DataFrame(
        {
            "unit": unit,
            "model": names,
            "elpd": elpd.sum(axis=1),
            "se": np.sqrt(over_units(elpd.T).variance),
            "elpd_diff": below.value,
            "dse": np.sqrt(below.variance),
            "told": [from_best.get(number, "-") for number in range(len(names))],
            "p_loo": [one.p_loo.sum() for one in left_out.values()],
            "weight": stacking_weights(elpd),
            "largest_k": [one.k.max() for one in left_out.values()],
            "refitted": [one.refitted.sum() for one in left_out.values()],
            "divergences": [divergences[name] for name in names],
        }
    )
    return loo.sort_values("elpd", ascending=False, kind="stable"), pairs
