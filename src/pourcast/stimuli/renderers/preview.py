"""Shaded flat pictures: fast, on any machine, good enough to pilot with.

Solids are bevelled and lit from above on the left. The liquid is as opaque as it is deep, so that
films and drops are told from pools.
"""

import math
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from pydantic import Field
from scipy.ndimage import distance_transform_edt, gaussian_filter, maximum_filter, shift

from pourcast.pictures.video import Picture
from pourcast.scenes.geometry import Polygon
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.recording import FULL, Moment, RecordedPour
from pourcast.stimuli.renderers.base import Renderer

Array = NDArray[np.float32]

_WALL = np.array([0.955, 0.955, 0.94], np.float32)
_OBSTACLE = np.array([0.38, 0.42, 0.47], np.float32)
_GOAL = np.array([0.66, 0.42, 0.31], np.float32)
_SHINE, _STEEP = 0.3, 36.0
"""How bright rims are that face the light, and from which slope on [1/m]."""
_LIGHT = np.array([-0.5, -0.85])
"""Towards the light, right and down in the picture."""
_BEVEL = 0.012
"""Width of solids' edges [m]."""
_BLUR, _SHADOW = 0.008, 0.006
"""How soft solids' shadows are, and how far these lie right and below [m]."""
_SUPERSAMPLING = 4
_POINT_CELL = 0.006
"""Cells in which particles are counted [m]."""
_EDGE = 0.25, 0.75
"""Fill of a cell at which liquid begins to be seen, and from which on it covers all behind."""
_SHEET = 0.4
"""Fill of a cell from which on a drop or a sheet thinner than a cell is fully seen."""


class Preview(Renderer):
    """The flat renderer.

    Parameters
    ----------
    width
        Of the pictures [pixels]; their height follows from the box.
    """

    name: ClassVar[str] = "preview"

    width: int = Field(default=600, ge=80, le=4000, multiple_of=2)

    def picture_maker(
        self,
        scene: Scene,
        liquid: Liquid,
        pour: RecordedPour,
        folder: Path | None = None,  # keeps no files
        *,
        threads: int = 0,  # one is enough
    ) -> Picture:
        """What gives the pictures of a pour. See `Renderer.picture_maker`."""
        size = (self.width, 2 * round(self.width * scene.box.height / scene.box.width / 2))
        empty, solid = _solids(scene, size)
        colour = np.array(liquid.rgb, np.float32)
        background = _as_bytes(empty)

        def picture(number: int) -> NDArray[np.uint8]:
            fields = _fields(pour.moments[number], pour, scene)
            depth, seen, gleam = (_stretched(field, scene, size) for field in fields)
            image = background.copy()
            wet = (seen > 0.0) & (solid < 1.0)
            cover = _smooth(seen[wet]) * (1.0 - solid[wet])
            share = (cover * (0.55 + 0.35 * np.minimum(depth[wet], 1.0)))[:, None]
            shades = empty[wet] + share * (colour - empty[wet])
            shades += (_SHINE * gleam[wet] * cover)[:, None] * (1.0 - shades)
            image[wet] = _as_bytes(shades)
            return image

        return picture

    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """Its colour. See `Renderer.liquid_identity`."""
        return {"colour": liquid.colour}


def _as_bytes(shades: Array) -> NDArray[np.uint8]:
    pixels: NDArray[np.uint8] = np.round(255.0 * np.clip(shades, 0.0, 1.0)).astype(np.uint8)
    return pixels


def _smooth(level: Array) -> Array:
    """A soft step from 0 to 1."""
    x = np.clip(level, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


class _Field(NamedTuple):
    """A field over x and y, on cells."""

    values: Array
    """Shape [nx, ny]."""
    cell: float
    origin: tuple[float, float]


def _fields(moment: Moment, pour: RecordedPour, scene: Scene) -> tuple[_Field, _Field, _Field]:
    """Share of the box's depth that is liquid; how well it is seen; how much it gleams."""
    if moment.fill.size == 0:
        depth, seen, cell = _particles_seen(moment, pour.cell, scene)
        origin = (0.0, 0.0)
    else:
        depth, seen, cell = *_cells_seen(moment, pour), pour.cell
        origin = pour.origin[:2]
    slope = np.gradient(gaussian_filter(_smooth(seen), 0.5), cell)
    gleam = np.clip((-_LIGHT[0] * slope[0] + _LIGHT[1] * slope[1]) / _STEEP, 0.0, 1.0)
    return (
        _Field(depth, cell, origin),
        _Field(seen, cell, origin),
        _Field(gleam.astype(np.float32), cell, origin),
    )


def _cells_seen(moment: Moment, pour: RecordedPour) -> tuple[Array, Array]:
    """Mean fill through the depth, and how much is covered by the layer that has most."""
    fill = moment.fill.astype(np.float32) / FULL
    places = [
        np.clip(((moment.points[:, k] - pour.origin[k]) / pour.cell).astype(int), 0, n - 1)
        for k, n in enumerate(fill.shape)
    ]
    np.add.at(fill, tuple(places), moment.points[:, 3] / pour.cell**3)
    most = np.minimum(fill.max(axis=2), 1.0)
    return fill.mean(axis=2), _seen(most, most / _SHEET, 1.0)


def _particles_seen(moment: Moment, spacing: float, scene: Scene) -> tuple[Array, Array, float]:
    box = scene.box
    shape = (round(box.width / _POINT_CELL), round(box.height / _POINT_CELL))
    counts = np.histogram2d(
        moment.points[:, 0], moment.points[:, 1], bins=shape,
        range=((0.0, box.width), (0.0, box.height)),
    )[0].astype(np.float32)  # fmt: skip
    blur = 0.5 * spacing / _POINT_CELL
    # 1 in the middle of a single particle
    peaks = gaussian_filter(counts, blur) * np.float32(2.0 * np.pi * blur**2)
    # In bulk, a particle for each spacing in all three directions; its edge is where half is.
    bulk = 2.0 * np.pi * 0.5**2 * max(1.0, box.depth / spacing)
    seen = _seen(np.minimum(peaks / bulk, 1.0), (peaks - 0.35) / 0.25, spacing / _POINT_CELL)
    return peaks * (spacing / box.depth), seen, box.width / shape[0]


def _seen(fill: Array, thin: Array, width: float) -> Array:
    """How well liquid is seen: near bulk by where it is half full, elsewhere as what is thin.

    Parameters
    ----------
    fill
        Share of what bulk has, shape [nx, ny].
    thin
        How well sheets and drops are seen, which have less; of the same shape.
    width
        How near bulk is [cells].
    """
    near = maximum_filter(fill, 2 * round(1.5 * width) + 1)
    # Blurred, or bulk would end in a line.
    near = np.minimum(near, gaussian_filter(near, 0.5 * width) + 0.3)
    bulk = np.clip((near - 0.3) / 0.4, 0.0, 1.0)
    covered = (fill - _EDGE[0]) / (_EDGE[1] - _EDGE[0])
    seen: Array = np.clip(covered, 0.0, 1.0) * bulk + np.clip(thin, 0.0, 1.0) * (1.0 - bulk)
    return seen.astype(np.float32)


def _stretched(field: _Field, scene: Scene, size: tuple[int, int]) -> Array:
    """A field as the pixels of a picture, the highest row first."""
    rows = np.pad(field.values.T[::-1], 1, mode="edge")
    left = 1.0 - field.origin[0] / field.cell
    bottom = rows.shape[0] - 1.0 + field.origin[1] / field.cell
    right = min(left + scene.box.width / field.cell, float(rows.shape[1]))
    top = max(0.0, bottom - scene.box.height / field.cell)
    image = Image.fromarray(np.ascontiguousarray(rows, dtype=np.float32))
    return np.asarray(image.resize(size, Image.Resampling.BICUBIC, box=(left, top, right, bottom)))


def _solids(scene: Scene, size: tuple[int, int]) -> tuple[Array, Array]:
    """The box without liquid, and where its solids are, from 0 to 1."""
    image = np.broadcast_to(_WALL, (size[1], size[0], 3)).copy()
    covered = np.zeros((size[1], size[0]), np.float32)
    scale = size[0] / scene.box.width
    for polygons, colour in ((scene.obstacles, _OBSTACLE), (scene.goal.solids, _GOAL)):
        for polygon in polygons:
            at = _around(polygon, size, scale)
            mask, part, before = _mask(polygon, at, size, scale), image[at], covered[at]
            # A soft shadow on the wall behind.
            shade = shift(gaussian_filter(mask, _BLUR * scale), round(_SHADOW * scale), order=0)
            part *= 1.0 - 0.18 * (shade * (1.0 - mask) * (1.0 - before))[..., None]
            lit = (colour * _lighting(mask, scale)[..., None]).astype(np.float32)
            part += mask[..., None] * (np.clip(lit, 0.0, 1.0) - part)
            before[:] = np.maximum(before, mask)
    return image, covered


def _around(polygon: Polygon, size: tuple[int, int], scale: float) -> tuple[slice, slice]:
    """Rows and columns of the pixels that a polygon, its shadow and its edges change."""
    # SciPy's Gaussian ends at four standard deviations.
    margin = math.ceil((4.0 * _BLUR + _SHADOW) * scale) + 2
    x, y = np.array(polygon).T * scale
    columns, rows = (x.min(), x.max()), (size[1] - y.max(), size[1] - y.min())
    ends = [
        (max(0, math.floor(low) - margin), min(count, math.ceil(high) + margin))
        for (low, high), count in ((rows, size[1]), (columns, size[0]))
    ]
    return slice(*ends[0]), slice(*ends[1])


def _mask(polygon: Polygon, at: tuple[slice, slice], size: tuple[int, int], scale: float) -> Array:
    """How much of each pixel in some rows and columns a polygon covers."""
    (top, bottom), (left, right) = ((part.start, part.stop) for part in at)
    shape = (right - left, bottom - top)
    fine = Image.new("L", (shape[0] * _SUPERSAMPLING, shape[1] * _SUPERSAMPLING))
    corners = [
        ((x * scale - left) * _SUPERSAMPLING, (size[1] - top - y * scale) * _SUPERSAMPLING)
        for x, y in polygon
    ]
    ImageDraw.Draw(fine).polygon(corners, fill=255)
    return np.asarray(fine.resize(shape, Image.Resampling.BOX), dtype=np.float32) / 255.0


def _lighting(mask: Array, scale: float) -> Array:
    """Brightness of a bevelled solid, 1 on its face."""
    height = np.minimum(distance_transform_edt(mask > 0.5), _BEVEL * scale)
    slope = np.gradient(gaussian_filter(height, 0.15 * _BEVEL * scale))
    tilt = slope[1] * -_LIGHT[0] + slope[0] * -_LIGHT[1]
    brightness: Array = (1.0 - 0.35 * np.clip(-tilt, -1.0, 1.0)).astype(np.float32)
    return brightness


RENDERER = Preview
