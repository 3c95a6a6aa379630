"""SPlisHSPlasH scene JSON, read and written.

SPlisHSPlasH (Bender et al., https://splishsplash.physics-simulation.org) is an
independent SPH engine; a scene written here can be simulated there as a check.
Understood: `RigidBodies` made of `UnitBox.obj` (a cube from -1/2 to 1/2) or of
an OBJ mesh beside the file, with translation, rotation about z (radians) and
scale; the container is the body with `isWall`; the liquid is the first of
`FluidModels` (box by its scale) or `FluidBlocks` (box from start to end).
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.files import write_text
from pourcast.scenes.geometry import Polygon
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.importers.fields import built, member, number, numbers
from pourcast.scenes.polygons import ring_of
from pourcast.scenes.scene import Box, LiquidStart, Scene

UNIT_BOX = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

_FLUID_RADIUS = 0.005


def read(content: dict[str, Any], path: Path) -> Scene:
    """Turn a SPlisHSPlasH scene into ours; front view, depth along z.

    Parameters
    ----------
    content
        The parsed JSON.
    path
        Its file; meshes are looked for beside it.

    Returns
    -------
    Scene
        With two basins as the goal (the format has none), unless the file was
        written by `write`, which notes the goal.
    """
    bodies = member(content, "RigidBodies", path, "RigidBodies")
    if not isinstance(bodies, list):
        raise InputError(f"{path}: RigidBodies: expected a list")
    walls = [k for k, b in enumerate(bodies) if isinstance(b, dict) and b.get("isWall") is True]
    if len(walls) != 1:
        raise InputError(f"{path}: RigidBodies: expected one body with isWall, found {len(walls)}")
    wall = f"RigidBodies[{walls[0]}]"
    wall_size = numbers(bodies[walls[0]].get("scale"), 3, path, f"{wall}.scale")
    wall_centre = numbers(bodies[walls[0]].get("translation"), 3, path, f"{wall}.translation")
    origin = np.array(wall_centre[:2]) - np.array(wall_size[:2]) / 2
    noted = content.get("pourcast", {})
    goal_bodies = noted.get("goal_bodies", []) if isinstance(noted, dict) else []
    obstacles = [
        _polygon(body, origin, path, f"RigidBodies[{k}]")
        for k, body in enumerate(bodies)
        if k != walls[0] and k not in goal_bodies
    ]
    centre, diameter = _liquid(content, origin, path)
    default_goal = Basins(divider_x=wall_size[0] / 2).model_dump()
    goal = noted.get("goal", default_goal) if isinstance(noted, dict) else default_goal
    return built(
        lambda: Scene.model_validate(
            {
                "id": path.stem,
                "box": Box(width=wall_size[0], height=wall_size[1], depth=wall_size[2]),
                "obstacles": obstacles,
                "liquid": LiquidStart(centre=centre, diameter=diameter),
                "goal": goal,
            }
        ),
        path,
    )


def _polygon(body: Any, origin: NDArray[np.float64], path: Path, where: str) -> Polygon:
    outline = _outline(body, path, where)
    scale = numbers(body.get("scale", [1, 1, 1]), 3, path, f"{where}.scale")
    shift = numbers(body.get("translation", [0, 0, 0]), 3, path, f"{where}.translation")
    axis = numbers(body.get("rotationAxis", [0, 0, 1]), 3, path, f"{where}.rotationAxis")
    angle = number(body.get("rotationAngle", 0.0), path, f"{where}.rotationAngle")
    if angle != 0.0 and (axis[0] != 0.0 or axis[1] != 0.0 or axis[2] == 0.0):
        raise InputError(f"{path}: {where}.rotationAxis: expected [0, 0, 1], found {axis}")
    turn = math.copysign(angle, angle * axis[2]) if angle else 0.0
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    placed = (outline * scale[:2]) @ rotation.T + shift[:2] - origin
    return ring_of(shapely.MultiPoint(placed))


def _outline(body: Any, path: Path, where: str) -> NDArray[np.float64]:
    """Corners of a body's mesh in the x-y plane, before scale and rotation."""
    name = member(body, "geometryFile", path, f"{where}.geometryFile")
    if not isinstance(name, str):
        raise InputError(f"{path}: {where}.geometryFile: expected a file name")
    if Path(name.replace("\\", "/")).name == "UnitBox.obj":
        return UNIT_BOX
    mesh = path.parent / name
    try:
        lines = mesh.read_text(encoding="utf-8").splitlines()
        vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
        outline = vertices[:, :2]
    except (OSError, ValueError, IndexError):
        raise InputError(
            f"{path}: {where}.geometryFile: expected UnitBox.obj or an OBJ mesh beside the file, "
            f"found {name!r}"
        ) from None
    return outline


def _liquid(
    content: dict[str, Any], origin: NDArray[np.float64], path: Path
) -> tuple[tuple[float, float], float]:
    """Centre and diameter of the cylinder with the liquid's cross-section."""
    if content.get("FluidModels"):
        entry, where = member(content["FluidModels"], 0, path, "FluidModels"), "FluidModels[0]"
        centre = numbers(member(entry, "translation", path, f"{where}.translation"), 3, path, where)
        size = numbers(member(entry, "scale", path, f"{where}.scale"), 3, path, f"{where}.scale")
    elif content.get("FluidBlocks"):
        entry, where = member(content["FluidBlocks"], 0, path, "FluidBlocks"), "FluidBlocks[0]"
        start = np.array(numbers(member(entry, "start", path, f"{where}.start"), 3, path, where))
        end = np.array(numbers(member(entry, "end", path, f"{where}.end"), 3, path, where))
        shift = numbers(entry.get("translation", [0, 0, 0]), 3, path, f"{where}.translation")
        centre, size = list((start + end) / 2 + shift), list(end - start)
    else:
        raise InputError(f"{path}: FluidModels: expected a liquid here or in FluidBlocks")
    area = abs(size[0] * size[1])
    if content.get("FluidModels") and not str(entry.get("particleFile", "")).endswith(
        "UnitBox.obj"
    ):
        area *= math.pi / 4  # a round mesh of this diameter
    x, y = np.array(centre[:2]) - origin
    return (round(float(x), 6), round(float(y), 6)), round(2 * math.sqrt(area / math.pi), 6)


def write(scene: Scene, path: Path) -> list[Path]:
    """Write a scene for SPlisHSPlasH: the JSON, and an OBJ mesh for each solid beside it.

    Parameters
    ----------
    scene
        The scene.
    path
        The JSON file to write.

    Returns
    -------
    list of Path
        All files written. `UnitBox.obj`, the container and the shape of walls, is
        among them.

    Raises
    ------
    InputError
        If a file can't be written.
    """
    box = scene.box
    written = [path.with_name("UnitBox.obj"), path.with_name("UnitCylinder.obj")]
    write_text(written[0], prism_obj(UNIT_BOX, -0.5, 0.5))
    angles = 2 * np.pi * np.arange(32) / 32
    circle = 0.5 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    write_text(written[1], prism_obj(circle, -0.5, 0.5))
    middle = [box.width / 2, box.height / 2, box.depth / 2]
    bodies: list[dict[str, Any]] = [_body("UnitBox.obj", middle, box)]
    for k, polygon in enumerate(scene.solids):
        mesh = path.with_name(f"{path.stem}-solid-{k}.obj")
        write_text(mesh, prism_obj(np.array(polygon), 0.0, box.depth))
        written.append(mesh)
        bodies.append(_body(mesh.name, [0.0, 0.0, 0.0], None))
    first_goal = 1 + len(scene.obstacles)
    (x, y), diameter = scene.liquid.centre, scene.liquid.diameter
    content = {
        "Configuration": {
            "particleRadius": _FLUID_RADIUS,
            "gravitation": [0.0, -9.81, 0.0],
            "timeStepSize": 0.001,
            "simulationMethod": 4,
            "boundaryHandlingMethod": 2,
            "stopAt": 6.0,
        },
        "RigidBodies": bodies,
        "FluidModels": [
            {
                "particleFile": "UnitCylinder.obj",
                "translation": [x, y, box.depth / 2],
                "rotationAxis": [0, 0, 1],
                "rotationAngle": 0,
                "scale": [diameter, diameter, box.depth - 4 * _FLUID_RADIUS],
            }
        ],
        "pourcast": {
            "goal": scene.goal.model_dump(mode="json"),
            "goal_bodies": list(range(first_goal, first_goal + len(scene.goal.solids))),
        },
    }
    write_text(path, json.dumps(content, indent=2) + "\n")
    return [path, *written]


def _body(mesh: str, translation: list[float], walls: Box | None) -> dict[str, Any]:
    return {
        "geometryFile": mesh,
        "translation": translation,
        "rotationAxis": [0, 0, 1],
        "rotationAngle": 0,
        "scale": [walls.width, walls.height, walls.depth] if walls else [1, 1, 1],
        "isDynamic": False,
        "isWall": walls is not None,
        "mapInvert": walls is not None,
        "mapThickness": 0.0,
        "mapResolution": [40, 60, 20] if walls else [30, 30, 15],
    }


def prism_obj(outline: NDArray[np.float64], near: float, far: float) -> str:
    """Wavefront OBJ of a convex polygon extruded from z = near to z = far, facing outwards."""
    count = len(outline)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for z in (near, far) for x, y in outline]
    for k in range(1, count - 1):
        lines.append(f"f 1 {k + 2} {k + 1}")
        lines.append(f"f {count + 1} {count + k + 1} {count + k + 2}")
    for k in range(count):
        here, there = k + 1, (k + 1) % count + 1
        lines.append(f"f {here} {there} {count + there}")
        lines.append(f"f {here} {count + there} {count + here}")
    return "\n".join(lines) + "\n"
