"""Reading fields of foreign JSON with one-line errors."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pourcast.errors import InputError, one_line
from pourcast.scenes.scene import Scene


def member(parent: Any, key: str | int, path: Path, where: str) -> Any:
    """Member of an object or list, or an error that says what is missing."""
    try:
        return parent[key]
    except (KeyError, IndexError, TypeError):
        raise InputError(f"{path}: {where}: missing") from None


def number(value: Any, path: Path, where: str) -> float:
    """Finite number, or an error."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{path}: {where}: expected a finite number, found {str(value)[:40]!r}")
    return float(value)


def numbers(value: Any, count: int, path: Path, where: str) -> list[float]:
    """List of `count` finite numbers, or an error."""
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"{path}: {where}: expected {count} numbers, found {str(value)[:40]}")
    return [number(entry, path, f"{where}[{k}]") for k, entry in enumerate(value)]


def built(make: Callable[[], Scene], path: Path) -> Scene:
    """Build a scene, its complaints turned into an error that names the file."""
    try:
        return make()
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None
