"""Effects of scenes and of participants, integrated out by Gauss-Hermite quadrature.

Nodes lie about where effects are in the posterior, on the scale of `ordered_beta.sample_effects`,
on which that depends little on their spread.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm
from numpy.polynomial.hermite_e import hermegauss
from numpy.typing import NDArray

from pourcast.statistics.nuts import Posterior
from pourcast.statistics.ordered_beta import Answering, log_density, stretch
from pourcast.statistics.response_model import Answers, Information, Predictor, information

Array = NDArray[np.float64]

DRAWN = (*Predictor._fields, "spread_intercept", "spread_slope", "spread_scene",
         *Answering._fields)  # fmt: skip
"""What a draw must hold."""


class Places(NamedTuple):
    """Where effects lie, on their scale: mean, and root of the covariance."""

    scene: Any
    scene_root: Any
    participant: Any
    participant_root: Any
    known: Information


def places_of(posterior: Posterior, data: Answers) -> Places:
    """Where effects lie in a posterior."""
    known = information(data.answered, data.x)
    scene = _on_their_scale(posterior, "scene", "spread_scene", known.scene)
    intercept = _on_their_scale(
        posterior, "participant_intercept", "spread_intercept", known.intercept
    )
    slope = _on_their_scale(posterior, "participant_slope", "spread_slope", known.slope)
    own = np.stack([intercept, slope], axis=-1)
    centred = own - own.mean(axis=0)
    root = np.linalg.cholesky(np.einsum("dpi,dpj->pij", centred, centred) / len(own))
    return Places(scene.mean(axis=0), scene.std(axis=0), own.mean(axis=0), root, known)


def _scale(spread: Any, known: Any) -> Any:
    return spread / stretch(spread, known)


def _on_their_scale(posterior: Posterior, name: str, spread: str, known: float) -> Array:
    scale = np.asarray(_scale(posterior.flat(spread), known))
    own: Array = posterior.flat(name) / scale[:, None]
    return own


def _nodes(count: int) -> tuple[Array, Array]:
    """Nodes, and log weights for an integral of a function that has no normal density in it."""
    nodes, weights = hermegauss(count)
    return nodes, np.log(weights) + 0.5 * nodes**2


def density(draw: Mapping[str, Any], data: Answers, eta: Any) -> Any:
    """Log density of each answer, 0 where there is none; at nodes on further axes of eta."""
    nodes = (1,) * (eta.ndim - 2)
    answering = Answering(*(draw[name] for name in Answering._fields))
    each = log_density(data.answers.reshape(*data.answers.shape, *nodes), eta, answering)
    return jnp.where(data.answered.reshape(*data.answered.shape, *nodes), each, 0.0)


def eta_of(draw: Mapping[str, Any], data: Answers) -> Any:
    """Eta at a draw, shape [participant_count, scene_count]."""
    return Predictor(*(draw[name] for name in Predictor._fields)).eta(data.x)


def without_scenes(draw: Mapping[str, Any], data: Answers) -> Any:
    """The same without scenes' effects."""
    return eta_of({**draw, "scene": jnp.zeros(1)}, data)


def scene_nodes(draw: Mapping[str, Any], places: Places, count: int) -> tuple[Any, Any]:
    """Effects of scenes at nodes, and log weights times prior; both [scene_count, count]."""
    nodes, log_weights = _nodes(count)
    own = places.scene[:, None] + places.scene_root[:, None] * nodes
    spread, known = draw["spread_scene"], places.known.scene
    prior = norm.logpdf(own, 0.0, stretch(spread, known)) + jnp.log(places.scene_root)[:, None]
    return _scale(spread, known) * own, prior + log_weights


def participant_nodes(draw: Mapping[str, Any], places: Places, count: int) -> tuple[Any, Any, Any]:
    """Intercepts and slopes of participants at pairs of nodes, and log weights times prior.

    All of shape [participant_count, count**2].
    """
    nodes, log_weights = _nodes(count)
    pairs = np.stack([each.ravel() for each in np.meshgrid(nodes, nodes)])
    own = places.participant[:, :, None] + places.participant_root @ pairs
    spreads = (draw["spread_intercept"], draw["spread_slope"])
    known = (places.known.intercept, places.known.slope)
    u, v = (_scale(*each) * own[:, k] for k, each in enumerate(zip(spreads, known, strict=True)))
    prior = jnp.log(jnp.diagonal(places.participant_root, axis1=1, axis2=2)).sum(axis=1)[:, None]
    for k, each in enumerate(zip(spreads, known, strict=True)):
        prior += norm.logpdf(own[:, k], 0.0, stretch(*each))
    return u, draw["slope"] + v, prior + np.add.outer(log_weights, log_weights).ravel()


@partial(jax.jit, static_argnums=0)
def over_draws(one: Callable[..., Any], drawn: Mapping[str, Any], *rest: Any) -> Any:
    """A function of a draw, and of the rest, at each draw."""
    return jax.lax.map(lambda draw: one(draw, *rest), drawn)
