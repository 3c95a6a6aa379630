"""How well the response model predicts a scene, or a participant, that was left out.

The unit is what a conclusion is to hold over: other scenes, or other people. All answers of a
unit are predicted together, and so is its own effect, which is integrated out: what a model says
of a scene whose answers nobody has seen (Merkle, Furr & Rabe-Hesketh 2019, Psychometrika 84). Of
a participant, scenes' effects are integrated out, too, by what the others answered: one of ten
says so much of them that no weights could take it back.

The posterior without the unit is that with it, weighted by Pareto-smoothed importance sampling
(Vehtari, Simpson, Gelman, Yao & Gabry 2024, Journal of Machine Learning Research 25); where the
Pareto k says that this can't be relied on, the model is fitted again without the unit.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import jax
import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from scipy.special import logsumexp

from pourcast.statistics.nuts import Posterior, Sampler
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
from pourcast.statistics.response_model import Answers

Array = NDArray[np.float64]

Unit = Literal["scenes", "participants"]
"""What is left out, one at a time."""
UNITS: tuple[Unit, ...] = get_args(Unit)

_SCENE_NODES, _KNOWN_SCENE_NODES, _PARTICIPANT_NODES = 15, 7, 5
"""Of Gauss-Hermite quadrature along each effect: of a scene that nobody has answered, of one that
others have answered, and of a participant."""


@dataclass(frozen=True)
class LeftOut:
    """Predictions of units that were left out, each of shape [unit_count].

    Parameters
    ----------
    elpd
        Log density of the unit's answers by the posterior without it.
    p_loo
        How much lower that is than by the posterior with it: effective parameters.
    k
        Pareto k of the weights.
    refitted
        Where k was too high, so that the model was fitted again.
    """

    elpd: Array
    p_loo: Array
    k: Array
    refitted: NDArray[np.bool_]


def leave_out(unit: Unit, sampler: Sampler, posterior: Posterior, data: Answers) -> LeftOut:
    """Leave out scenes, or participants, one at a time.

    Parameters
    ----------
    unit
        Which.
    sampler
        Of the response model, to fit it again.
    posterior
        Of all answers.
    data
        All answers.
    """
    kind = _KINDS[unit]
    places = places_of(posterior, data)
    everything = np.arange(data.answers.shape[kind.axis])
    likelihood = kind.likelihood(posterior, data, places, everything)
    weights, k = array_stats.psislw(likelihood, axis=0)
    elpd = logsumexp(weights.T + likelihood, axis=0)
    refitted = _high(np.asarray(k), len(likelihood))
    again = np.flatnonzero(refitted)
    without = [data._replace(answered=_without(data.answered, one, kind.axis)) for one in again]
    for one, other in zip(again, sampler.posteriors(without), strict=True):
        elpd[one] = _log_mean(kind.likelihood(other, data, places, np.array([one])))[0]
    return LeftOut(elpd, _log_mean(likelihood) - elpd, np.asarray(k), refitted)


def largest_k(draws: int) -> float:
    """Pareto k above which so many draws don't do (Vehtari et al. 2024, eq. 13).

    Examples
    --------
    >>> largest_k(4000), round(largest_k(500), 2)
    (0.7, 0.63)
    """
    return float(min(1.0 - 1.0 / np.log10(draws), 0.7))


def _high(k: Array, draws: int) -> NDArray[np.bool_]:
    return k > largest_k(draws)


def _log_mean(log_values: Array) -> Array:
    return np.asarray(logsumexp(log_values, axis=0) - np.log(len(log_values)))


def _without(answered: NDArray[np.bool_], one: np.intp, axis: int) -> NDArray[np.bool_]:
    left = answered.copy()
    left[(slice(None),) * axis + (one,)] = False
    return left


def _scenes_of_draw(draw: Mapping[str, Any], data: Answers, places: Places, which: Any) -> Any:
    """Log likelihood of scenes that nobody has answered."""
    own, prior = scene_nodes(draw, places, _SCENE_NODES)
    eta = without_scenes(draw, data)[:, which, None] + own[which]
    some = data._replace(answers=data.answers[:, which], answered=data.answered[:, which])
    return _log_sum(density(draw, some, eta).sum(axis=0) + prior[which])


def _participants_of_draw(
    draw: Mapping[str, Any], data: Answers, places: Places, which: Any
) -> Any:
    """Log likelihood of participants, by what the others answered."""
    scenes, prior = scene_nodes(draw, places, _KNOWN_SCENE_NODES)
    each = density(draw, data, without_scenes(draw, data)[..., None] + scenes)
    others = each.sum(axis=0) + prior - each[which]
    others -= _log_sum(others)[..., None]
    u, v, weights = (
        values[which] for values in participant_nodes(draw, places, _PARTICIPANT_NODES)
    )
    line = draw["intercept"] + u[:, None] + v[:, None] * data.x[:, None]
    eta = line[:, :, None] + scenes[:, :, None]
    some = data._replace(answers=data.answers[which], answered=data.answered[which])
    predicted = jax.nn.logsumexp(density(draw, some, eta) + others[..., None], axis=2)
    return _log_sum(predicted.sum(axis=1) + weights)


def _log_sum(values: Any) -> Any:
    """Logarithm of the sum over nodes."""
    return jax.nn.logsumexp(values, axis=-1)


class _Kind(NamedTuple):
    """A kind of unit: its axis, its likelihood by one draw, and by how many of them it is had."""

    axis: int
    of_draw: Callable[..., Any]
    most_draws: int

    def likelihood(
        self, posterior: Posterior, data: Answers, places: Places, which: NDArray[np.intp]
    ) -> Array:
        """Log likelihood of some units without their own effects, a row a draw."""
        drawn = {name: posterior.flat(name, self.most_draws) for name in DRAWN}
        return np.asarray(over_draws(self.of_draw, drawn, data, places, which), dtype=float)


_KINDS: dict[Unit, _Kind] = {
    "scenes": _Kind(1, _scenes_of_draw, 2000),
    "participants": _Kind(0, _participants_of_draw, 500),
}
