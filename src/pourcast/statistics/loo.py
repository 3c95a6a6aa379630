"""Models compared by how well they predict scenes, and participants, that were left out.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.progress import Report, no_report
from pourcast.statistics.jackknife import FEWEST, LEVEL
from pourcast.statistics.leave_out import UNITS, LeftOut, Unit, leave_out
from pourcast.statistics.nuts import Posterior, Sampler, Sampling
from pourcast.statistics.response_model import PARAMETERS, Answers, response_model

Array = NDArray[np.float64]

TOLD = 2.0
"""Standard errors of a difference by which one model is told from another."""

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
        the best, by two standard errors; yes or no), `p_loo` (effective parameters), `weight`
        (stacking), `largest_k` (Pareto k), `refitted` (units whose k was too high, and without
        which the model was fitted again), `divergences` (of the posterior of all answers).
        Standard errors are over units.
    differences
        A row a pair of models and unit: `model`, `rival`, `difference` (the model's elpd minus the
        rival's), `se`, `told`.
    parameters
        A row a model and a parameter. See `nuts.Posterior.summary`.
    """

    loo: pd.DataFrame
    differences: pd.DataFrame
    parameters: pd.DataFrame


def compare_models(
    responses: Array,
    models: Mapping[str, Array],
    sampling: Sampling | None = None,
    report: Report = no_report,
    *,
    level: float = LEVEL,
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
        Of the parameters' intervals.
    """
    sampler = Sampler(response_model, sampling)
    data = [Answers.of(responses, judgments) for judgments in models.values()]
    units = units_of(responses)
    left_out: dict[Unit, dict[str, LeftOut]] = {unit: {} for unit in units}
    posteriors, summaries = sampler.posteriors(data), []
    for done, (name, one) in enumerate(zip(models, data, strict=True)):
        report(f"fitting {name}", done, len(models))
        posterior = next(posteriors)
        summaries.append(_summary(name, posterior, level))
        for unit in units:
            left_out[unit][name] = leave_out(unit, sampler, posterior, one)
    parameters = pd.concat(summaries, ignore_index=True)
    divergences = dict(zip(parameters["model"], parameters["divergences"], strict=True))
    loo = [row for unit in units for row in _rows(unit, left_out[unit], divergences)]
    pairs = [row for unit in units for row in _pairs(unit, left_out[unit])]
    return LooComparison(pd.DataFrame(loo), pd.DataFrame(pairs), parameters)


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


def _summary(name: str, posterior: Posterior, level: float) -> pd.DataFrame:
    summary = posterior.summary(PARAMETERS, level)
    summary.insert(0, "model", name)
    return summary


def _error(each: Array) -> float:
    """Standard error of a sum over units."""
    return float(np.sqrt(len(each)) * each.std(ddof=1))


def _told(difference: float, error: float) -> str:
    return "yes" if abs(difference) > TOLD * error else "no"


def _rows(
    unit: Unit, left_out: Mapping[str, LeftOut], divergences: Mapping[str, int]
) -> Sequence[dict[str, object]]:
    elpd = np.stack([one.elpd for one in left_out.values()])
    best = elpd[elpd.sum(axis=1).argmax()]
    weights = dict(zip(left_out, stacking_weights(elpd), strict=True))
    rows = []
    for name in sorted(left_out, key=lambda name: -left_out[name].elpd.sum()):
        one = left_out[name]
        below, error = float((best - one.elpd).sum()), _error(best - one.elpd)
        rows.append(
            {
                "unit": unit,
                "model": name,
                "elpd": float(one.elpd.sum()),
                "se": _error(one.elpd),
                "elpd_diff": below,
                "dse": error,
                "told": _told(below, error) if below else "-",
                "p_loo": float(one.p_loo.sum()),
                "weight": float(weights[name]),
                "largest_k": float(one.k.max()),
                "refitted": int(one.refitted.sum()),
                "divergences": int(divergences[name]),
            }
        )
    return rows


def _pairs(unit: Unit, left_out: Mapping[str, LeftOut]) -> Sequence[dict[str, object]]:
    names = list(left_out)
    rows = []
    for first, name in enumerate(names):
        for rival in names[first + 1 :]:
            each = left_out[name].elpd - left_out[rival].elpd
            difference, error = float(each.sum()), _error(each)
            rows.append(
                {
                    "unit": unit,
                    "model": name,
                    "rival": rival,
                    "difference": difference,
                    "se": error,
                    "told": _told(difference, error),
                }
            )
    return rows
