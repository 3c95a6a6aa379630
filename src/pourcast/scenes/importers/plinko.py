"""Plinko JSON: the worlds of published obstacle-course studies.

The format of Gerstenberg, Siegel & Tenenbaum, "What happened? Reconstructing
the past through vision and sound": lengths in pixels, y up. The box is
`config.width` wide around `config.med` (the middle of the screen), from the
ground at `config.ground_y` (whose upper side is 5 px higher) to `config.med` +
`config.height` / 2; obstacles are regular polygons of circumradius `size`
whose first corner points up, turned by `rotation`. The drop is at
`data.ball[0]`, else above the hole `config.hole_dropped_into`.
"""

import math
from pathlib import Path
from typing import Any

import shapely

from pourcast.errors import InputError
from pourcast.scenes.geometry import Polygon
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.importers.fields import built, member, number
from pourcast.scenes.polygons import ring_of
from pourcast.scenes.scene import Box, LiquidStart, Scene

GROUND_HALF_THICKNESS = 5.0
"""The ground is a bar of 10 px around `ground_y`."""

_DIVIDER_HEIGHT = 0.1


def read(content: dict[str, Any], path: Path, width: float) -> Scene:
    """Turn a plinko world into a scene.

    Parameters
    ----------
    content
        The parsed JSON.
    path
        Its file, for the scene's name and for messages.
    width
        Width of the box in metres.

    Returns
    -------
    Scene
        With the ball as the liquid and two basins as the goal. The ball drops from
        above the plinko box, so the scene's box is that much higher.
    """
    config = member(content, "config", path, "config")

    def value(key: str) -> float:
        return number(member(config, key, path, f"config.{key}"), path, f"config.{key}")

    pixel_width = value("width")
    if pixel_width <= 0:
        raise InputError(f"{path}: config.width: expected a positive number of pixels")
    scale = width / pixel_width
    middle = value("med") if "med" in config else _screen_middle(config, path)
    left, floor = middle - pixel_width / 2, value("ground_y") + GROUND_HALF_THICKNESS
    radius = value("ball_radius") * scale
    ball_x, ball_y = _drop(content, config, path)
    centre = (round((ball_x - left) * scale, 6), round((ball_y - floor) * scale, 6))
    top = (middle + value("height") / 2 - floor) * scale
    obstacles = member(config, "obstacles", path, "config.obstacles")
    if not isinstance(obstacles, dict):
        raise InputError(f"{path}: config.obstacles: expected an object of name -> obstacle")
    polygons = [_ngon(entry, path, name, left, floor, scale) for name, entry in obstacles.items()]
    return built(
        lambda: Scene(
            id=path.stem,
            box=Box(width=width, height=round(max(top, centre[1] + radius), 6)),
            obstacles=tuple(polygons),
            liquid=LiquidStart(centre=centre, diameter=round(2 * radius, 6)),
            goal=Basins(divider_x=width / 2, divider_height=_DIVIDER_HEIGHT * width),
        ),
        path,
    )


def _screen_middle(config: Any, path: Path) -> float:
    size = member(config, "screen_size", path, "config.screen_size")
    screen_width = member(size, "width", path, "config.screen_size.width")
    return number(screen_width, path, "config.screen_size.width") / 2


def _drop(content: dict[str, Any], config: Any, path: Path) -> tuple[float, float]:
    data = content.get("data")
    if isinstance(data, dict) and data.get("ball"):
        ball = member(data["ball"], 0, path, "data.ball[0]")
        x, y = (member(ball, axis, path, f"data.ball[0].{axis}") for axis in "xy")
        return number(x, path, "data.ball[0].x"), number(y, path, "data.ball[0].y")
    hole = member(config, "hole_dropped_into", path, "data.ball")
    where = "config.hole_positions"
    x = member(member(config, "hole_positions", path, where), hole, path, f"{where}[{hole}]")
    middle = number(config.get("med", 0), path, "config.med") or _screen_middle(config, path)
    height = number(member(config, "height", path, "config.height"), path, "config.height")
    radius = number(config["ball_radius"], path, "config.ball_radius")
    return number(x, path, where), middle + height / 2 + radius


def _ngon(entry: Any, path: Path, name: str, left: float, floor: float, scale: float) -> Polygon:
    where = f"config.obstacles.{name}"
    sides = number(member(entry, "n_sides", path, f"{where}.n_sides"), path, f"{where}.n_sides")
    if sides != int(sides) or not 3 <= sides <= 1000:
        raise InputError(
            f"{path}: {where}.n_sides: expected a whole number from 3, found {sides:g}"
        )
    position = member(entry, "position", path, f"{where}.position")
    x, y = (
        number(member(position, axis, path, f"{where}.position.{axis}"), path, f"{where}.{axis}")
        for axis in "xy"
    )
    size = number(member(entry, "size", path, f"{where}.size"), path, f"{where}.size")
    turn = number(member(entry, "rotation", path, f"{where}.rotation"), path, f"{where}.rotation")
    corners = []
    for k in range(int(sides)):
        # Corner k of the unturned polygon is (sin a, cos a); turning is counter-clockwise.
        angle = math.pi / 2 - 2 * math.pi * k / sides + turn
        corner_x, corner_y = x + size * math.cos(angle), y + size * math.sin(angle)
        corners.append(((corner_x - left) * scale, (corner_y - floor) * scale))
    return ring_of(shapely.MultiPoint(corners))
