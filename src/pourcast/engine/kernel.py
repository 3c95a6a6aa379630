"""Smoothing kernel: Wendland C2 in three dimensions.

From Wendland (1995), "Piecewise polynomial, positive definite and compactly
supported radial functions of minimal degree", Adv. Comput. Math. 4, in the
form used for SPH by Dehnen & Aly (2012), MNRAS 425. With q = r / H and the
support radius H = 2 h (h the smoothing length):

    W(r)     =   21 / (2 pi H^3) (1 - q)^4 (4 q + 1)
    grad W   = -420 / (2 pi H^5) (1 - q)^3 r_vec

The kernels here leave the normalisation out; `packing` calibrates it away.
"""

from typing import Any

import numpy as np

from pourcast.engine.compile import kernel

NORMALISATION = 21.0 / (2.0 * np.pi)
"""Times 1 / H^3: makes the integral of W over space 1."""

GRADIENT_FACTOR = 20.0
"""grad w = -GRADIENT_FACTOR / H^2 (1 - q)^3 r_vec for the shape w of `shape`."""


@kernel
def shape(one_minus_q: Any) -> Any:
    """Kernel without its normalisation, (1 - q)^4 (4 q + 1), from max(1 - q, 0).

    Works on floats and on vectors.
    """
    square = one_minus_q * one_minus_q
    return square * square * (5.0 - 4.0 * one_minus_q)


@kernel
def slope(one_minus_q: Any) -> Any:
    """Kernel gradient without its factor, (1 - q)^3, from max(1 - q, 0)."""
    return one_minus_q * one_minus_q * one_minus_q
