"""Scenes: a box, convex obstacles, a liquid's start and a goal.

Lengths are in metres; x points right, y up, z into the screen; the origin is
the front left corner of the floor. Obstacles are polygons in the x-y plane,
extruded through the whole depth of the box.
"""

import hashlib
import json
import math
from typing import Annotated, Any

import shapely
from pydantic import (
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    TypeAdapter,
    field_validator,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import core_schema

from pourcast.errors import unknown
from pourcast.frozen import Frozen
from pourcast.scenes.geometry import Length, Point, Polygon
from pourcast.scenes.goals.base import Goal
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.goals.registry import GOALS

_MIN_AREA = 1e-8
_TOLERANCE = 1e-9
_SLACK = 1e-6
"""Coordinates are rounded to a micrometre; things that touch may overlap by as much [m]."""


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


class Box(Frozen):
    """The box that holds a scene [m]; the lid is open.

    The default depth equals the diameter of the paper's cylinder of liquid.
    """

    width: Length = 1.0
    height: Length = 1.5
    depth: Length = 0.148


class LiquidStart(Frozen):
    """Where the liquid starts: a cylinder through the depth of the box."""

    centre: Point
    """Centre in the x-y plane [m]."""
    diameter: Length = 0.148


class _GoalOfAnyKind:
    """Validates a goal as what its `kind` says, one of another package too."""

    @staticmethod
    def _validated(value: Any) -> Goal:
        if isinstance(value, Goal):
            return value
        if not isinstance(value, dict) or not isinstance(value.get("kind"), str):
            raise ValueError(
                f"expected an object with the field 'kind': {', '.join(GOALS.names())}"
            )
        kind = value["kind"]
        if kind not in GOALS.names():
            raise ValueError(
                f"{unknown(kind, GOALS.names())}; is the package that has it installed?"
            )
        return GOALS.get(kind).model_validate(value)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        dump = core_schema.plain_serializer_function_ser_schema(
            lambda goal: goal.model_dump(mode="json")
        )
        return core_schema.no_info_plain_validator_function(self._validated, serialization=dump)

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        kinds = {name: GOALS.get(name) for name in GOALS.built_in()}
        union = core_schema.tagged_union_schema(
            {kind: TypeAdapter(goal).core_schema for kind, goal in kinds.items()}, "kind"
        )
        return handler(union)


def _finite_number(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("Input should be a number")
    return value


_Coordinate = Annotated[float, BeforeValidator(_finite_number)]


class Scene(Frozen):
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
    goal: Annotated[Goal, _GoalOfAnyKind()] = Basins()

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
