"""Scenes: a box, convex obstacles, a liquid's start and a goal, and their JSON form.

Lengths are in metres; x points right, y up, z into the screen; the origin is
the front left corner of the floor. Obstacles are polygons in the x-y plane,
extruded through the whole depth of the box.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import shapely
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from pourcast.errors import InputError
from pourcast.files import write_text

SCHEMA_VERSION = 1
"""Version of the JSON form; a file of another version is refused."""

Point = tuple[float, float]
"""A point in the x-y plane [m]."""

Polygon = tuple[Point, ...]
"""Vertices of a polygon [m]."""

_MIN_AREA = 1e-8
_TOLERANCE = 1e-9
_SLACK = 1e-6
"""Coordinates are rounded to a micrometre; things that touch may overlap by as much [m]."""
_LARGEST_LENGTH = 20.0


def _checked_convex(polygon: Polygon) -> Polygon:
    """Return a convex polygon counter-clockwise; raise ValueError for any other."""
    if len(polygon) < 3:
        raise ValueError(f"a polygon needs at least 3 vertices, this one has {len(polygon)}")
    for k, (x, y) in enumerate(polygon):
        next_x, next_y = polygon[(k + 1) % len(polygon)]
        if math.hypot(next_x - x, next_y - y) < 1e-7:
            raise ValueError(f"vertices {k} and {(k + 1) % len(polygon)} coincide")
    shape = shapely.Polygon(polygon)
    if not shape.is_valid:
        raise ValueError("the polygon crosses itself or has no area")
    if shape.area < _MIN_AREA:
        raise ValueError("the polygon has no area")
    ordered = polygon if shape.exterior.is_ccw else polygon[::-1]
    if any(turn < -_TOLERANCE for turn in _turns(ordered)):
        raise ValueError("the polygon is not convex (split it, or use `pourcast import`)")
    return ordered


def _turns(polygon: Polygon) -> list[float]:
    """Cross product of successive edges at each vertex [m^2]."""
    turns = []
    for k, (bx, by) in enumerate(polygon):
        (ax, ay), (cx, cy) = polygon[k - 1], polygon[(k + 1) % len(polygon)]
        turns.append((bx - ax) * (cy - by) - (by - ay) * (cx - bx))
    return turns


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Length = Annotated[float, Field(gt=0.0, le=_LARGEST_LENGTH)]


class Box(_Frozen):
    """The box that holds a scene [m]; the lid is open.

    The default depth equals the diameter of the paper's cylinder of liquid.
    """

    width: Length = 1.0
    height: Length = 1.5
    depth: Length = 0.148


class LiquidStart(_Frozen):
    """Where the liquid starts: a cylinder through the depth of the box."""

    centre: Point
    """Centre in the x-y plane [m]."""
    diameter: Length = 0.148


class Basins(_Frozen):
    """Experiment 1's goal: a wedge divides the floor; the judgment is the share right of it."""

    kind: Literal["basins"] = "basins"
    divider_x: float = 0.5
    """Where the wedge's tip stands [m]."""
    divider_width: Length = 0.1
    """Width of the wedge's foot [m]."""
    divider_height: Length = 0.2

    @property
    def solids(self) -> tuple[Polygon, ...]:
        """The wedge as a polygon."""
        half = self.divider_width / 2
        return (
            (
                (self.divider_x - half, 0.0),
                (self.divider_x + half, 0.0),
                (self.divider_x, self.divider_height),
            ),
        )

    @property
    def rim(self) -> float:
        """Height [m] that liquid must climb to change sides."""
        return self.divider_height

    def holds(self, x: float, y: float) -> bool:
        """Whether a point counts towards the judgment."""
        return x > self.divider_x

    def mirrored(self, width: float) -> "Basins":
        """The same goal seen in a mirror (the judged basin stays the right one)."""
        return self.model_copy(update={"divider_x": width - self.divider_x})


class Cup(_Frozen):
    """Experiment 2's goal: a cup on the floor; the judgment is the share inside it."""

    kind: Literal["cup"] = "cup"
    centre_x: float = 0.5
    width: Length = 1 / 3
    """Outer width [m]; the paper: a third of the scene."""
    height: Length = 0.18
    wall: Length = 0.015
    """Thickness of the two walls [m]."""

    @model_validator(mode="after")
    def _walls_leave_room(self) -> "Cup":
        if 2 * self.wall >= self.width:
            raise ValueError("the cup's walls leave no room inside (2 * wall >= width)")
        return self

    @property
    def solids(self) -> tuple[Polygon, ...]:
        """The two walls as polygons; the floor is the bottom."""
        left, right = self.centre_x - self.width / 2, self.centre_x + self.width / 2
        return tuple(
            ((x, 0.0), (x + self.wall, 0.0), (x + self.wall, self.height), (x, self.height))
            for x in (left, right - self.wall)
        )

    @property
    def rim(self) -> float:
        """Height [m] that liquid must climb to enter or to leave."""
        return self.height

    def holds(self, x: float, y: float) -> bool:
        """Whether a point counts towards the judgment."""
        return abs(x - self.centre_x) < self.width / 2 and y < self.height

    def mirrored(self, width: float) -> "Cup":
        """The same goal seen in a mirror."""
        return self.model_copy(update={"centre_x": width - self.centre_x})


Goal = Annotated[Basins | Cup, Field(discriminator="kind")]


def _finite_number(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("Input should be a number")
    return value


_Coordinate = Annotated[float, BeforeValidator(_finite_number)]


class Scene(_Frozen):
    """One trial: what stands where before the liquid is let go.

    Raises
    ------
    pydantic.ValidationError
        If something is not finite, outside the box, not convex, crossing
        itself, without area, or in the liquid's way at the start.

    Examples
    --------
    >>> scene = Scene(
    ...     id="ramp",
    ...     obstacles=(((0.3, 0.7), (0.6, 0.7), (0.3, 0.9)),),
    ...     liquid=LiquidStart(centre=(0.4, 1.3)),
    ... )
    >>> scene.mirrored().liquid.centre
    (0.6, 1.3)
    >>> scene.mirrored().mirrored().digest == scene.digest
    True
    """

    id: str = Field(min_length=1, max_length=200)
    box: Box = Box()
    obstacles: tuple[tuple[tuple[_Coordinate, _Coordinate], ...], ...] = ()
    """Convex polygons [m]; stored counter-clockwise."""
    liquid: LiquidStart
    goal: Goal = Basins()

    @field_validator("obstacles")
    @classmethod
    def _convex(cls, obstacles: tuple[Polygon, ...]) -> tuple[Polygon, ...]:
        checked = []
        for k, polygon in enumerate(obstacles):
            try:
                checked.append(_checked_convex(polygon))
            except ValueError as error:
                raise ValueError(f"obstacle {k}: {error}") from None
        return tuple(checked)

    @model_validator(mode="after")
    def _fits(self) -> "Scene":
        box = self.box
        inside = shapely.box(-_SLACK, -_SLACK, box.width + _SLACK, box.height + _SLACK)
        blob = shapely.Point(self.liquid.centre)
        radius = self.liquid.diameter / 2
        x, y = self.liquid.centre
        margins = (x, y, box.width - x, box.height - y)
        if min(margins) < radius - _SLACK:
            raise ValueError("liquid: the cylinder is not inside the box")
        parts = [(f"obstacle {k}", p) for k, p in enumerate(self.obstacles)]
        parts += [(f"goal ({self.goal.kind})", p) for p in self.goal.solids]
        for name, polygon in parts:
            shape = shapely.Polygon(polygon)
            if not inside.covers(shape):
                raise ValueError(f"{name} is outside the box of {box.width:g} m x {box.height:g} m")
            if shape.distance(blob) < radius - _SLACK:
                raise ValueError(f"{name} overlaps the liquid's start")
        return self

    @property
    def solids(self) -> tuple[Polygon, ...]:
        """Obstacles and the goal's parts: all that the liquid can meet but the box."""
        return self.obstacles + self.goal.solids

    @property
    def digest(self) -> str:
        """Name of the content: the same for the same scene, whatever its id."""
        content = json.dumps(self.model_dump(mode="json", exclude={"id"}), sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()[:12]

    def mirrored(self) -> "Scene":
        """The scene seen in a mirror, left and right exchanged."""
        width = self.box.width

        def flip(x: float) -> float:
            return round(width - x, 9)  # rounding makes it its own inverse

        return Scene(
            id=self.id,
            box=self.box,
            obstacles=tuple(tuple((flip(x), y) for x, y in p[::-1]) for p in self.obstacles),
            liquid=LiquidStart(
                centre=(flip(self.liquid.centre[0]), self.liquid.centre[1]),
                diameter=self.liquid.diameter,
            ),
            goal=self.goal.mirrored(width),
        )


class SceneFile(_Frozen):
    """The JSON form of a list of scenes."""

    model_config = ConfigDict(title="pourcast scenes")

    format: Literal["pourcast-scenes"] = "pourcast-scenes"
    schema_version: Literal[1] = 1
    units: Literal["m"] = "m"
    """Metres, always; here so that nobody has to guess."""
    scenes: tuple[Scene, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _ids_differ(self) -> "SceneFile":
        seen: set[str] = set()
        for scene in self.scenes:
            if scene.id in seen:
                raise ValueError(f"two scenes have the id {scene.id!r}")
            seen.add(scene.id)
        return self


def scene_json_schema() -> dict[str, Any]:
    """JSON Schema of a scene file."""
    return SceneFile.model_json_schema()


def one_line(error: ValidationError) -> str:
    """First complaint of a validation error: the field's path and what was expected."""
    first = error.errors()[0]
    path = ""
    for part in first["loc"]:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part not in ("basins", "cup"):
            path += f".{part}" if path else str(part)
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] in ("less_than_equal", "greater_than"):
        message += f" (lengths are in metres, up to {_LARGEST_LENGTH:g}; found {first['input']})"
    others = len(error.errors()) - 1
    more = f" (and {others} more)" if others else ""
    return f"{path}: {message}{more}" if path else message + more


def parse_scenes(text: str | bytes, source: str) -> list[Scene]:
    """Scenes from the text of a scene file.

    Parameters
    ----------
    text
        JSON.
    source
        Name of the file, for error messages.

    Raises
    ------
    InputError
        One line that names the source, the field and what was expected.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source}: not a JSON file ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{source}: expected an object with the field 'scenes'")
    version = content.get("schema_version")
    if version != SCHEMA_VERSION or isinstance(version, bool):
        raise InputError(
            f"{source}: schema_version: expected {SCHEMA_VERSION}, found {json.dumps(version)[:40]}"
        )
    if content.get("scenes") == []:
        raise InputError(f"{source}: scenes: the list is empty, expected at least one scene")
    try:
        return list(SceneFile.model_validate(content).scenes)
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error)}") from None


def read_scenes(path: str | Path) -> list[Scene]:
    """Read a scene file.

    Raises
    ------
    InputError
        If it can't be read, or is not a valid scene file of this version.
    """
    try:
        text = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    return parse_scenes(text, str(path))


def scenes_to_json(scenes: Iterable[Scene]) -> str:
    """Text of a scene file; the same scenes give the same bytes."""
    file = SceneFile(scenes=tuple(scenes))
    head = json.dumps(file.model_dump(mode="json", exclude={"scenes"}))[:-1]
    lines = ",\n".join("  " + json.dumps(scene.model_dump(mode="json")) for scene in file.scenes)
    return f'{head}, "scenes": [\n{lines}\n]}}\n'


def write_scenes(path: str | Path, scenes: Sequence[Scene]) -> None:
    """Write a scene file, whole or not at all.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    write_text(Path(path), scenes_to_json(scenes))
