"""Whether people judge two liquids as differently as a model does, and in its direction.

Each participant judges the same scenes with both liquids. With x the logit of a model's judgment,
m_s its mean over the two and d_s its difference (the second liquid minus the first), an answer
comes by `ordered_beta` from

    eta = intercept + u_p + w_s + (slope + v_p) m_s +- [shift + b_p + t_s + (sensitivity + c_p) d_s] / 2,

plus for the second liquid, minus for the first. Both the participant and the scene have effects of
their own on what the liquid changes: without them, answers to one scene, or of one person, would
count as independent, and intervals be too narrow (Barr, Levy, Scheepers & Tily 2013, Journal of
Memory and Language 68).

Needs the extra ``pourcast[bayes]``.
"""  # noqa: E501 (a formula)

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pandas as pd
from numpy.typing import NDArray

from pourcast.progress import Report, no_report
from pourcast.statistics.jackknife import LEVEL
from pourcast.statistics.nuts import Posterior, Sampler
from pourcast.statistics.ordered_beta import (
    log_density,
    predictor,
    sample_answering,
    sample_coefficient,
    sample_effects,
)
from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]

HALVES = np.array([-0.5, 0.5])[:, None, None]
"""How much of the difference is in each liquid."""


class BothLiquids(NamedTuple):
    """Data of two liquids and a model.

    Parameters
    ----------
    answers
        Shape [2, participant_count, scene_count], 0..1; anything where there is none.
    answered
        Where there are answers.
    mean, difference
        Of the logit of the model's judgments, shape [scene_count].
    mean_line, difference_line
        Pseudo-inverses of the designs of a line in them, shape [2, scene_count].
    """

    answers: Array
    answered: NDArray[np.bool_]
    mean: Array
    difference: Array
    mean_line: Array
    difference_line: Array

    @staticmethod
    def of(responses: Array, judgments: Array) -> "BothLiquids":
        """Data from responses, NaN where there is no answer, and judgments, [2, scene_count]."""
        answered, (first, second) = np.isfinite(responses), predictor(judgments)
        mean, difference = 0.5 * (first + second), second - first
        lines = (np.linalg.pinv(np.asarray(_design(each))) for each in (mean, difference))
        return BothLiquids(np.where(answered, responses, 0.5), answered, mean, difference, *lines)


def _design(x: Any) -> Any:
    return jnp.stack([jnp.ones_like(x), x], axis=1)


def liquid_model(
    answers: Any,
    answered: Any,
    mean: Any,
    difference: Any,
    mean_line: Any,
    difference_line: Any,
) -> None:
    """The model, for NumPyro. See `BothLiquids`."""
    _, people, scenes = answers.shape
    each, count = answered.sum() / people, answered.sum() / scenes
    answering = sample_answering()
    everybody = jnp.ones((people, 1)), jnp.full((1, people), 1.0 / people)

    def of_participants(name: str, spread: float, multiplied: Any) -> tuple[Any, Any]:
        own = numpyro.sample(f"spread_{name}", dist.HalfNormal(spread))
        return sample_effects(f"participant_{name}", own, each * (multiplied**2).mean(), *everybody)

    def of_scenes(name: str, x: Any, line: Any, multiplied: float) -> tuple[Any, Any]:
        own = numpyro.sample(f"spread_scene_{name}", dist.HalfNormal(1.0))
        return sample_effects(f"scene_{name}", own, count * multiplied**2, _design(x), line)

    u, level = of_participants("intercept", 0.5, jnp.ones(1))
    v, steepness = of_participants("slope", 0.3, mean)
    b, shifted = of_participants("shift", 0.5, 0.5 * jnp.ones(1))
    c, sensed = of_participants("sensitivity", 0.3, 0.5 * difference)
    w, in_mean = of_scenes("intercept", mean, mean_line, 1.0)
    t, in_difference = of_scenes("shift", difference, difference_line, 0.5)
    intercept = sample_coefficient("intercept", dist.Normal(0.0, 1.0), level[0] + in_mean[0])
    slope = sample_coefficient("slope", dist.Normal(0.5, 0.5), steepness[0] + in_mean[1])
    shift = sample_coefficient("shift", dist.Normal(0.0, 1.0), shifted[0] + in_difference[0])
    # Centred on 0: no direction is taken for granted.
    sensitivity = sample_coefficient(
        "sensitivity", dist.Normal(0.0, 1.0), sensed[0] + in_difference[1]
    )
    middle = intercept + w + u[:, None] + (slope + v[:, None]) * mean
    apart = shift + t + b[:, None] + (sensitivity + c[:, None]) * difference
    density = log_density(answers, middle + HALVES * apart, answering)
    numpyro.factor("answers", jnp.where(answered, density, 0.0).sum())


_DIAGNOSTICS = ["r_hat", "ess_bulk", "ess_tail", "divergences"]


def liquid_effects(
    responses: Array,
    models: Mapping[str, Array],
    sampling: Sampling | None = None,
    report: Report = no_report,
    *,
    level: float = LEVEL,
) -> pd.DataFrame:
    """People's sensitivity to what each model says that the liquid changes.

    Parameters
    ----------
    responses
        Shape [2, participant_count, scene_count]; NaN where there is no answer.
    models
        Name -> judgments, shape [2, scene_count], of which some differ between the liquids.
    sampling
        How posteriors are drawn.
    report
        Told of the progress.
    level
        Of the intervals.

    Returns
    -------
    DataFrame
        A row a model: `model`; `sensitivity`, people's slope on the model's difference, with
        `_low` and `_high`; `probability` that it is above 0: that people's judgments change in the
        model's direction; `relative`, the sensitivity over the slope on the model's mean judgments
        (median and quantiles), 1 if people are as sensitive to the liquid as to the scene; then
        `r_hat`, `ess_bulk`, `ess_tail`, `divergences`.
    """
    data = [BothLiquids.of(responses, judgments) for judgments in models.values()]
    posteriors, rows = Sampler(liquid_model, sampling).posteriors(data), []
    for done, name in enumerate(models):
        report(f"fitting the liquid's effect: {name}", done, len(models))
        rows.append({"model": name, **_row(next(posteriors), level)})
    return pd.DataFrame(rows)


def _row(posterior: Posterior, level: float) -> dict[str, float]:
    [found] = posterior.summary(["sensitivity"], level).to_dict("records")
    sensitivity = posterior.flat("sensitivity")
    tails = (0.5 - level / 2.0, 0.5, 0.5 + level / 2.0)
    low, middle, high = np.quantile(sensitivity / posterior.flat("slope"), tails)
    return {
        "sensitivity": found["mean"],
        "sensitivity_low": found["low"],
        "sensitivity_high": found["high"],
        "probability": float((sensitivity > 0.0).mean()),
        "relative": float(middle),
        "relative_low": float(low),
        "relative_high": float(high),
        **{name: found[name] for name in _DIAGNOSTICS},
    }
