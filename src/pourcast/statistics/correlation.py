"""How near a model's judgments are to people's mean judgments: r, RMSE, bias and slope."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NO_SPREAD = 1e-18
"""A variance below this is rounding, not spread."""


@dataclass(frozen=True)
class Agreement:
    """Four measures of agreement, each of shape [..., model_count].

    Parameters
    ----------
    r
        Pearson correlation; NaN where people or the model have no spread.
    rmse
        Root mean square difference.
    bias
        Mean of people minus the model.
    slope
        Of the least-squares line of people's means on the model's judgments: below 1 where
        people keep nearer to the middle than the model does.
    """

    r: Array
    rmse: Array
    bias: Array
    slope: Array


MEASURES = ("r", "rmse", "bias", "slope")


def agreement(people: Array, models: Array, weights: Array | None = None) -> Agreement:
    """Agreement of people's mean judgments with each model's, in any number of cases.

    Parameters
    ----------
    people
        Mean judgments, shape [case_count, scene_count] or [scene_count]; where a weight
        is 0 they may be NaN.
    models
        Judgments, shape [model_count, scene_count].
    weights
        How often each scene counts, shaped as `people`; once where people answered, by
        default.

    Returns
    -------
    Agreement
        Arrays of shape [case_count, model_count], or [model_count].

    Examples
    --------
    >>> one = agreement(np.array([0.2, 0.4, 0.6]), np.array([[0.1, 0.5, 0.9]]))
    >>> [round(float(getattr(one, name)[0]), 6) for name in ("r", "bias", "slope")]
    [1.0, -0.1, 0.5]
    """
    y = np.atleast_2d(people)
    w = np.isfinite(y).astype(float) if weights is None else np.atleast_2d(weights)
    y = np.where(w > 0, y, 0.0)
    total = w.sum(axis=1, keepdims=True)
    # Centred first: the sums of squares below then lose no digits.
    centre = models.mean(axis=1, keepdims=True)
    x = models - centre
    mean_x, mean_y = w @ x.T / total, (w * y).sum(axis=1, keepdims=True) / total
    y_centred = w * (y - mean_y)
    covariance = y_centred @ x.T / total
    variance_x = np.maximum(w @ (x * x).T / total - mean_x**2, 0.0)
    variance_y = (y_centred * (y - mean_y)).sum(axis=1, keepdims=True) / total
    bias = mean_y - (mean_x + centre.T)
    spread = (variance_x > _NO_SPREAD) & (variance_y > _NO_SPREAD)
    with np.errstate(divide="ignore", invalid="ignore"):
        r = np.where(spread, covariance / np.sqrt(variance_x * variance_y), np.nan)
        slope = np.where(variance_x > _NO_SPREAD, covariance / variance_x, np.nan)
    square = variance_y + variance_x - 2.0 * covariance + bias**2
    rmse = np.sqrt(np.maximum(square, 0.0))
    shape = (*np.shape(people)[:-1], len(models))
    return Agreement(*(each.reshape(shape) for each in (np.clip(r, -1, 1), rmse, bias, slope)))


def pearson(people: Array, models: Array, weights: Array | None = None) -> Array:
    """Correlation alone; see `agreement`."""
    return agreement(people, models, weights).r


def mean_judgments(responses: Array) -> Array:
    """Mean over the participants who answered, shape [scene_count]; NaN where nobody did."""
    answered = np.isfinite(responses)
    count = answered.sum(axis=0)
    total = np.where(answered, responses, 0.0).sum(axis=0)
    with np.errstate(invalid="ignore"):
        means: Array = total / count
    return means
