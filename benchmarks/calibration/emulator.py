"""Emulators: what an output would be at a place that was not measured, and how sure that is.

A Gaussian process for each output (Rasmussen and Williams 2006): a linear trend with a prior, and
a Matern 5/2 remainder with a length of its own for each choice, so that a choice which doesn't
matter gets a long one. The sampling noise of each measurement is known and given; what noise there
is beyond it is learned.

How good one is, folds say: `FOLDS` times it is fitted anew, lengths and noise too, without a share
of the points, which it then foretells. Where it foretells no better than the mean of the others
does, the output is emulated by its mean: everywhere the same, and as unsure as the points differ.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern, WhiteKernel
from sklearn.model_selection import KFold

from pourcast.errors import InputError

Array = NDArray[np.float64]

LENGTHS = (0.6, 40.0)
"""Of the remainder; a choice's whole range is 2."""

RESTARTS = 1

FOLDS = 6
LEAST_POINTS = 10
"""With a value; fewer say nothing of 13 choices."""

LEAST_SIGNAL = 0.05
"""Share of the variance among points that can be told from sampling noise."""

SURE = 2.0
"""Standard errors by which an emulator must be better than the mean to count."""


@dataclass(frozen=True)
class Emulator:
    """One output over the unit cube; see `fit`."""

    process: GaussianProcessRegressor
    centre: float
    scale: float
    residuals: Array
    """Of points that it was fitted without, over their standard deviations; [point_count]."""
    explained: float
    """Share of the signal that is foretold of points that it was fitted without; below 0 where the
    mean of the others foretells better."""
    error: float
    """Standard error of `explained`, over the points."""
    signal: float
    """Share of the variance among points that is more than sampling noise."""

    @property
    def foretells(self) -> bool:
        """Whether it foretells anything; otherwise it gives the mean."""
        return self.signal >= LEAST_SIGNAL and self.explained > SURE * self.error

    def predict(self, places: Array) -> tuple[Array, Array]:
        """Mean and variance at places, shape [place_count, choice_count]; without noise."""
        if not self.foretells:
            variance = self.scale**2 * max(self.signal, 1e-8)
            return self.mean(places), np.full(len(places), variance)
        mean, variance = _predicted(self.process, places)
        return self.centre + self.scale * mean, self.scale**2 * variance

    def mean(self, places: Array) -> Array:
        """Mean at places: faster than `predict`."""
        if not self.foretells:
            return np.full(len(places), self.centre)
        mean: Array = self.centre + self.scale * self.process.predict(_centred(places))
        return mean

    @property
    def misfit(self) -> float:
        """Root mean square of the residuals; 1 if emulator and noise are as sure as they say."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fit(places: Array, values: Array, noise: Array, seed: int = 0) -> Emulator:
    """Fit an emulator.

    Parameters
    ----------
    places
        Where it was measured, in the unit cube, shape [point_count, choice_count].
    values
        What was measured; NaN where nothing was.
    noise
        Variance of each value's sampling.
    seed
        Of the folds, and of the restarts of the search for the lengths.

    Raises
    ------
    InputError
        If fewer than `LEAST_POINTS` have a value.
    """
    there = np.isfinite(values)
    if there.sum() < LEAST_POINTS:
        raise InputError(
            f"an emulator needs at least {LEAST_POINTS} points with a value, found {there.sum()}"
        )
    places, values, noise = places[there], values[there], noise[there]
    centre, scale = float(values.mean()), float(values.std()) or 1.0
    values, noise = (values - centre) / scale, noise / scale**2
    # As the values are scaled, their variance is 1, and what isn't noise is signal.
    signal = 1.0 - float(np.mean(noise))
    residuals, gains = _left_out(places, values, noise, seed)
    gains = gains / max(signal, LEAST_SIGNAL)
    error = float(gains.std(ddof=1)) / np.sqrt(len(gains))
    process = _process(places, values, noise, seed)
    return Emulator(process, centre, scale, residuals, float(gains.mean()), error, signal)


def _left_out(places: Array, values: Array, noise: Array, seed: int) -> tuple[Array, Array]:
    """Of each point, foretold by what was fitted without its fold.

    Its standardised residual, and how much smaller its squared error is than that of the mean.
    """
    residuals, gains = np.empty(len(values)), np.empty(len(values))
    for kept, out in KFold(FOLDS, shuffle=True, random_state=seed).split(places):
        mean, variance = _predicted(
            process := _process(places[kept], values[kept], noise[kept], seed), places[out]
        )
        errors = values[out] - mean
        residuals[out] = errors / np.sqrt(variance + _own_noise(process) + noise[out])
        gains[out] = (values[out] - values[kept].mean()) ** 2 - errors**2
    return residuals, gains


def _process(places: Array, values: Array, noise: Array, seed: int) -> GaussianProcessRegressor:
    """A Gaussian process, its lengths and noise learned from these points alone."""
    kernel = (
        ConstantKernel(0.1, (1e-3, 10.0)) * DotProduct(1.0, "fixed")
        + ConstantKernel(0.5, (1e-3, 10.0)) * Matern(np.full(places.shape[1], 2.0), LENGTHS, nu=2.5)
        + WhiteKernel(0.01, (1e-4, 1.0))
    )
    process = GaussianProcessRegressor(
        kernel, alpha=noise, n_restarts_optimizer=RESTARTS, random_state=seed
    )
    with warnings.catch_warnings():
        # Lengths at a bound are what choices without any influence have.
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(_centred(places), values)
    return process


def _predicted(process: GaussianProcessRegressor, places: Array) -> tuple[Array, Array]:
    """Mean and variance without noise, both scaled."""
    mean, deviation = process.predict(_centred(places), return_std=True)
    # scikit-learn counts white noise in, even for places that were not measured.
    return mean, np.maximum(deviation**2 - _own_noise(process), 1e-8)


def _own_noise(process: GaussianProcessRegressor) -> float:
    """Variance of noise beyond sampling's, scaled."""
    return float(process.kernel_.k2.noise_level)


def _centred(places: Array) -> Array:
    """From the unit cube to -1..1, so that the trend's prior favours no corner."""
    return 2.0 * places - 1.0
