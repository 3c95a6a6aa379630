"""Scene files: the JSON form of a list of scenes."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, ValidationError, model_validator

from pourcast.errors import InputError, one_line
from pourcast.files import write_text
from pourcast.frozen import Frozen
from pourcast.scenes.scene import Scene

SCHEMA_VERSION = 1
"""Version of the JSON form; a file of another version is refused."""


class SceneFile(Frozen):
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
