"""Convex polygons of many scenes in flat arrays; plain NumPy, so that Numba can stay unloaded."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Solids(NamedTuple):
    """Convex polygons of many scenes in flat arrays, counter-clockwise.

    Polygon p owns the vertices ``polygon_start[p]:polygon_start[p + 1]``; scene
    s owns the polygons ``scene_start[s]:scene_start[s + 1]``. Vertex k also
    stands for the edge from it to the next vertex of its polygon.
    """

    vertices: NDArray[np.float64]
    """Vertices [m], shape [vertex_count, 2]."""
    normals: NDArray[np.float64]
    """Outward unit normals of the edges, shape [vertex_count, 2]."""
    lengths: NDArray[np.float64]
    """Lengths of the edges [m], shape [vertex_count]."""
    polygon_start: NDArray[np.int64]
    scene_start: NDArray[np.int64]
    is_goal: NDArray[np.bool_]
    """Whether a polygon belongs to the goal (divider, cup), shape [polygon_count]."""


def pack_solids(scenes: list[list[tuple[NDArray[np.float64], bool]]]) -> Solids:
    """Flatten polygons into the arrays that the kernels read.

    Parameters
    ----------
    scenes
        For each scene a list of (vertices [m], shape [k, 2], counter-clockwise;
        whether the polygon is part of the goal).

    Returns
    -------
    Solids
        The same polygons, with edge normals and lengths.
    """
    polygons = [polygon for scene in scenes for polygon in scene]
    vertices = [np.asarray(v, dtype=np.float64) for v, _ in polygons]
    edges = [np.roll(v, -1, axis=0) - v for v in vertices]
    flat_edges = np.concatenate([*edges, np.zeros((0, 2))])
    lengths = np.hypot(flat_edges[:, 0], flat_edges[:, 1])
    outward = np.stack([flat_edges[:, 1], -flat_edges[:, 0]], axis=1)
    return Solids(
        vertices=np.concatenate([*vertices, np.zeros((0, 2))]),
        normals=outward / lengths[:, None],
        lengths=lengths,
        polygon_start=np.cumsum([0] + [len(v) for v in vertices]),
        scene_start=np.cumsum([0] + [len(scene) for scene in scenes]),
        is_goal=np.array([goal for _, goal in polygons], dtype=np.bool_),
    )
