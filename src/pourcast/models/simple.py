"""SimpleSim: independent points that fall, slide downhill and drop; no physics of liquids."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.compile import allocating_kernel, kernel
from pourcast.engine.solids import pack_solids
from pourcast.models.base import Model, parameter
from pourcast.progress import Progress, no_progress
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene

M_STEP = 0.02
"""Step of the average over m [m]: the spacing of the paper's 11 values."""

_TOUCH = 1e-9
"""Solids closer than this [m] to a path touch it; closes the seam between two cells."""
_INSIDE = 1e-6
"""A path is blocked by a solid only if it runs inside it for this long [m]."""
_ON_TOP = 1e-5
"""A point this little [m] below a surface is on it."""
_PROBE = 3e-6
"""Past an edge, another solid this near [m] closes the gap."""


@dataclass(frozen=True)
class SimpleSim(Model):
    """Points drop straight down and follow surfaces downhill until they can drop again.

    Bates et al., section "Alternative models". With g = 0 and m = 0 it is the
    gravity heuristic. The goal's own parts (divider, cup) are always left downhill
    and without momentum.
    """

    seconds_per_judgment = 0.003

    g: float = parameter(
        0.1, low=0, high=1, doc="probability, once an obstacle, of setting off the wrong way"
    )
    m: float = parameter(
        0.1, unit="m", low=0, high=1, doc="distance moved on horizontally after leaving an edge"
    )
    m_sigma: float = parameter(
        0.04, unit="m", low=0, high=1, doc="half-width of the average over m"
    )
    n_points: int = parameter(100, low=1, high=10000, doc="points along the liquid's midline")

    @classmethod
    def follows_trial(cls, parameters: Mapping[str, Any]) -> bool:
        """No: it knows no liquids."""
        return False

    def judge(
        self,
        scenes: Sequence[Scene],
        liquid: Liquid,
        seed: int = 0,
        *,
        progress: Progress = no_progress,
    ) -> NDArray[np.float64]:
        """Judge scenes; a scene's draws depend on the seed and on the scene alone."""
        judgments = []
        for done, scene in enumerate(scenes, start=1):
            ends = [path[-1] for m in self._window() for path in self.paths(scene, seed, m=m)]
            judgments.append(np.mean([scene.goal.holds(x, y) for x, y in ends]))
            progress(done, len(scenes))
        return np.array(judgments)

    def paths(
        self, scene: Scene, seed: int = 0, *, m: float | None = None
    ) -> list[NDArray[np.float64]]:
        """Paths of the points.

        Parameters
        ----------
        scene
            The scene.
        seed
            Source of the wrong turns.
        m
            Momentum [m]; the model's own by default.

        Returns
        -------
        list of ndarray
            For each point the corners of its path [m], shape [corner_count, 2].
        """
        parts = [(np.array(p), k >= len(scene.obstacles)) for k, p in enumerate(scene.solids)]
        solids = pack_solids([parts])
        rng = np.random.default_rng([seed, int(scene.digest, 16)])
        chances = rng.random((self.n_points, len(scene.solids)))
        radius, (centre_x, y) = scene.liquid.diameter / 2, scene.liquid.centre
        across = (np.arange(self.n_points) + 0.5) / self.n_points
        momentum = self.m if m is None else m
        return [
            walk(x, y, self.g, momentum, chance, solids, scene.box.width)
            for x, chance in zip(centre_x + radius * (2 * across - 1), chances, strict=True)
        ]

    def _window(self) -> list[float]:
        count = round(self.m_sigma / M_STEP)
        window = [self.m + M_STEP * k for k in range(-count, count + 1)]
        return [m for m in window if m >= -1e-9]


@kernel
def first_hit(
    x0: float, y0: float, x1: float, y1: float, skip: int, solids: Any
) -> tuple[float, int]:
    """Where a straight path first enters a solid.

    Parameters
    ----------
    x0, y0, x1, y1
        Ends of the path [m].
    skip
        Index of a polygon to leave out, or -1.
    solids
        Polygons of one scene.

    Returns
    -------
    t, polygon
        Fraction of the path, 0..1, and the polygon; (1, -1) if it is free.
    """
    length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    best, which = 1.0, -1
    for polygon in range(len(solids.polygon_start) - 1):
        if polygon == skip:
            continue
        enter, leave = -np.inf, np.inf
        for k in range(solids.polygon_start[polygon], solids.polygon_start[polygon + 1]):
            normal_x, normal_y = solids.normals[k, 0], solids.normals[k, 1]
            before = (x0 - solids.vertices[k, 0]) * normal_x
            before += (y0 - solids.vertices[k, 1]) * normal_y - _TOUCH
            change = (x1 - x0) * normal_x + (y1 - y0) * normal_y
            if abs(change) < 1e-14:
                if before >= 0.0:
                    leave = -np.inf
            elif change < 0.0:
                enter = max(enter, -before / change)
            else:
                leave = min(leave, -before / change)
        start, end = max(enter, 0.0), min(leave, 1.0)
        if (end - start) * length > _INSIDE and start < best:
            best, which = start, polygon
    return best, which


@kernel
def top_of(polygon: int, x: float, solids: Any) -> tuple[float, int]:
    """Height of a polygon's upper surface at x [m], and the edge there (-1 beside it)."""
    for k in range(solids.polygon_start[polygon], solids.polygon_start[polygon + 1]):
        if solids.normals[k, 1] <= 1e-12:
            continue
        # Counter-clockwise, an upper edge runs from right to left.
        right, left = (
            solids.vertices[k, 0],
            solids.vertices[k, 0] - (solids.lengths[k] * solids.normals[k, 1]),
        )
        if left - 1e-12 <= x <= right + 1e-12:
            fall = solids.normals[k, 0] / solids.normals[k, 1]
            return solids.vertices[k, 1] - (x - right) * fall, k
    return -np.inf, -1


@kernel
def direction_on(polygon: int, x: float, g: float, chance: float, solids: Any) -> int:
    """Way to set off on a polygon's surface: 1 to the right, -1 to the left."""
    _, edge = top_of(polygon, x, solids)
    downhill = 0
    if edge >= 0 and abs(solids.normals[edge, 0]) > 1e-9:
        downhill = 1 if solids.normals[edge, 0] > 0.0 else -1
    else:
        first, last = solids.polygon_start[polygon], solids.polygon_start[polygon + 1]
        left, right = np.inf, -np.inf
        for k in range(first, last):
            left = min(left, solids.vertices[k, 0])
            right = max(right, solids.vertices[k, 0])
        # On the level: to the nearer edge, and by chance from the very middle.
        offset = x - 0.5 * (left + right)
        if abs(offset) < 1e-9:
            offset = 0.5 - chance if chance != 0.5 else 1.0
        downhill = 1 if offset > 0.0 else -1
    return -downhill if not solids.is_goal[polygon] and chance < g else downhill


@allocating_kernel
def walk(x: float, y: float, g: float, m: float, chances: Any, solids: Any, width: float) -> Any:
    """Follow one point from its start to where it stays.

    Parameters
    ----------
    x, y
        Start [m].
    g
        Probability of a wrong turn.
    m
        Momentum [m].
    chances
        A uniform random number for each polygon.
    solids
        Polygons of one scene.
    width
        Width of the box [m].

    Returns
    -------
    ndarray
        Corners of the path [m], shape [corner_count, 2].
    """
    # No surface is followed twice: a bound on the corners of any path.
    path = np.empty((2 * len(solids.vertices) + 4 * len(solids.polygon_start) + 16, 2))
    path[0, 0], path[0, 1] = x, y
    count = 1
    way = np.zeros(len(solids.polygon_start) - 1, np.int64)
    on, skip = -1, -1
    while count < len(path) - 2:
        if on < 0:
            t, on = first_hit(x, y, x, -1.0, skip, solids)
            if on < 0 or t >= y / (y + 1.0):
                count = _add_corner(path, count, x, 0.0)
                break
            y, skip = y - t * (y + 1.0), -1
            count = _add_corner(path, count, x, y)
        if way[on] == 0:
            way[on] = direction_on(on, x, g, chances[on], solids)
        heading = way[on]
        end_x, end_y, at_edge = surface_end(on, x, y, heading, solids)
        if at_edge:
            t, hit = first_hit(x, y, x + heading * _PROBE, y, on, solids)
            if hit < 0:
                carried = 0.0 if solids.is_goal[on] else heading * m
                x, on, skip = _leave_edge(x, y, carried, on, width, solids)
                count = _add_corner(path, count, x, y)
                continue
        else:
            t, hit = first_hit(x, y, end_x, end_y, on, solids)
            x, y = x + t * (end_x - x), y + t * (end_y - y)
            count = _add_corner(path, count, x, y)
            if hit < 0 and (x <= 1e-9 or x >= width - 1e-9):
                break  # A surface that ends at the side wall.
        if hit >= 0:
            if y < top_of(hit, x + heading * 1e-8, solids)[0] - _ON_TOP:
                break  # In the notch below another solid's side: no way on.
            if way[hit] == 0:
                way[hit] = direction_on(hit, x + heading * 1e-8, g, chances[hit], solids)
            if way[hit] == -heading:
                break  # Two surfaces that lead into each other.
            on = hit
    return path[:count].copy()


@kernel
def _add_corner(path: Any, count: int, x: float, y: float) -> int:
    """Append a corner unless the point hasn't moved; returns the number of corners."""
    if abs(path[count - 1, 0] - x) + abs(path[count - 1, 1] - y) < 1e-9:
        return count
    path[count, 0], path[count, 1] = x, y
    return count + 1


@kernel
def surface_end(polygon: int, x: float, y: float, heading: int, solids: Any) -> Any:
    """End of the straight piece of surface ahead: x, y, and whether there is none (an edge)."""
    _, edge = top_of(polygon, x + heading * 1e-8, solids)
    if edge < 0:
        return x, y, True
    right = solids.vertices[edge, 0]
    left = right - solids.lengths[edge] * solids.normals[edge, 1]
    end_x = right if heading > 0 else left
    fall = solids.normals[edge, 0] / solids.normals[edge, 1]
    return end_x, solids.vertices[edge, 1] - (end_x - right) * fall, False


@kernel
def _leave_edge(
    x: float, y: float, carried: float, polygon: int, width: float, solids: Any
) -> tuple[float, int, int]:
    """Momentum past an edge: new x, the polygon landed on (or -1), and the one to fall along."""
    goal_x = min(max(x + carried, 0.0), width)
    if abs(goal_x - x) <= _INSIDE:
        return x, -1, polygon
    t, hit = first_hit(x, y, goal_x, y, polygon, solids)
    x += t * (goal_x - x)
    if hit < 0:
        return x, -1, -1
    heading = 1.0 if carried > 0.0 else -1.0
    if y >= top_of(hit, x + heading * 1e-8, solids)[0] - _ON_TOP:
        return x, hit, -1
    return x - heading * 1e-7, -1, hit


MODEL = SimpleSim
