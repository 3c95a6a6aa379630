"""The liquid's surface as a closed mesh, for renderers that refract light.

Cells: the fill is blurred a little, let into the solids around it (else air would gleam between
liquid and obstacle), and cut by marching cubes at the level that keeps the liquid's volume.
Particles: the density of a smoothing kernel is cut, by splashsurf (Loeschner et al. 2023). Both
are done by `pysplashsurf`. Drops are small spheres.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from pourcast.extras import optional_module
from pourcast.stimuli.recording import FULL, Moment, RecordedPour

_BLUR = 0.7
"""Of the fill [cells]: steps of single cells vanish, films stay."""
_EDGE = 0.6
"""Width of the surface in the blurred fill."""
_LEVELS = 0.1, 0.6
_MARGIN = 3
_SMOOTHING = 6
_RADIUS = 0.5
"""Of particles, over their spacing."""
_SPLASH = {"smoothing_length": 2.0, "cube_size": 0.6, "iso_surface_threshold": 0.6}


@dataclass(frozen=True)
class Mesh:
    """A closed surface of triangles.

    Parameters
    ----------
    vertices
        [m], shape [vertex_count, 3].
    triangles
        Places of their corners, counter-clockwise seen from outside, shape [triangle_count, 3].
    """

    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]

    @property
    def volume(self) -> float:
        """What the surface encloses [m^3], by the divergence theorem."""
        a, b, c = (self.vertices[self.triangles[:, k]].astype(np.float64) for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


EMPTY = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))


def liquid_mesh(pour: RecordedPour, frame: int) -> Mesh:
    """Surface of the liquid in a picture.

    Parameters
    ----------
    pour
        The pour.
    frame
        Number of the picture.

    Returns
    -------
    Mesh
        Of all the liquid. In free air its volume is the liquid's less 1 % for a blob 20 cells
        across, 4 % for 10, 17 % for 5 (`tests/stimuli/test_surface.py`); at walls it reaches half
        a cell into them, so that no air gleams between.

    Raises
    ------
    InputError
        If `pysplashsurf` is not installed.
    """
    moment = pour.moments[frame]
    if moment.fill.size == 0:
        return particles_mesh(moment.points[:, :3], pour.cell)
    return joined([cells_mesh(moment, pour), drops_mesh(moment.points)])


def cells_mesh(moment: Moment, pour: RecordedPour) -> Mesh:
    """Surface of the liquid that fills cells."""
    fill = moment.fill.astype(np.float32) / FULL
    if not fill.any():
        return EMPTY
    room = np.pad(pour.room, _MARGIN)
    field = _let_in(np.pad(fill, _MARGIN), room <= 0.0)
    field = gaussian_filter(field, _BLUR)
    field[[0, -1]] = field[:, [0, -1]] = field[:, :, [0, -1]] = 0.0
    level = _level(field, room, float((fill * pour.room).sum()))
    x, y, z = (start + (0.5 - _MARGIN) * pour.cell for start in pour.origin)
    return _cut(field, level, pour.cell, (x, y, z))


def _let_in(field: NDArray[np.float32], solid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Give solid cells the mean fill of the free ones beside them."""
    free = uniform_filter((~solid).astype(np.float32), 3)
    near = uniform_filter(np.where(solid, 0.0, field), 3)
    inside = np.divide(near, free, out=np.zeros_like(near), where=free > 1e-6)
    return np.where(solid, inside, field).astype(np.float32)


def _level(field: NDArray[np.float32], room: NDArray[np.float32], wanted: float) -> float:
    """Level at which blurred cells hold the wanted volume [cells] in their room."""
    low, high = _LEVELS
    there = (field > 1e-3) & (room > 0.0)
    values, rooms = field[there].astype(np.float64), room[there].astype(np.float64)
    for _ in range(12):
        level = 0.5 * (low + high)
        held = float(np.clip((values - level) / _EDGE + 0.5, 0.0, 1.0) @ rooms)
        low, high = (level, high) if held > wanted else (low, level)
    return 0.5 * (low + high)


def _cut(
    field: NDArray[np.float32], level: float, cell: float, start: tuple[float, float, float]
) -> Mesh:
    splash = optional_module("pysplashsurf", "stimuli")
    surface = splash.marching_cubes(
        np.ascontiguousarray(field), iso_surface_threshold=level, cube_size=cell,
        translation=list(start),
    )  # fmt: skip
    return _outward(np.asarray(surface.vertices), np.asarray(surface.triangles))


def particles_mesh(positions: NDArray[np.float32], spacing: float) -> Mesh:
    """Surface of a liquid made of particles.

    Parameters
    ----------
    positions
        [m], shape [count, 3].
    spacing
        Of the particles [m].
    """
    splash = optional_module("pysplashsurf", "stimuli")
    reconstruction, _ = splash.reconstruction_pipeline(
        np.ascontiguousarray(positions, dtype=np.float32),
        particle_radius=_RADIUS * spacing,
        mesh_smoothing_iters=_SMOOTHING,
        mesh_smoothing_weights=True,
        **_SPLASH,
    )
    mesh = reconstruction.mesh
    return _outward(np.asarray(mesh.vertices), np.asarray(mesh.triangles))


def drops_mesh(points: NDArray[np.float32]) -> Mesh:
    """Spheres of the drops' volumes.

    Parameters
    ----------
    points
        Position [m] and volume [m^3], shape [count, 4].
    """
    sphere = _unit_sphere()
    radii = np.cbrt(0.75 / np.pi * np.maximum(points[:, 3], 0.0))
    return joined(
        [
            Mesh((sphere.vertices * radius + point[:3]).astype(np.float32), sphere.triangles)
            for point, radius in zip(points, radii, strict=True)
        ]
    )


@cache
def _unit_sphere() -> Mesh:
    """A ball of cells, cut like the liquid."""
    n = 5
    grid = (np.indices((n + 3,) * 3) - (n + 2) / 2).astype(np.float32)
    ball = n / 2 - np.linalg.norm(grid, axis=0)
    mesh = _cut(ball, 0.0, 1.0, (-(n + 2) / 2,) * 3)
    return Mesh(
        (mesh.vertices / np.cbrt(0.75 / np.pi * mesh.volume)).astype(np.float32), mesh.triangles
    )


def _outward(vertices: NDArray[np.float32], triangles: NDArray[np.int64]) -> Mesh:
    mesh = Mesh(vertices.astype(np.float32), triangles.astype(np.int32))
    return mesh if mesh.volume >= 0.0 else Mesh(mesh.vertices, mesh.triangles[:, ::-1].copy())


def joined(meshes: list[Mesh]) -> Mesh:
    """Meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    if not meshes:
        return EMPTY
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate(
            [mesh.triangles + np.int32(start) for mesh, start in zip(meshes, starts, strict=False)]
        ),
    )
