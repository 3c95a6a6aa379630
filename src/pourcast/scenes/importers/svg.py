"""SVG: scenes drawn in any vector editor.

A shape's part is told by its name (id, class or Inkscape label) or else by
its fill: names that begin with `liquid`, `water` or `honey`, or a blue fill: the
liquid; `cup` or green: the cup; `divider` or red: the divider between two
basins; `box`: the frame, otherwise the page; everything else that is filled:
an obstacle. Liquid, cup and divider take the place and size of the shape's
bounding box. Curves are flattened, and shapes that are not convex are split.
"""

import colorsys
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry
from svgelements import SVG, Close, Color, Line, Move, Shape
from svgelements import Path as SvgPath

from pourcast.errors import InputError
from pourcast.scenes.geometry import Polygon
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.importers.fields import built
from pourcast.scenes.polygons import convex_pieces
from pourcast.scenes.scene import Box, LiquidStart, Scene

CURVE_POINTS = 12
"""Straight pieces that a curve segment becomes."""

TOLERANCE = 5e-4
"""Flattened outlines are simplified by this much [m]."""

_NAMES = {
    "liquid": ("liquid", "water", "honey"),
    "cup": ("cup",),
    "divider": ("divider",),
    "box": ("box", "frame"),
    "obstacle": ("obstacle",),
}


def read(text: str, path: Path, width: float) -> Scene:
    """Turn a drawing into a scene.

    Parameters
    ----------
    text
        The SVG.
    path
        Its file, for the scene's name and for messages.
    width
        Width of the box in metres; the drawing is scaled to it.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    InputError
        If it is not an SVG, has no or several liquids, or makes no valid scene.
    """
    try:
        drawing = SVG.parse(io.StringIO(text), reify=True)
    except (ParseError, ValueError, TypeError, AttributeError, KeyError, IndexError) as error:
        raise InputError(f"{path}: not an SVG drawing ({error})") from None
    parts: dict[str, list[BaseGeometry]] = {name: [] for name in _NAMES}
    for element in drawing.elements():
        if isinstance(element, Shape) and not _hidden(element):
            part = _part_of(element)
            outline = _outline(element) if part else None
            if part and outline is not None and not outline.is_empty:
                parts[part].append(outline)
    frame = parts["box"][0].bounds if parts["box"] else _page(drawing, path)
    scale = width / (frame[2] - frame[0])
    # SVG's y points down.
    transform: Callable[[NDArray[np.float64]], NDArray[np.float64]] = lambda points: np.stack(  # noqa: E731
        [(points[:, 0] - frame[0]) * scale, (frame[3] - points[:, 1]) * scale], axis=1
    )
    placed = {
        name: [shapely.transform(shape, transform) for shape in shapes]
        for name, shapes in parts.items()
    }
    box = Box(width=width, height=round((frame[3] - frame[1]) * scale, 6))
    if len(placed["liquid"]) != 1:
        raise InputError(
            f"{path}: expected one shape named 'liquid' or filled blue, "
            f"found {len(placed['liquid'])}"
        )
    return built(
        lambda: Scene(
            id=path.stem,
            box=box,
            obstacles=_obstacles(placed["obstacle"], box),
            liquid=_liquid(placed["liquid"][0]),
            goal=_goal(placed, box, path),
        ),
        path,
    )


def _hidden(element: Any) -> bool:
    values = element.values
    return "none" in (values.get("display"), values.get("visibility")) or (
        values.get("visibility") == "hidden"
    )


def _part_of(element: Any) -> str | None:
    """Which part a shape is, by name or else by colour; None for decoration."""
    values = element.values
    label = values.get("{http://www.inkscape.org/namespaces/inkscape}label")
    for name in (element.id, label, values.get("class")):
        for part, beginnings in _NAMES.items():
            if name and str(name).lower().startswith(beginnings):
                return part
    fill = element.fill
    if not isinstance(fill, Color) or fill.value is None or fill.alpha == 0:
        return None
    hue, saturation, value = colorsys.rgb_to_hsv(fill.red / 255, fill.green / 255, fill.blue / 255)
    if value > 0.97 and saturation < 0.03:
        return None  # a white background
    if saturation > 0.35 and value > 0.25:
        for part, low, high in (
            ("liquid", 0.5, 0.72),
            ("cup", 0.25, 0.45),
            ("divider", 0.95, 1.03),
        ):
            if low <= hue <= high or low <= hue + 1 <= high:
                return part
    return "obstacle"


def _outline(element: Any) -> BaseGeometry | None:
    """Area that a shape covers, in the drawing's units; holes by the even-odd rule."""
    area: BaseGeometry = shapely.Polygon()
    # abs() applies the element's transform, a group's rotation for example.
    for subpath in abs(SvgPath(element)).as_subpaths():
        points: list[tuple[float, float]] = []
        for segment in SvgPath(subpath):
            if isinstance(segment, Move | Close | Line):
                sampled = [segment.end] if segment.end is not None else []
            else:
                sampled = [segment.point(k / CURVE_POINTS) for k in range(1, CURVE_POINTS + 1)]
            points += [(float(point.x), float(point.y)) for point in sampled]
        if len(points) >= 3:
            area = area.symmetric_difference(shapely.make_valid(shapely.Polygon(points)))
    return area if area.area > 0 else None


def _page(drawing: Any, path: Path) -> tuple[float, float, float, float]:
    width, height = drawing.width, drawing.height
    if not width or not height or width <= 0 or height <= 0:
        raise InputError(f"{path}: expected a viewBox, a width and height, or a shape named 'box'")
    return 0.0, 0.0, float(width), float(height)


def _obstacles(shapes: list[BaseGeometry], box: Box) -> tuple[Polygon, ...]:
    inside = shapely.box(0.0, 0.0, box.width, box.height)
    pieces: list[Polygon] = []
    for shape in shapes:
        pieces += convex_pieces(shape.simplify(TOLERANCE).intersection(inside))
    return tuple(pieces)


def _liquid(shape: BaseGeometry) -> LiquidStart:
    low_x, low_y, high_x, high_y = shape.bounds
    return LiquidStart(
        centre=(round((low_x + high_x) / 2, 6), round((low_y + high_y) / 2, 6)),
        diameter=round((high_x - low_x + high_y - low_y) / 2, 6),
    )


def _goal(parts: dict[str, list[BaseGeometry]], box: Box, path: Path) -> Basins | Cup:
    if len(parts["cup"]) + len(parts["divider"]) > 1:
        raise InputError(f"{path}: expected at most one cup or divider")
    if parts["cup"]:
        low_x, _, high_x, high_y = parts["cup"][0].bounds
        return Cup(
            centre_x=round((low_x + high_x) / 2, 6),
            width=round(high_x - low_x, 6),
            height=round(high_y, 6),
        )
    if parts["divider"]:
        low_x, _, high_x, high_y = parts["divider"][0].bounds
        return Basins(
            divider_x=round((low_x + high_x) / 2, 6),
            divider_width=round(high_x - low_x, 6),
            divider_height=round(high_y, 6),
        )
    return Basins(divider_x=box.width / 2)
