"""Whether a posterior depends on its priors, by power-scaling.

Kallioinen, Paananen, Bürkner & Vehtari (2024), "Detecting and diagnosing prior and likelihood
sensitivity with power-scaling", Statistics and Computing 34: the prior, or the likelihood, is
raised to a power a little off 1, the posterior follows by Pareto-smoothed importance sampling, and
the sensitivity is how far a parameter's distribution moves (cumulative Jensen-Shannon distance)
for each doubling. The measure is ArviZ's.

Scaled are the priors of what is estimated for the population. The normal distributions of effects
are part of the model, not of its prior: they stay as they are.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
import pandas as pd
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

from pourcast.statistics.nuts import Posterior
from pourcast.statistics.quadrature import (
    DRAWN,
    Places,
    density,
    over_draws,
    participant_nodes,
    places_of,
    scene_nodes,
    without_scenes,
)
from pourcast.statistics.response_model import PARAMETERS, Answers, priors

Array = NDArray[np.float64]

SENSITIVE = 0.05
"""Sensitivity from which on it counts (Kallioinen et al. 2024)."""

CONFLICT, STRONG_PRIOR = "prior and data may differ", "prior says more than data"
"""What it may mean that a parameter is sensitive to priors: if it is sensitive to the data, too,
that they say different things (a conflict of prior and data); if not, that the data say little."""

_POWERS = (0.99, 1.01)

_SCENE_NODES, _PARTICIPANT_NODES = 7, 4
"""Of quadrature along each effect; fewer leave more of what comes from effects alone."""


def log_prior(draws: Mapping[str, Array]) -> Array:
    """Log density of the priors at each draw, shape [draw_count].

    Parameters
    ----------
    draws
        Of what `response_model.priors` names, shape [draw_count].
    """
    densities = [np.asarray(prior.log_prob(draws[name])) for name, prior in priors().items()]
    total: Array = np.sum(densities, axis=0, dtype=float)
    return total


def log_likelihood(draws: Mapping[str, Array], data: Answers, places: Places) -> Array:
    """Log density of all answers at each draw, without most of what comes from effects alone.

    Only its mean over effects, given all else, moves a parameter of the population; the rest would
    be noise of the sensitivity, about its threshold where there are many effects. So scenes'
    effects, and participants', are in turn replaced by the mean over them; of what comes from both
    only their interplay is left.

    Parameters
    ----------
    draws
        Of `quadrature.DRAWN`.
    data
        The answers.
    places
        Where effects lie in the posterior.

    Returns
    -------
    ndarray
        Shape [draw_count].
    """
    drawn = {name: draws[name] for name in DRAWN}
    return np.asarray(over_draws(_of_draw, drawn, data, places), dtype=float)


def _of_draw(draw: Mapping[str, Any], data: Answers, places: Places) -> Any:
    line = without_scenes(draw, data)
    scene, scene_prior = scene_nodes(draw, places, _SCENE_NODES)
    of_scenes = density(draw, data, line[..., None] + scene).sum(axis=0)
    u, v, participant_prior = participant_nodes(draw, places, _PARTICIPANT_NODES)
    level = draw["intercept"] + draw["scene"]
    eta = level[:, None] + u[:, None] + v[:, None] * data.x[:, None]
    of_participants = density(draw, data, eta).sum(axis=1)
    return (
        _mean(of_scenes, scene_prior)
        + _mean(of_participants, participant_prior)
        - density(draw, data, line + draw["scene"]).sum()
    )


def _mean(log_densities: Any, prior: Any) -> Any:
    """Sum of log densities, each its mean over nodes by the posterior of the effect."""
    return (jax.nn.softmax(log_densities + prior, axis=-1) * log_densities).sum()


def sensitivity(draws: Array, log_component: Array) -> float:
    """How far a parameter's distribution moves as prior, or likelihood, is raised to a power.

    Parameters
    ----------
    draws
        Of the parameter, shape [draw_count].
    log_component
        Log of what is raised, at each draw, shape [draw_count].
    """
    logs = [array_stats.power_scale_lw(log_component, alpha=power) for power in _POWERS]
    # As one chain: without one, ArviZ 0.8 fails.
    weights = [np.exp(log - logsumexp(log))[None] for log in logs]
    return float(array_stats.power_scale_sense(draws[None], *weights, *_POWERS))


def prior_sensitivity(
    posterior: Posterior, data: Answers, names: Sequence[str] = PARAMETERS
) -> pd.DataFrame:
    """Sensitivity of parameters to the priors, and to the data.

    Parameters
    ----------
    posterior
        Of the response model.
    data
        What it was fitted to.
    names
        Of parameters.

    Returns
    -------
    DataFrame
        A row a parameter: `prior_sensitivity`, `likelihood_sensitivity`, and `diagnosis`:
        `CONFLICT`, `STRONG_PRIOR`, or nothing.
    """
    draws = {name: posterior.flat(name) for name in {*names, *priors(), *DRAWN}}
    parts = log_prior(draws), log_likelihood(draws, data, places_of(posterior, data))
    to_prior, to_data = (
        np.array([sensitivity(draws[name].astype(float), part) for name in names]) for part in parts
    )
    why = np.where(to_data >= SENSITIVE, CONFLICT, STRONG_PRIOR)
    return pd.DataFrame(
        {
            "prior_sensitivity": to_prior,
            "likelihood_sensitivity": to_data,
            "diagnosis": np.where(to_prior >= SENSITIVE, why, ""),
        }
    )
