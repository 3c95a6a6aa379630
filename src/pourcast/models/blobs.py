"""Blobs: molecules on a grid that fall, ask one another for room, and give way; no physics.

After the analogical representation of liquids by Gardin & Meltzer (1989, Artificial Intelligence
38, 139-159; with Stofella 1986, ECAI), which Bates et al. (2019) show in a figure and don't fit.

What is theirs and what is ours: neither text could be had, nor any that states their rules. Known
at second hand is that a liquid is a collection of "molecules" or "blobs" on a grid, which fall,
spread, stop, and tell one another so by a few rules. That is kept; the rules in `Blobs` are ours.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.models.base import Model, parameter
from pourcast.progress import Progress, no_progress
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene

if TYPE_CHECKING:
    from pourcast.models._blob_rules import Molecules

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_TOUCH = 1e-7
"""Solids closer than this [m] to a way close it; so is the seam between two of them."""

_MAX_CELLS = 1_000_000
"""Of a grid: a judgment then takes 1 s with 100 molecules, 5 s with 5000, and the time grows
faster than the number of cells."""

_FILM_SPEED = 0.02
"""What falls moves about so far between two frames of a film [m]."""


@dataclass(frozen=True)
class Blobs(Model):
    """Molecules, one in a cell, that fall, spread, level out and overflow by messages.

    The grid's cells are as large as a molecule. In a time step every molecule moves by one
    cell at most; row has its turn after row, from the floor upwards:

    1. Of a row, those fall first that have a free cell below.
    2. Each other one that has a free cell beside or above asks for room. The question goes from
       cell to cell, through molecules and along free cells of its own row, never higher, as
       they were at the beginning of the time step.
    3. The nearest free cell below its row answers. Of two that are as near, it is that on the
       side to which the molecule last moved; at first half of them, drawn by the seed, prefer
       each side.
    4. It gives way towards that room, and what stands in the way is pushed on by one; unless
       one of those has moved in this time step already.
    5. If nobody answers, it tells those as high that it reached; they don't ask in this time step.
    6. All is over when nobody moves.

    There is a way between two cells if the straight line between their middles meets no solid.
    So no wall is too thin to hold liquid, and basins that liquid joins differ by one cell in level
    at most. A slope that rises by less than a cell is level. The mirror image of a scene has the
    mirrored judgment, exactly; but a scene that is its own mirror image has one judgment, in which
    the seed may favour a side.
    """

    seconds_per_judgment = 0.004

    n_molecules: int = parameter(
        100, low=1, high=5000, doc="number of molecules N, each as large as a cell of the grid"
    )

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
    ) -> Floats:
        """Judge scenes; what is drawn for a scene depends on the seed and on the scene alone."""
        judgments = []
        for done, scene in enumerate(scenes, start=1):
            ends = self._at_rest(scene, seed)
            judgments.append(np.mean([scene.goal.holds(x, y) for x, y in ends.tolist()]))
            progress(done, len(scenes))
        return np.array(judgments)

    def film(self, scene: Scene, seed: int = 0) -> tuple[Floats, float]:
        """The molecules from start to rest.

        Parameters
        ----------
        scene
            The scene.
        seed
            Source of the sides that molecules prefer at first.

        Returns
        -------
        positions
            Middles of the molecules' cells [m], shape [frame_count, n_molecules, 2].
        size
            Length of a cell's side [m].
        """
        from pourcast.models._blob_rules import move_once  # noqa: PLC0415 - Numba is slow to import

        grid, molecules = self._placed(scene, seed)
        frames, columns = [molecules.cell.copy()], grid.down.shape[1]
        while move_once(molecules, columns):
            frames.append(molecules.cell.copy())
        every = max(1, round(_FILM_SPEED / grid.size))
        shown = [*frames[:-1:every], frames[-1]]
        return grid.middles(np.array(shown)), grid.size

    def _at_rest(self, scene: Scene, seed: int) -> Floats:
        """Where the molecules end [m], shape [n_molecules, 2]."""
        from pourcast.models._blob_rules import move_to_rest  # noqa: PLC0415

        grid, molecules = self._placed(scene, seed)
        move_to_rest(molecules, grid.down.shape[1])
        return grid.middles(molecules.cell)

    def _placed(self, scene: Scene, seed: int) -> "tuple[_Grid, Molecules]":
        from pourcast.models._blob_rules import place_molecules  # noqa: PLC0415

        grid = _grid_of(scene, self.n_molecules)
        seen = zlib.crc32(grid.down.tobytes() + grid.right.tobytes())
        rng = np.random.default_rng([seed, seen])
        sides = (np.arange(len(grid.start)) + rng.integers(2)) % 2 * 2 - 1
        return grid, place_molecules(grid.down, grid.right, grid.start, rng.permutation(sides))


class _Grid(NamedTuple):
    """A scene as molecules see it; of a scene and its mirror image, both see the same one."""

    down: Flags
    """Whether there is a way from a cell to the one below, shape [row_count, column_count]."""
    right: Flags
    """Whether there is a way to the one on the right."""
    start: NDArray[np.int64]
    """Cells in which the molecules start, shape [n_molecules]."""
    size: float
    """Length of a cell's side [m]."""
    in_mirror: bool
    """Whether it is the mirror image that is seen."""

    def middles(self, cells: NDArray[np.int64]) -> Floats:
        """Middles of cells in the scene itself [m]; x and y along a new last axis."""
        columns = self.down.shape[1]
        row, column = np.divmod(cells, columns)
        column = columns - 1 - column if self.in_mirror else column
        return (np.stack([column, row], axis=-1) + 0.5) * self.size


def _grid_of(scene: Scene, n_molecules: int) -> _Grid:
    box, (centre_x, centre_y) = scene.box, scene.liquid.centre
    area = pi * scene.liquid.diameter**2 / 4
    columns = max(1, round(box.width / sqrt(area / n_molecules)))
    size = box.width / columns
    if columns * ceil(box.height / size) > _MAX_CELLS:
        raise InputError(
            f"scene {scene.id!r}: liquid.diameter: {n_molecules} blobs of a liquid "
            f"{scene.liquid.diameter:g} m wide make a grid of "
            f"{columns * ceil(box.height / size):,} cells in a box of {box.width:g} x "
            f"{box.height:g} m, expected at most {_MAX_CELLS:,}: take fewer molecules, a wider "
            "liquid or a smaller box"
        )
    x, y = (np.arange(k, dtype=np.float64) + 0.5 for k in (columns, ceil(box.height / size)))
    x, y = x * size, y * size
    free, right = _free_and_ways(scene, y, x, along=0)
    down = _free_and_ways(scene, x, y, along=1)[1].T
    right = np.pad(right, ((0, 0), (0, 1)))
    down = np.pad(down, ((1, 0), (0, 0)))
    left = np.roll(right, 1, axis=1)
    seen = (round(centre_x, 6), down.tobytes(), right.tobytes())
    mirror_x = box.width - centre_x
    mirrored = (round(mirror_x, 6), down[:, ::-1].tobytes(), left[:, ::-1].tobytes())
    in_mirror = mirrored < seen
    if in_mirror:
        centre_x, free, down, right = mirror_x, free[:, ::-1], down[:, ::-1], left[:, ::-1]
    distance = np.hypot(x - centre_x, y[:, None] - centre_y) / size
    nearest = np.argsort(np.where(free, distance.round(6), np.inf), axis=None, kind="stable")
    return _Grid(down, right, nearest[:n_molecules], size, in_mirror)


def _free_and_ways(scene: Scene, lines: Floats, stops: Floats, along: int) -> tuple[Flags, Flags]:
    """Which stops on parallel lines no solid covers, and from which there is a way to the next.

    Parameters
    ----------
    scene
        The scene.
    lines
        Where the lines are [m]: heights, or places across.
    stops
        Where the stops on each line are [m], in order.
    along
        0 for level lines, 1 for upright ones.

    Returns
    -------
    free, ways
        Shapes [line_count, stop_count] and [line_count, stop_count - 1].
    """
    if not scene.solids:
        nothing = np.ones((len(lines), len(stops)), np.bool_)
        return nothing, nothing[:, 1:]
    polygons = [np.array(polygon) for polygon in scene.solids]
    begin = np.concatenate(polygons)[..., None]
    end = np.concatenate([np.roll(polygon, -1, axis=0) for polygon in polygons])[..., None]
    first = np.cumsum([0, *map(len, polygons[:-1])])
    across = 1 - along
    low, high = np.minimum(begin, end)[:, across], np.maximum(begin, end)[:, across]
    met = (low <= lines + _TOUCH) & (high >= lines - _TOUCH) & (high > low)
    share = (lines - begin[:, across]) / np.where(met, (end - begin)[:, across], 1.0)
    place = begin[:, along] + np.clip(share, 0.0, 1.0) * (end - begin)[:, along]
    # A convex solid covers one piece of a line: from the first edge that is met to the last.
    enter = np.minimum.reduceat(np.where(met, place, np.inf), first)[..., None] - _TOUCH
    leave = np.maximum.reduceat(np.where(met, place, -np.inf), first)[..., None] + _TOUCH
    free = ((enter > stops) | (stops > leave)).all(axis=0)
    ways = ((enter > stops[1:]) | (stops[:-1] > leave)).all(axis=0)
    return np.asarray(free), np.asarray(ways)


MODEL = Blobs
