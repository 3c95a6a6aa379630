"""Where the particles start: a relaxed packing of a cylinder, and its rest density.

A regular lattice explodes: its density differs from place to place, and the
pressure that follows drives the blob apart. Here the cylinder is filled by a
centroidal Voronoi tessellation (Lloyd 1982, IEEE Trans. Inf. Theory 28), in
which every particle owns the same volume; neighbours then push one another
apart until no pair is much closer than the others; and the kernel sum that
counts as rest density is taken from the packing itself.
"""

from functools import lru_cache, partial
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.cache_folder import kept_array

if TYPE_CHECKING:
    from scipy.spatial import KDTree

SUPPORT_IN_SPACINGS = 2.3
"""Support radius of the kernel over the particle spacing."""

_SAMPLES_PER_PARTICLE = 150
_LLOYD_ITERATIONS = 60

_PUSH_ITERATIONS = 200
_PUSH_REACH = 1.7
"""Distance, in spacings, below which particles push one another apart."""
_RIM_MARGIN = 0.3
"""Least distance, in spacings, of a centre from the cylinder's curved surface."""


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
    made_by = "-".join(version(package) for package in ("numpy", "scipy"))
    name = f"packing-{count}-{aspect!r}-{made_by}"
    return kept_array(name, partial(_packing, count, aspect))


def _packing(count: int, aspect: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(np.random.SeedSequence([count, 0x706F7572]))
    sample_count = max(4000, _SAMPLES_PER_PARTICLE * count)
    distance, angle = np.sqrt(rng.random(sample_count)), 2 * np.pi * rng.random(sample_count)
    samples = np.stack(
        [distance * np.cos(angle), distance * np.sin(angle), aspect * rng.random(sample_count)],
        axis=1,
    )
    centres = samples[rng.choice(sample_count, count, replace=False)]
    for _ in range(_LLOYD_ITERATIONS):
        owner = _tree(centres).query(samples)[1]
        owned = np.bincount(owner, minlength=count)
        sums = np.stack([np.bincount(owner, samples[:, k], count) for k in range(3)], axis=1)
        centres = sums / np.maximum(owned, 1)[:, None]
    spacing = spacing_of(count, 1.0, aspect)
    for _ in range(_PUSH_ITERATIONS):
        centres = _inside(centres + _push(centres, aspect, spacing), aspect, spacing)
    return centres


def _push(position: NDArray[np.float64], aspect: float, spacing: float) -> NDArray[np.float64]:
    """Displacements that part close pairs, and move particles off the surface of the cylinder."""
    reach = _PUSH_REACH * spacing
    pairs = _tree(position).query_pairs(reach, output_type="ndarray")
    apart = position[pairs[:, 0]] - position[pairs[:, 1]]
    apart *= _weight(np.linalg.norm(apart, axis=1), reach)[:, None]
    push = np.zeros_like(position)
    np.add.at(push, pairs[:, 0], apart)
    np.subtract.at(push, pairs[:, 1], apart)
    # A particle's mirror image in a surface is twice as far off as the surface.
    distance = np.hypot(position[:, 0], position[:, 1])
    gap = 2.0 * (1.0 - distance)
    inward = gap * _weight(gap, reach) / np.maximum(distance, 1e-12)
    push[:, :2] -= inward[:, None] * position[:, :2]
    for gap, sign in ((2.0 * position[:, 2], 1.0), (2.0 * (aspect - position[:, 2]), -1.0)):
        push[:, 2] += sign * gap * _weight(gap, reach)
    return push


def _weight(gap: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    return np.maximum(1.0 - gap / reach, 0.0) ** 3


def _inside(position: NDArray[np.float64], aspect: float, spacing: float) -> NDArray[np.float64]:
    """Particles kept within the cylinder, half a spacing off its flat ends."""
    margin = min(_RIM_MARGIN * spacing, 0.5)
    distance = np.hypot(position[:, 0], position[:, 1])
    position[:, :2] *= np.minimum(1.0, (1.0 - margin) / np.maximum(distance, 1e-12))[:, None]
    end = 0.5 * min(spacing, aspect)
    position[:, 2] = np.clip(position[:, 2], end, aspect - end)
    return position


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
        Particle positions [m], shape [count, 3].
    """
    cells = unit_cylinder_packing(int(count), float(round(depth / radius, 6))) * radius
    moved: NDArray[np.float64] = cells + np.array([*centre, 0.0])
    return moved.astype(np.float32)


def reference_density(position: NDArray[np.float32], support_radius: float, depth: float) -> float:
    """Kernel sum that counts as rest density for a packing.

    The largest of the sums over the particles, their mirror images in the front
    and back walls included: no particle starts under pressure, so there is no
    elastic energy to release. (With the 95th percentile, a single close pair
    blew the blob of N = 20 apart at 2 m/s.)

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
    position = position.astype(np.float64)
    sums = np.ones(len(position))
    pairs = _tree(position).query_pairs(support_radius, output_type="ndarray")
    gaps = np.linalg.norm(position[pairs[:, 0]] - position[pairs[:, 1]], axis=1)
    near = 1.0 - gaps / support_radius
    shares = near**4 * (5.0 - 4.0 * near)
    for side in range(2):
        np.add.at(sums, pairs[:, side], shares)
    wall_gap = 2.0 * np.minimum(position[:, 2], depth - position[:, 2])
    near = np.maximum(1.0 - wall_gap / support_radius, 0.0)
    sums += near**4 * (5.0 - 4.0 * near)
    return float(sums.max())


def _tree(points: NDArray[np.floating[Any]]) -> "KDTree":
    """A tree of points in space; SciPy is loaded for it, and not for the spacing alone."""
    from scipy.spatial import KDTree  # noqa: PLC0415

    return KDTree(points)
