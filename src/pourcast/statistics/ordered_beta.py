"""Ordered beta regression with lapses: the density of single answers.

Kubinec (2023), "Ordered beta regression: a parsimonious, well-fitting model for continuous
data with lower and upper bounds", Political Analysis 31. With eta the linear predictor and
two cut points c1 < c2,

    P(y = 0) = 1 - logistic(eta - c1),    P(y = 1) = logistic(eta - c2),

and in between a beta density with mean logistic(eta) and precision phi; with the probability
`lapse` the answer is anywhere on the slider instead.

Needs the extra ``pourcast[bayes]``.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.nn import log_sigmoid, sigmoid
from numpy.typing import NDArray
from scipy.special import expit, logit

Array = NDArray[np.float64]

SHRINKAGE = 100.0
"""Judgments of 0 and 1 have no logit: they count as if by so many particles and a half more."""

LAPSE_ENDS = 0.01
"""Share of lapses that are exactly 0 or 1: the slider's step."""

_NEAREST = 1e-6
"""How near an answer between 0 and 1 may be to them."""

_FURTHEST = 30.0
"""Eta beyond which the mean is 0 or 1 to all digits, and no beta distribution has it."""


class Answering(NamedTuple):
    """How answers come from eta.

    Parameters
    ----------
    precision
        Of the beta density, phi.
    lapse
        Share of lapses.
    cut_low, cut_high
        The cut points.
    """

    precision: Any
    lapse: Any
    cut_low: Any
    cut_high: Any


def predictor(judgments: Array) -> Array:
    """Logit of judgments, drawn in from 0 and 1 a little.

    Examples
    --------
    >>> predictor(np.array([0.5, 1.0])).round(2).tolist()
    [0.0, 5.3]
    """
    x: Array = logit((judgments * SHRINKAGE + 0.5) / (SHRINKAGE + 1.0))
    return x


def answering_priors() -> dict[str, dist.Distribution]:
    """Weakly informative priors of how answers come from eta; `cut_gap` lies between the cuts."""
    return {
        "precision": dist.LogNormal(2.0, 1.0),
        "lapse": dist.Beta(1.0, 15.0),
        "cut_low": dist.Normal(-4.0, 1.5),
        "cut_gap": dist.LogNormal(2.0, 0.5),
    }


def sample_answering() -> Answering:
    """Draw how answers come from eta, from their priors."""
    drawn = {name: numpyro.sample(name, prior) for name, prior in answering_priors().items()}
    cut_high = numpyro.deterministic("cut_high", drawn["cut_low"] + drawn["cut_gap"])
    return Answering(drawn["precision"], drawn["lapse"], drawn["cut_low"], cut_high)


def stretch(spread: Any, information: Any) -> Any:
    """How many times further than effect / spread a chain goes. See `sample_effects`."""
    return jnp.sqrt(1.0 + information * spread**2)


def sample_effects(
    name: str, spread: Any, information: Any, design: Any, inverse: Any
) -> tuple[Any, Any]:
    """Draw independent normal effects of participants, or of scenes, about 0.

    Where answers say little of an effect, a chain moves well through effect / spread; where they
    say much, through the effect itself (Papaspiliopoulos, Roberts & Sköld 2007, Statistical
    Science 22): it goes through what lies between the two, by how much they say. What all effects
    have in common with coefficients of the population, answers say nothing of.

    Parameters
    ----------
    name
        Of the effects.
    spread
        Their standard deviation.
    information
        What answers say of one effect: about one over its squared error without a prior.
    design
        What coefficients of the population multiply, shape [count, coefficient_count].
    inverse
        Its pseudo-inverse.

    Returns
    -------
    Array, Array
        The effects, shape [count], and the coefficients that they look like, shape
        [coefficient_count].
    """
    real = dist.ImproperUniform(dist.constraints.real, (), (len(design),))
    z = numpyro.sample(f"{name}_z", real)
    common = design @ (inverse @ z)
    own = z - common
    further = stretch(spread, information)
    free = len(design) - (design * inverse.T).sum()
    squares = (common**2).sum() + ((own / further) ** 2).sum()
    numpyro.factor(f"{name}_prior", -0.5 * squares - free * jnp.log(further))
    effects = numpyro.deterministic(name, spread * (common + own / further))
    return effects, inverse @ effects


def sample_coefficient(name: str, prior: dist.Normal, common: Any) -> Any:
    """Draw a coefficient of the population, by way of what it is in these data.

    Parameters
    ----------
    name
        Of the coefficient.
    prior
        Of it.
    common
        What effects look like it: with them it is what answers tell well.
    """
    here = numpyro.sample(f"{name}_here", dist.Normal(prior.loc + common, prior.scale))
    return numpyro.deterministic(name, here - common)


def log_gamma(x: Any) -> Any:
    """Logarithm of the gamma function of positive numbers; JAX's own takes most of a fit's time.

    Stirling's series at x + 4, exact to single precision, and the recurrence down from there.
    """
    z = x + 4.0
    inverse = 1.0 / z
    series = inverse * (1.0 / 12.0 - inverse**2 * (1.0 / 360.0 - inverse**2 / 1260.0))
    down = jnp.log(x * (x + 1.0) * (x + 2.0) * (x + 3.0))
    return (z - 0.5) * jnp.log(z) - z + 0.5 * np.log(2.0 * np.pi) + series - down


def log_density(answers: Any, eta: Any, answering: Answering) -> Any:
    """Log density of answers, or of their probability if they are 0 or 1, by JAX.

    Parameters
    ----------
    answers
        In 0..1.
    eta
        Linear predictor; of the same shape, or one that goes with it.
    answering
        How answers come from it.
    """
    precision, lapse, low, high = answering
    mean = sigmoid(eta)
    inner = jnp.clip(answers, _NEAREST, 1.0 - _NEAREST)
    gap = jnp.maximum(sigmoid(eta - low) - sigmoid(eta - high), 1e-30)
    a, b = mean * precision, (1.0 - mean) * precision
    # Written out: the first term is one number, and the logarithms don't change.
    between = jnp.log(gap) + log_gamma(precision) - log_gamma(a) - log_gamma(b)
    between += (a - 1.0) * jnp.log(inner) + (b - 1.0) * jnp.log1p(-inner)
    ends = jnp.where(answers <= 0.0, log_sigmoid(low - eta), log_sigmoid(eta - high))
    at_end = (answers <= 0.0) | (answers >= 1.0)
    attentive = jnp.log1p(-lapse) + jnp.where(at_end, ends, between)
    lapsed = jnp.log(lapse) + jnp.where(at_end, np.log(LAPSE_ENDS / 2.0), np.log1p(-LAPSE_ENDS))
    return jnp.logaddexp(attentive, lapsed)


def draw_answers(eta: Array, answering: Answering, rng: np.random.Generator) -> Array:
    """Draw answers, by NumPy.

    Parameters
    ----------
    eta
        Linear predictor.
    answering
        How answers come from it; numbers, or arrays that go with eta.
    rng
        Source of randomness.

    Returns
    -------
    ndarray
        In 0..1, shaped as eta.
    """
    precision, lapse, low, high = answering
    mean = expit(np.clip(eta, -_FURTHEST, _FURTHEST))
    between = rng.beta(mean * precision, (1.0 - mean) * precision)
    place = rng.random(eta.shape)
    answers = np.clip(between, _NEAREST, 1.0 - _NEAREST)
    answers[place < expit(low - eta)] = 0.0
    answers[place > expit(high - eta)] = 1.0
    anywhere = np.clip((rng.random(eta.shape) - LAPSE_ENDS / 2.0) / (1.0 - LAPSE_ENDS), 0.0, 1.0)
    return np.where(rng.random(eta.shape) < lapse, anywhere, answers)
