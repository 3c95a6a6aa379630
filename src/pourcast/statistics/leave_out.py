"""How well the response model predicts a scene, or a participant, that was left out.

The unit is what a conclusion is to hold over: other scenes, or other people. All answers of a
unit are predicted together, and so is its own effect, which is integrated out: what a model says
of a scene whose answers nobody has seen (Merkle, Furr & Rabe-Hesketh 2019, Psychometrika 84). The
posterior without the unit is that with it, weighted by Pareto-smoothed importance sampling
(Vehtari, Simpson, Gelman, Yao & Gabry 2024, Journal of Machine Learning Research 25); where the
Pareto k says that this can't be relied on, the model is fitted again without the unit.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from arviz_stats.base import array_stats
from jax.scipy.stats import norm
from numpy.polynomial.hermite_e import hermegauss
from numpy.typing import NDArray
from scipy.special import logsumexp

from pourcast.statistics.nuts import Posterior, Sampler
from pourcast.statistics.ordered_beta import Answering, log_density, stretch
from pourcast.statistics.response_model import Answers, Information, information

Array = NDArray[np.float64]

Unit = Literal["scenes", "participants"]
"""What is left out, one at a time."""
UNITS: tuple[Unit, ...] = get_args(Unit)

_SCENE_NODES, _PARTICIPANT_NODES = 15, 9
"""Of Gauss-Hermite quadrature along each effect."""


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
    places = kind.places(posterior, data)
    likelihood = kind.likelihood(posterior, data, places)
    weights, k = array_stats.psislw(likelihood, axis=0)
    elpd = logsumexp(weights.T + likelihood, axis=0)
    refitted = _high(np.asarray(k), len(likelihood))
    again = np.flatnonzero(refitted).tolist()
    without = [data._replace(answered=_without(data.answered, one, kind.axis)) for one in again]
    for one, other in zip(again, sampler.posteriors(without), strict=True):
        own = kind.likelihood(other, _only(data, one, kind.axis), places.only(one))
        elpd[one] = _log_mean(own)[0]
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


def _without(answered: NDArray[np.bool_], one: int, axis: int) -> NDArray[np.bool_]:
    left = answered.copy()
    left[(slice(None),) * axis + (one,)] = False
    return left


def _only(data: Answers, one: int, axis: int) -> Answers:
    own = (slice(None),) * axis + ([one],)
    x = data.x[[one]] if axis else data.x
    return data._replace(answers=data.answers[own], answered=data.answered[own], x=x)


# Effects, integrated out by Gauss-Hermite quadrature about where they lie in the posterior, on the
# scale of `sample_effects`, on which that depends little on their spread --------------------------


class _Places(NamedTuple):
    """Where effects of each unit lie, on their scale: mean, and root of the covariance."""

    mean: Any
    root: Any
    known: Information

    def only(self, one: int) -> "_Places":
        return self._replace(mean=self.mean[[one]], root=self.root[[one]])


def _scene_places(posterior: Posterior, data: Answers) -> _Places:
    known = information(data.answered, data.x)
    own = posterior.flat("scene") / _scale(posterior.flat("spread_scene"), known.scene)[:, None]
    return _Places(own.mean(axis=0), own.std(axis=0), known)


def _participant_places(posterior: Posterior, data: Answers) -> _Places:
    known = information(data.answered, data.x)
    intercept = _scale(posterior.flat("spread_intercept"), known.intercept)[:, None]
    slope = _scale(posterior.flat("spread_slope"), known.slope)[:, None]
    own = np.stack(
        [posterior.flat("participant_intercept") / intercept,
         posterior.flat("participant_slope") / slope], axis=-1,
    )  # fmt: skip
    centred = own - own.mean(axis=0)
    covariance = np.einsum("dpi,dpj->pij", centred, centred) / len(own)
    return _Places(own.mean(axis=0), np.linalg.cholesky(covariance), known)


def _scale(spread: Any, known: Any) -> Any:
    return spread / stretch(spread, known)


def _nodes(count: int) -> tuple[Array, Array]:
    """Nodes, and log weights for an integral of a function that has no normal density in it."""
    nodes, weights = hermegauss(count)
    return nodes, np.log(weights) + 0.5 * nodes**2


def _scenes_of_draw(draw: Mapping[str, Any], data: Answers, places: _Places) -> Any:
    nodes, log_weights = _nodes(_SCENE_NODES)
    own = places.mean[:, None] + places.root[:, None] * nodes
    spread, known = draw["spread_scene"], places.known.scene
    slopes = draw["slope"] + draw["participant_slope"]
    eta = draw["intercept"] + draw["participant_intercept"][:, None] + slopes[:, None] * data.x
    total = _total(draw, data, eta[..., None] + _scale(spread, known) * own, 0)
    total += norm.logpdf(own, 0.0, stretch(spread, known)) + log_weights
    return jax.nn.logsumexp(total, axis=-1) + jnp.log(places.root)


def _participants_of_draw(draw: Mapping[str, Any], data: Answers, places: _Places) -> Any:
    nodes, log_weights = _nodes(_PARTICIPANT_NODES)
    pairs = np.stack([each.ravel() for each in np.meshgrid(nodes, nodes)])
    own = places.mean[:, :, None] + places.root @ pairs
    intercept, slope = draw["spread_intercept"], draw["spread_slope"]
    u = _scale(intercept, places.known.intercept) * own[:, [0]]
    v = draw["slope"] + _scale(slope, places.known.slope) * own[:, [1]]
    eta = draw["intercept"] + draw["scene"][:, None] + u + v * data.x[:, None]
    total = _total(draw, data, eta, 1) + np.add.outer(log_weights, log_weights).ravel()
    total += norm.logpdf(own[:, 0], 0.0, stretch(intercept, places.known.intercept))
    total += norm.logpdf(own[:, 1], 0.0, stretch(slope, places.known.slope))
    area = jnp.log(places.root[:, 0, 0]) + jnp.log(places.root[:, 1, 1])
    return jax.nn.logsumexp(total, axis=-1) + area


def _total(draw: Mapping[str, Any], data: Answers, eta: Any, axis: int) -> Any:
    """Log density of all answers of each unit, at each node (the last axis)."""
    answering = Answering(*(draw[name] for name in Answering._fields))
    density = log_density(data.answers[..., None], eta, answering)
    return jnp.where(data.answered[..., None], density, 0.0).sum(axis=axis)


@partial(jax.jit, static_argnums=0)
def _over_draws(one: Callable[..., Any], drawn: Mapping[str, Any], *rest: Any) -> Any:
    return jax.lax.map(lambda draw: one(draw, *rest), drawn)


class _Kind(NamedTuple):
    """A kind of unit: its axis, where its effects lie, and its likelihood by one draw."""

    axis: int
    places: Callable[[Posterior, Answers], _Places]
    of_draw: Callable[..., Any]

    def likelihood(self, posterior: Posterior, data: Answers, places: _Places) -> Array:
        """Log likelihood of each unit without its own effects, shape [draw_count, unit_count]."""
        drawn = {name: posterior.flat(name) for name in _DRAWN}
        return np.asarray(_over_draws(self.of_draw, drawn, data, places), dtype=float)


_DRAWN = ("intercept", "slope", "spread_intercept", "spread_slope", "spread_scene",
          "participant_intercept", "participant_slope", "scene", *Answering._fields)  # fmt: skip

_KINDS: dict[Unit, _Kind] = {
    "scenes": _Kind(1, _scene_places, _scenes_of_draw),
    "participants": _Kind(0, _participant_places, _participants_of_draw),
}
