"""How an observer's answer comes from what a model in its head says.

answer ~ Beta(mu * phi, (1 - mu) * phi), mu = 1/2 + bias + slope * (J - 1/2), then rounded
to the slider's steps; now and then (lapse) any place on the slider instead.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError

Array = NDArray[np.float64]

_MARGIN = 0.01
"""Means are kept as far from 0 and 1; a beta distribution has none there."""

_FEWEST = 0.5
"""Least precision: below 2 * _MARGIN the beta generator loses its digits."""


@dataclass(frozen=True)
class Styles:
    """How each of some observers answers, arrays of shape [observer_count].

    Parameters
    ----------
    bias
        Added to all answers.
    slope
        1 follows the model, less keeps nearer to the middle.
    precision
        Of the beta noise, phi; the noise's variance is mu (1 - mu) / (1 + phi).
    lapse
        Share of trials answered anywhere.
    """

    bias: Array
    slope: Array
    precision: Array
    lapse: Array


@dataclass(frozen=True)
class Population:
    """Observers who differ.

    With the defaults, 65 observers of the paper's size of study have about the split-half
    reliability of the paper's participants (Experiment 1a: 0.96).

    Parameters
    ----------
    bias, bias_sd
        Mean and spread of the bias over the observers.
    slope, slope_sd
        Of the slope.
    precision, precision_log_sd
        Median of the precision and the spread of its logarithm.
    lapse
        Share of lapses.
    granularity
        Step of the slider.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    bias: float = 0.0
    bias_sd: float = 0.04
    slope: float = 0.85
    slope_sd: float = 0.1
    precision: float = 4.0
    precision_log_sd: float = 0.3
    lapse: float = 0.03
    granularity: float = 0.01

    def __post_init__(self) -> None:
        ranges = {
            "bias": (-0.5, 0.5), "bias_sd": (0.0, 1.0), "slope": (-2.0, 2.0),
            "slope_sd": (0.0, 2.0), "precision": (_FEWEST, 1e4), "precision_log_sd": (0.0, 2.0),
            "lapse": (0.0, 1.0), "granularity": (0.0, 0.5),
        }  # fmt: skip
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"{name}: expected {low:g} to {high:g}, found {value:g}")

    def draw(self, count: int, rng: np.random.Generator) -> Styles:
        """Draw observers."""
        normal = rng.standard_normal((3, count))
        precision = self.precision * np.exp(self.precision_log_sd * normal[2])
        return Styles(
            bias=self.bias + self.bias_sd * normal[0],
            slope=self.slope + self.slope_sd * normal[1],
            precision=np.maximum(_FEWEST, precision),
            lapse=np.full(count, self.lapse),
        )

    def respond(self, judgments: Array, styles: Styles, rng: np.random.Generator) -> Array:
        """Answers of observers.

        Parameters
        ----------
        judgments
            What the model in each head says, shape [observer_count, scene_count] or
            [scene_count] if they all have the same.
        styles
            How they answer.
        rng
            Source of randomness.

        Returns
        -------
        ndarray
            Answers in 0..1, shape [observer_count, scene_count].
        """
        bias, slope, phi, lapse = (
            each[:, None] for each in (styles.bias, styles.slope, styles.precision, styles.lapse)
        )
        mean = np.clip(0.5 + bias + slope * (judgments - 0.5), _MARGIN, 1.0 - _MARGIN)
        answers = rng.beta(mean * phi, (1.0 - mean) * phi)
        elsewhere = rng.random(answers.shape)
        answers = np.where(rng.random(answers.shape) < lapse, elsewhere, answers)
        if self.granularity > 0.0:
            answers = np.round(answers / self.granularity) * self.granularity
        return np.clip(answers, 0.0, 1.0)


def spread_over_grid(
    planted: int, spread: float, count: int, observers: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Each observer's own point on a grid of parameters, about the planted one.

    Parameters
    ----------
    planted
        Point of the population's middle.
    spread
        Standard deviation in grid steps.
    count
        Number of points.
    observers
        How many observers.
    rng
        Source of randomness.
    """
    points = np.rint(planted + spread * rng.standard_normal(observers))
    return np.clip(points, 0, count - 1).astype(np.int64)
