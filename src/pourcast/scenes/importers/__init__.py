"""Doors for scenes made elsewhere, one format a file.

`svg`: a drawing from any vector editor. `plinko`: the JSON of published
obstacle-course studies. `splishsplash`: the scene JSON of SPlisHSPlasH, which
can be written too.
"""

import json
from pathlib import Path

from pourcast.errors import InputError
from pourcast.scenes.importers import plinko, splishsplash, svg
from pourcast.scenes.scene import Scene

FORMATS = ("svg", "plinko", "splishsplash")


def import_scene(path: str | Path, *, kind: str | None = None, width: float = 1.0) -> Scene:
    """Read a scene from a foreign file.

    Parameters
    ----------
    path
        The file.
    kind
        One of `FORMATS`; by default found from the extension and the content.
    width
        Width of the box [m] for formats in pixels (SVG, plinko).

    Returns
    -------
    Scene
        Named after the file.

    Raises
    ------
    InputError
        One line that names the file, the field and what was expected.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected a text file (UTF-8)") from None
    if kind is not None and kind not in FORMATS:
        raise InputError(f"format: expected one of {', '.join(FORMATS)}, found {kind!r}")
    if (kind or path.suffix.lower().removeprefix(".")) == "svg":
        return svg.read(text, path, width)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected an SVG or a JSON file ({error})") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: expected a JSON object")
    if kind == "splishsplash" or (kind is None and "RigidBodies" in content):
        return splishsplash.read(content, path)
    if kind == "plinko" or "config" in content:
        return plinko.read(content, path, width)
    raise InputError(
        f"{path}: expected a field 'config' (plinko) or 'RigidBodies' (SPlisHSPlasH); found neither"
    )
