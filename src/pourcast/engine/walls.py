"""Walls of the box: a particle near one sees its own mirror image.

The image adds to its density and pushes it off the wall. Contact alone would
let a stack of particles stand on a side wall for ever.
"""

from typing import Any

from pourcast.engine.compile import kernel
from pourcast.engine.simd import fnma, load, maximum, minimum, splat, where_less
from pourcast.engine.smoothing import gradient, weight


@kernel
def wall_density(x: Any, y: Any, z: Any, parameters: Any) -> Any:
    """What mirror images in the walls add to the density at some places [m]."""
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    width, depth, ceiling = (
        load(parameters.width, 0),
        load(parameters.depth, 0),
        load(parameters.ceiling, 0),
    )
    total = image_density(x, width - x, inverse_support, zero)
    total = total + image_density(y, ceiling - y, inverse_support, zero)
    return total + image_density(z, depth - z, inverse_support, zero)


@kernel
def wall_push(pressure: Any, x: Any, y: Any, z: Any, parameters: Any) -> Any:
    """Acceleration [m/s^2] along the three axes by mirror images in the walls."""
    inverse_support, zero = load(parameters.inverse_support, 0), splat(0.0)
    width, depth, ceiling = (
        load(parameters.width, 0),
        load(parameters.depth, 0),
        load(parameters.ceiling, 0),
    )
    return (
        image_push(pressure, x, width - x, inverse_support, zero),
        image_push(pressure, y, ceiling - y, inverse_support, zero),
        image_push(pressure, z, depth - z, inverse_support, zero),
    )


@kernel
def image_density(below: Any, above: Any, inverse_support: Any, zero: Any) -> Any:
    """Share of the mirror image in the nearer of two walls, from the distances to both [m]."""
    gap = minimum(below, above)
    return weight(maximum(fnma(2.0 * gap, inverse_support, 1.0), zero))


@kernel
def image_push(pressure: Any, below: Any, above: Any, inverse_support: Any, zero: Any) -> Any:
    """Acceleration [m/s^2] by the mirror image in the nearer of two walls."""
    gap = minimum(below, above)
    size = 4.0 * pressure * gap * gradient(maximum(fnma(2.0 * gap, inverse_support, 1.0), zero))
    return where_less(above, below, zero - size, size)
