"""Walls of the box: a particle near one sees its own mirror image.

The image adds to its density and pushes it off the wall. Contact alone would
let a stack of particles stand on a side wall for ever.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import fnma, maximum, minimum, where_less
from pourcast.engine.smoothing import gradient, weight


@kernel
def image_density(below: Any, above: Any, inverse_support: Any, zero: Any) -> Any:
    """Share of the mirror image in the nearer of two walls, from the distances to both [m]."""
    gap = minimum(below, above)
    return weight(maximum(fnma(2.0 * gap, inverse_support, 1.0), zero))


@kernel
def image_push(pressure: Any, below: Any, above: Any, inverse_support: Any, zero: Any) -> Any:
    """Acceleration by the mirror image in the nearer of two walls, over the pressure factor."""
    gap = minimum(below, above)
    size = 4.0 * pressure * gap * gradient(maximum(fnma(2.0 * gap, inverse_support, 1.0), zero))
    return where_less(above, below, zero - size, size)
