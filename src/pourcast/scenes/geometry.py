"""Points, lengths and polygons, as scenes and goals have them [m]."""

from typing import Annotated

from pydantic import AfterValidator, Field

Point = tuple[float, float]
"""A point in the x-y plane [m]."""

Polygon = tuple[Point, ...]
"""Vertices of a polygon [m]."""

_LARGEST_LENGTH = 20.0


def _checked_length(value: float) -> float:
    if not 0.0 < value <= _LARGEST_LENGTH:
        raise ValueError(
            f"expected a length in metres, more than 0 and up to {_LARGEST_LENGTH:g}, "
            f"found {value:g}"
        )
    return value


Length = Annotated[
    float,
    Field(json_schema_extra={"exclusiveMinimum": 0.0, "maximum": _LARGEST_LENGTH}),
    AfterValidator(_checked_length),
]
"""A length [m], more than 0 and up to 20."""
