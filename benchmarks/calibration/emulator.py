"""Emulators: what an output would be at a place that was not measured, and how sure that is.

A Gaussian process for each output (Rasmussen and Williams 2006): a linear trend with a prior, and
a Matern 5/2 remainder with a length of its own for each choice, so that a choice which doesn't
matter gets a long one. The sampling noise of each measurement is known and given; what noise there
is beyond it is learned.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern, WhiteKernel

Array = NDArray[np.float64]

LENGTHS = (0.6, 40.0)
"""Of the remainder; a choice's whole range is 2."""

RESTARTS = 1

LEAST_SIGNAL = 0.05
"""Share of the variance among points that can be told from sampling noise."""


@dataclass(frozen=True)
class Emulator:
    """One output over the unit cube; see `fit`."""

    process: GaussianProcessRegressor
    centre: float
    scale: float
    residuals: Array
    """Of leaving each point out, over their standard deviations; shape [point_count]."""
    explained: float
    """Share of the signal that leaving one out foretells."""
    signal: float
    """Share of the variance among points that is more than sampling noise."""

    def predict(self, places: Array) -> tuple[Array, Array]:
        """Mean and variance at places, shape [place_count, choice_count]; without noise."""
        mean, deviation = self.process.predict(_centred(places), return_std=True)
        # scikit-learn counts white noise in, even for places that were not measured.
        variance = np.maximum(deviation**2 - self.process.kernel_.k2.noise_level, 1e-8)
        return self.centre + self.scale * mean, self.scale**2 * variance

    def mean(self, places: Array) -> Array:
        """Mean at places: faster than `predict`."""
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
        Of the restarts of the search for the lengths.
    """
    there = np.isfinite(values)
    places, values, noise = places[there], values[there], noise[there]
    centre, scale = float(values.mean()), float(values.std()) or 1.0
    kernel = (
        ConstantKernel(0.1, (1e-3, 10.0)) * DotProduct(1.0, "fixed")
        + ConstantKernel(0.5, (1e-3, 10.0)) * Matern(np.full(places.shape[1], 2.0), LENGTHS, nu=2.5)
        + WhiteKernel(0.01, (1e-4, 1.0))
    )
    process = GaussianProcessRegressor(
        kernel, alpha=noise / scale**2, n_restarts_optimizer=RESTARTS, random_state=seed
    )
    with warnings.catch_warnings():
        # Lengths at a bound are what choices without any influence have.
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(_centred(places), (values - centre) / scale)
    residuals, errors = _left_out(process, (values - centre) / scale)
    # As the values are scaled, their variance is 1, and what isn't noise is signal.
    signal = 1.0 - float(np.mean(noise)) / scale**2
    explained = float(np.clip((1.0 - np.mean(errors**2)) / max(signal, LEAST_SIGNAL), 0.0, 1.0))
    if signal < LEAST_SIGNAL:
        explained = 0.0
    return Emulator(process, centre, scale, residuals, explained, signal)


def _left_out(process: GaussianProcessRegressor, values: Array) -> tuple[Array, Array]:
    """Standardised residuals and errors of leaving each point out.

    Rasmussen and Williams 2006, equations 5.10 to 5.12; lengths are kept.
    """
    inverse = cho_solve((process.L_, True), np.eye(len(values)))
    precision = np.diag(inverse)
    errors = (inverse @ values) / precision
    return errors * np.sqrt(precision), errors


def _centred(places: Array) -> Array:
    """From the unit cube to -1..1, so that the trend's prior favours no corner."""
    return 2.0 * places - 1.0
