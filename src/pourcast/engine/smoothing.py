"""Smoothing kernel: Wendland C2 in three dimensions.

From Wendland (1995), "Piecewise polynomial, positive definite and compactly
supported radial functions of minimal degree", Adv. Comput. Math. 4, in the
form used for SPH by Dehnen & Aly (2012), MNRAS 425. With q = r / H and the
support radius H = 2 h (h the smoothing length):

    W(r)     =   21 / (2 pi H^3) (1 - q)^4 (4 q + 1)
    grad W   = -420 / (2 pi H^5) (1 - q)^3 r_vec

The functions here leave the normalisation out; `packing` calibrates it away.
They take 1 - q, cut off at 0, so that a pair out of reach adds nothing.
"""

from typing import Any

import numpy as np

from pourcast.engine.compile import kernel
from pourcast.engine.simd import fma, fnma, maximum, sqrt

NORMALISATION = 21.0 / (2.0 * np.pi)
"""Times 1 / H^3: makes the integral of W over space 1."""

GRADIENT_FACTOR = 20.0
"""grad w = -GRADIENT_FACTOR / H^2 (1 - q)^3 r_vec for the w of `weight`."""


@kernel
def dot(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any) -> Any:
    """Scalar product of two vectors in space."""
    return fma(az, bz, fma(ay, by, ax * bx))


@kernel
def one_minus_q_of(squared_distance: Any, inverse_support: Any, zero: Any) -> Any:
    """max(1 - r / H, 0) from r^2."""
    return maximum(fnma(sqrt(squared_distance), inverse_support, 1.0), zero)


@kernel
def weight(one_minus_q: Any) -> Any:
    """W without its normalisation, (1 - q)^4 (4 q + 1), from max(1 - q, 0).

    Works on floats and on vectors.
    """
    square = one_minus_q * one_minus_q
    return square * square * fnma(4.0, one_minus_q, 5.0)


@kernel
def add_weight(total: Any, one_minus_q: Any) -> Any:
    """A sum, and `weight` from max(1 - q, 0) more, rounded once."""
    square = one_minus_q * one_minus_q
    return fma(square * square, fnma(4.0, one_minus_q, 5.0), total)


@kernel
def gradient(one_minus_q: Any) -> Any:
    """Gradient of W over r_vec without its factor, (1 - q)^3, from max(1 - q, 0)."""
    return one_minus_q * one_minus_q * one_minus_q
