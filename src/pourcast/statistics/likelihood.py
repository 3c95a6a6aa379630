"""Likelihood of single answers: ordered beta regression with participant effects and lapses.

Kubinec (2023), "Ordered beta regression: a parsimonious, well-fitting model for continuous
data with lower and upper bounds", Political Analysis 31. With eta the linear predictor and
two cut points c1 < c2,

    P(y = 0) = 1 - logistic(eta - c1),    P(y = 1) = logistic(eta - c2),

and in between a beta density with mean logistic(eta) and precision phi. Here

    eta = intercept + u_p + (slope + v_p) x,    x = logit of the model's judgment,

with normal effects u_p, v_p of the participant; with the probability `lapse` the answer
is anywhere on the slider instead.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, log_expit, logit
from scipy.stats import beta

Array = NDArray[np.float64]

SHRINKAGE = 100.0
"""Judgments of 0 and 1 have no logit: they count as if by so many particles and a half more."""

LAPSE_ENDS = 0.01
"""Share of lapses that are exactly 0 or 1: the slider's step."""


def predictor(judgments: Array) -> Array:
    """Logit of judgments, drawn in from 0 and 1 a little.

    Examples
    --------
    >>> predictor(np.array([0.5, 1.0])).round(2).tolist()
    [0.0, 5.3]
    """
    found: Array = logit((judgments * SHRINKAGE + 0.5) / (SHRINKAGE + 1.0))
    return found


def ordered_beta_log_density(
    answers: Array, eta: Array, precision: Array | float, cuts: tuple[float, float], lapse: float
) -> Array:
    """Logarithm of the density of answers, or of their probability if they are 0 or 1.

    Parameters
    ----------
    answers
        In 0..1.
    eta
        Linear predictor, of the same shape.
    precision
        Of the beta density.
    cuts
        c1 and c2.
    lapse
        Share of lapses.
    """
    low, high = cuts
    mean = expit(eta)
    inner = np.clip(answers, 1e-6, 1.0 - 1e-6)
    between = (
        np.log(np.maximum(expit(eta - low) - expit(eta - high), 1e-300))
        + beta.logpdf(inner, mean * precision, (1.0 - mean) * precision)
    )  # fmt: skip
    ends = np.where(answers <= 0.0, log_expit(low - eta), log_expit(eta - high))
    at_end = (answers <= 0.0) | (answers >= 1.0)
    with np.errstate(divide="ignore"):
        attentive = np.log1p(-lapse) + np.where(at_end, ends, between)
        lapsed = np.log(lapse) + np.where(at_end, np.log(LAPSE_ENDS / 2.0), np.log1p(-LAPSE_ENDS))
    found: Array = np.logaddexp(attentive, lapsed)
    return found
