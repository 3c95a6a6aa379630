"""Where the particles start: a relaxed packing of a cylinder, and its rest density.

A regular lattice explodes: its density differs from place to place, and the
pressure that follows drives the blob apart. Here the cylinder is filled by a
centroidal Voronoi tessellation (Lloyd 1982, IEEE Trans. Inf. Theory 28), in
which every particle owns the same volume, and the kernel sum that counts as
rest density is taken from the packing itself.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pourcast.engine.kernel import shape

SUPPORT_IN_SPACINGS = 2.3
"""Support radius of the kernel over the particle spacing."""

DENSITY_PERCENTILE = 95.0
"""Percentile of the starting kernel sums that counts as rest density."""

_SAMPLES_PER_PARTICLE = 150
_LLOYD_ITERATIONS = 60


def spacing_of(count: int, radius: float, depth: float) -> float:
    """Particle spacing [m]: cube root of the volume that a particle owns.

    Examples
    --------
    >>> round(spacing_of(50, 0.074, 0.148), 4)
    0.0371
    """
    return float(np.cbrt(np.pi * radius**2 * depth / count))


@lru_cache(maxsize=64)
def unit_cylinder_packing(count: int, aspect: float) -> NDArray[np.float64]:
    """Centres of `count` equal cells of a cylinder of radius 1 and length `aspect`.

    Parameters
    ----------
    count
        Number of particles, at least 1.
    aspect
        Length of the cylinder over its radius.

    Returns
    -------
    ndarray
        Centres, shape [count, 3]; the axis is z, from 0 to `aspect`. Read-only.
    """
    rng = np.random.default_rng(np.random.SeedSequence([count, 0x706F7572]))
    sample_count = max(4000, _SAMPLES_PER_PARTICLE * count)
    distance, angle = np.sqrt(rng.random(sample_count)), 2 * np.pi * rng.random(sample_count)
    samples = np.stack(
        [distance * np.cos(angle), distance * np.sin(angle), aspect * rng.random(sample_count)],
        axis=1,
    )
    centres = samples[rng.choice(sample_count, count, replace=False)]
    for _ in range(_LLOYD_ITERATIONS):
        owner = KDTree(centres).query(samples)[1]
        owned = np.bincount(owner, minlength=count)
        sums = np.stack([np.bincount(owner, samples[:, k], count) for k in range(3)], axis=1)
        centres = sums / np.maximum(owned, 1)[:, None]
    centres.setflags(write=False)
    return centres


def pack_cylinder(
    count: int, centre: tuple[float, float], radius: float, depth: float
) -> NDArray[np.float32]:
    """Relaxed start of a liquid: a cylinder through the depth of the box.

    Parameters
    ----------
    count
        Number of particles.
    centre
        Centre of the cylinder in the x-y plane [m].
    radius
        Its radius [m].
    depth
        Its length, the depth of the box [m].

    Returns
    -------
    ndarray
        Particle positions [m], shape [count, 3]; no centre is closer than a
        quarter of the spacing to the cylinder's surface.
    """
    margin = min(0.25 * spacing_of(count, radius, depth), 0.5 * radius)
    cells = unit_cylinder_packing(count, round(depth / radius, 6)) * radius
    distance = np.hypot(cells[:, 0], cells[:, 1])
    pull = np.minimum(1.0, (radius - margin) / np.maximum(distance, 1e-12))
    x, y = centre[0] + cells[:, 0] * pull, centre[1] + cells[:, 1] * pull
    wall = min(0.5 * spacing_of(count, radius, depth), 0.5 * depth)
    z = np.clip(cells[:, 2], wall, depth - wall)
    return np.stack([x, y, z], axis=1).astype(np.float32)


def reference_density(position: NDArray[np.float32], support_radius: float, depth: float) -> float:
    """Kernel sum that counts as rest density for a packing.

    The 95th percentile of the sums over the particles, their mirror images in
    the front and back walls included: nearly all particles start without
    pressure, and the blob neither bursts nor shrinks noticeably.

    Parameters
    ----------
    position
        Starting positions [m], shape [count, 3].
    support_radius
        Support radius H of the kernel [m].
    depth
        Depth of the box [m].

    Returns
    -------
    float
        Kernel sum, at least 1 (a particle's own share).
    """
    place = position.astype(np.float64)
    sums = np.ones(len(place))
    pairs = KDTree(place).query_pairs(support_radius, output_type="ndarray")
    gaps = np.linalg.norm(place[pairs[:, 0]] - place[pairs[:, 1]], axis=1)
    shares = (
        shape.py_func(1.0 - gaps / support_radius)
        if hasattr(shape, "py_func")
        else shape(1.0 - gaps / support_radius)
    )
    for side in range(2):
        np.add.at(sums, pairs[:, side], shares)
    wall_gap = 2.0 * np.minimum(place[:, 2], depth - place[:, 2])
    near = np.maximum(1.0 - wall_gap / support_radius, 0.0)
    sums += near**4 * (5.0 - 4.0 * near)
    return float(np.percentile(sums, DENSITY_PERCENTILE))
