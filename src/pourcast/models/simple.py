"""SimpleSim: independent points that fall, slide downhill and drop; no physics of liquids."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.polygons import pack_solids
from pourcast.models.base import Model, parameter
from pourcast.progress import Progress, no_progress
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

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
_AHEAD = 1e-8
"""A surface is looked up this far [m] ahead of a point: at a corner, the next edge's."""
_TOGETHER = 1000
"""Points that are followed together: more take memory, and no less time each."""


@dataclass(frozen=True)
class SimpleSim(Model):
    """Points drop straight down and follow surfaces downhill until they can drop again.

    Bates et al., section "Alternative models". With g = 0 and m = 0 it is the
    gravity heuristic. The goal's own parts (divider, cup) are always left downhill
    and without momentum.
    """

    seconds_per_judgment = 0.004

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
            walks = self._walks(scene, seed, self._window())
            ends = [end for walk in walks for end in walk.ends()]
            judgments.append(np.mean([scene.goal.holds(x, y) for x, y in ends]))
            progress(done, len(scenes))
        return np.array(judgments)

    def paths(self, scene: Scene, seed: int = 0, *, m: float | None = None) -> list[Floats]:
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
        walks = self._walks(scene, seed, [self.m if m is None else m])
        return [path for walk in walks for path in walk.paths()]

    def _walks(self, scene: Scene, seed: int, momenta: Sequence[float]) -> list["_Walk"]:
        """All points with each momentum [m]; a point's wrong turns are the same with any."""
        outlines, times = _outlines_of(scene), len(momenta)
        rng = np.random.default_rng([seed, int(scene.digest, 16)])
        chances = np.tile(rng.random((self.n_points, len(scene.solids))), (times, 1))
        radius, (centre_x, y) = scene.liquid.diameter / 2, scene.liquid.centre
        across = (np.arange(self.n_points) + 0.5) / self.n_points
        x = np.tile(centre_x + radius * (2 * across - 1), times)
        m = np.repeat(momenta, self.n_points)
        parts = [slice(k, k + _TOGETHER) for k in range(0, len(x), _TOGETHER)]
        return [
            _Walk(x[some], y, self.g, m[some], chances[some], outlines, scene.box.width)
            for some in parts
        ]

    def _window(self) -> list[float]:
        count = round(self.m_sigma / M_STEP)
        window = [self.m + M_STEP * k for k in range(-count, count + 1)]
        return [m for m in window if m >= -1e-9]


class Outlines(NamedTuple):
    """A scene's polygons; arrays of shape [edge_count, polygon_count].

    Polygons with fewer edges than others have their last one several times.
    """

    x: Floats
    """Where edges start [m]; that of an upper edge is its right end."""
    y: Floats
    normal_x: Floats
    """Outward unit normals."""
    normal_y: Floats
    left: Floats
    """Left end of an upper edge [m]; right of `x` for all others, so that they hold no place."""
    fall: Floats
    """Tangent of an upper edge's slope, positive down to the right."""
    middle: Floats
    """Half-way between the outermost corners [m], shape [polygon_count]."""
    is_goal: Flags
    """Shape [polygon_count]."""


def _outlines_of(scene: Scene) -> Outlines:
    parts = [(np.array(p), k >= len(scene.obstacles)) for k, p in enumerate(scene.solids)]
    solids = pack_solids([parts])
    first, edge_counts = solids.polygon_start[:-1], np.diff(solids.polygon_start)
    edges = np.arange(edge_counts.max(initial=1))[:, None]
    which = first + np.minimum(edges, edge_counts - 1)
    x, y = solids.vertices[which, 0], solids.vertices[which, 1]
    normal_x, normal_y = solids.normals[which, 0], solids.normals[which, 1]
    upper = normal_y > 1e-12
    return Outlines(
        x=x, y=y, normal_x=normal_x, normal_y=normal_y,
        # Counter-clockwise, an upper edge runs from right to left.
        left=np.where(upper, x - solids.lengths[which] * normal_y, x + 1.0),
        fall=np.divide(normal_x, normal_y, out=np.zeros_like(x), where=upper),
        middle=0.5 * (x.min(axis=0) + x.max(axis=0)),
        is_goal=solids.is_goal,
    )  # fmt: skip


def first_hit(
    x0: Floats, y0: Floats, x1: Floats, y1: Floats, skip: Indices, outlines: Outlines
) -> tuple[Floats, Indices]:
    """Where straight paths first enter a polygon; all arrays have an entry for each path.

    Parameters
    ----------
    x0, y0, x1, y1
        Ends of the paths [m].
    skip
        Index of a polygon to leave out, or -1.
    outlines
        Polygons of one scene.

    Returns
    -------
    t, polygon
        Fraction of the path, 0..1, and the polygon; 1 and -1 if it is free.
    """
    normal_x, normal_y = outlines.normal_x[..., None], outlines.normal_y[..., None]
    before = (x0 - outlines.x[..., None]) * normal_x
    before += (y0 - outlines.y[..., None]) * normal_y - _TOUCH
    change = (x1 - x0) * normal_x + (y1 - y0) * normal_y
    length = np.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    inwards, outwards = change <= -1e-14, change >= 1e-14
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -before / change
        start = np.where(inwards, crossing, 0.0).max(axis=0, initial=0.0)
        never = np.where(~(inwards | outwards) & (before >= 0.0), -np.inf, 1.0)
        end = np.where(outwards, crossing, never).min(axis=0, initial=1.0)
        blocked = (end - start) * length > _INSIDE
    blocked &= np.arange(len(start))[:, None] != skip
    # Before the first polygon stands none, at the path's end.
    starts = np.ones((len(start) + 1, len(x0)))
    starts[1:] = np.where(blocked, start, 1.0)
    return starts.min(axis=0), starts.argmin(axis=0) - 1


def top_of(polygon: Indices, x: Floats, outlines: Outlines) -> tuple[Floats, Indices]:
    """Heights of polygons' upper surfaces at x [m], and the edges there (-inf, -1 beside them)."""
    right = outlines.x[:, polygon]
    over = (outlines.left[:, polygon] - 1e-12 <= x) & (x <= right + 1e-12)
    edge, found = over.argmax(axis=0), over.any(axis=0)
    from_right = x - outlines.x[edge, polygon]
    height = outlines.y[edge, polygon] - from_right * outlines.fall[edge, polygon]
    return np.where(found, height, -np.inf), np.where(found, edge, -1)


def direction_on(
    polygon: Indices, x: Floats, g: float, chance: Floats, outlines: Outlines
) -> Indices:
    """Ways to set off on polygons' surfaces: 1 to the right, -1 to the left."""
    _, edge = top_of(polygon, x, outlines)
    tilt = outlines.normal_x[edge, polygon]
    # On the level: to the nearer edge, and by chance from the very middle.
    offset = x - outlines.middle[polygon]
    by_chance = np.where(chance != 0.5, 0.5 - chance, 1.0)
    offset = np.where(np.abs(offset) < 1e-9, by_chance, offset)
    sloped = (edge >= 0) & (np.abs(tilt) > 1e-9)
    downhill = np.where(np.where(sloped, tilt, offset) > 0.0, 1, -1)
    return np.where(~outlines.is_goal[polygon] & (chance < g), -downhill, downhill)


def surface_end(
    polygon: Indices, x: Floats, y: Floats, heading: Indices, outlines: Outlines
) -> tuple[Floats, Floats, Flags]:
    """Ends x, y [m] of the straight pieces of surface ahead; or a probe past edges, and at which.

    Parameters
    ----------
    polygon, x, y
        Which polygons, and where on their surfaces [m].
    heading
        1 to the right, -1 to the left.
    outlines
        Polygons of one scene.
    """
    _, edge = top_of(polygon, x + heading * _AHEAD, outlines)
    left, right = outlines.left[edge, polygon], outlines.x[edge, polygon]
    end_x = np.where(heading > 0, right, left)
    end_y = outlines.y[edge, polygon] - (end_x - right) * outlines.fall[edge, polygon]
    at_edge = edge < 0
    return np.where(at_edge, x + heading * _PROBE, end_x), np.where(at_edge, y, end_y), at_edge


class _Walk:
    """Points followed from their start to where they stay, all of them step by step.

    Parameters
    ----------
    x, y
        Where they start [m]; `x`, `m` and `chances` have an entry for each point.
    g
        Probability of a wrong turn.
    m
        Momentum [m].
    chances
        A uniform random number for each polygon, shape [point_count, polygon_count].
    outlines
        Polygons of the scene.
    width
        Width of its box [m].
    """

    def __init__(
        self, x: Floats, y: float, g: float, m: Floats, chances: Floats, outlines: Outlines,
        width: float,
    ) -> None:  # fmt: skip
        self.g, self.m, self.chances, self.outlines, self.width = g, m, chances, outlines, width
        self.x, self.y = x.copy(), np.full_like(x, y)
        self.on, self.along = np.full((2, len(x)), -1)
        """Polygon that a point is on, and that it falls along; -1 for none."""
        self.way = np.zeros(chances.shape, np.int64)
        """How it set off on each polygon: 1 to the right, -1 to the left, 0 if it was not there."""
        self.going = np.full(len(x), fill_value=True)
        self.corner_x, self.corner_y = self.x.copy(), self.y.copy()
        self.corner_count = np.ones(len(x), np.int64)
        self.corners = [(np.arange(len(x)), self.x.copy(), self.y.copy())]
        """Whose, and where [m], as they were come to."""
        self._run()

    def ends(self) -> Iterable[tuple[float, float]]:
        """Where the points stay [m]."""
        return zip(self.corner_x.tolist(), self.corner_y.tolist(), strict=True)

    def paths(self) -> list[Floats]:
        """Corners of each point's path [m], shape [corner_count, 2]."""
        who, x, y = (np.concatenate(column) for column in zip(*self.corners, strict=True))
        order = np.argsort(who, kind="stable")
        return np.split(np.stack([x, y], axis=1)[order], np.cumsum(self.corner_count)[:-1])

    def _run(self) -> None:
        # No surface is followed twice: a bound on the corners of any path.
        most = 2 * self.outlines.x.size + 4 * self.outlines.x.shape[1] + 16
        while (going := self.going & (self.corner_count < most)).any():
            self._fall(np.flatnonzero(going & (self.on < 0)))
            self._follow_surface(np.flatnonzero(going & self.going))

    def _fall(self, who: Indices) -> None:
        """Onto a polygon; or to the floor, where points stay."""
        x, y = self.x[who], self.y[who]
        t, hit = first_hit(x, y, x, np.full_like(y, -1.0), self.along[who], self.outlines)
        landed = (hit >= 0) & (t < y / (y + 1.0))
        self.on[who], self.along[who], self.going[who] = hit, -1, landed
        self._move(who, x, np.where(landed, y - t * (y + 1.0), 0.0))

    def _follow_surface(self, who: Indices) -> None:
        """To the end of a straight piece and to what is met on it, or off an edge."""
        x, y, on = self.x[who], self.y[who], self.on[who]
        heading = self._heading(who, on, x)
        end_x, end_y, at_edge = surface_end(on, x, y, heading, self.outlines)
        t, hit = first_hit(x, y, end_x, end_y, on, self.outlines)
        free, slides = hit < 0, ~at_edge
        x, y = x + t * (end_x - x), y + t * (end_y - y)
        self._move(who[slides], x[slides], y[slides])
        at_wall = (x <= 1e-9) | (x >= self.width - 1e-9)
        self.going[who[slides & free & at_wall]] = False  # a surface that ends at the side wall
        self._meet(who[~free], hit[~free], heading[~free])
        self._leave_edge(who[free & at_edge], heading[free & at_edge])

    def _meet(self, who: Indices, hit: Indices, heading: Indices) -> None:
        """Go on with a polygon that was met on the way, or stay."""
        x = self.x[who] + heading * _AHEAD
        # In the notch below another solid's side there is no way on.
        in_notch = self.y[who] < top_of(hit, x, self.outlines)[0] - _ON_TOP
        against = self._heading(who, hit, x) == -heading  # surfaces that lead into each other
        self.on[who], self.going[who] = hit, ~(in_notch | against)

    def _heading(self, who: Indices, polygon: Indices, x: Floats) -> Indices:
        """Way on a polygon; a point that comes to it at x [m] for the first time sets off."""
        new = self.way[who, polygon] == 0
        first, there = who[new], polygon[new]
        chance = self.chances[first, there]
        self.way[first, there] = direction_on(there, x[new], self.g, chance, self.outlines)
        return self.way[who, polygon]

    def _leave_edge(self, who: Indices, heading: Indices) -> None:
        """Momentum past an edge, until another polygon is met: onto it, or down along its side."""
        x, y, on = self.x[who], self.y[who], self.on[who]
        carried = np.where(self.outlines.is_goal[on], 0.0, heading * self.m[who])
        goal_x = np.minimum(np.maximum(x + carried, 0.0), self.width)
        carries = np.abs(goal_x - x) > _INSIDE
        t, hit = first_hit(x, y, goal_x, y, on, self.outlines)
        x = np.where(carries, x + t * (goal_x - x), x)
        top, _ = top_of(hit, x + heading * _AHEAD, self.outlines)
        lands, meets = (hit >= 0) & (y >= top - _ON_TOP), (hit >= 0) & (y < top - _ON_TOP)
        self.on[who] = np.where(lands, hit, -1)
        self.along[who] = np.where(carries, np.where(meets, hit, -1), on)
        self._move(who, np.where(meets, x - heading * 1e-7, x), y)

    def _move(self, who: Indices, x: Floats, y: Floats) -> None:
        """Put points to another place [m], a corner of their paths unless it is the same."""
        self.x[who], self.y[who] = x, y
        moved = np.abs(self.corner_x[who] - x) + np.abs(self.corner_y[who] - y) >= 1e-9
        who, x, y = who[moved], x[moved], y[moved]
        self.corner_x[who], self.corner_y[who] = x, y
        self.corner_count[who] += 1
        self.corners.append((who, x, y))


MODEL = SimpleSim
