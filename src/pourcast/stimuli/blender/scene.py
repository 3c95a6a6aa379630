"""Runs inside Blender: builds a scene as the paper's stimuli looked, and renders its pictures.

Blender's z points up, its y away from the camera. The liquid is the paper's: a mix of 5 % diffuse
and 95 % glass with Beckmann's roughness 0.061 and an index of refraction of 1.330. Light comes from
a large lamp above and in front, a smaller one from the side, and from a bright surrounding, so that
the liquid's rim is dark against the pale wall behind.

This file imports nothing of pourcast: Blender has a Python of its own.
"""

import json
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

WALL = (0.80, 0.80, 0.77)
OBSTACLE = (0.105, 0.13, 0.16)
GOAL = (0.42, 0.14, 0.07)
DIFFUSE_SHARE = 0.05
ROUGHNESS = 0.061
REFRACTION = 1.330
THICKNESS = 0.02
DISTANCE = 4.5


def main(path: str) -> None:
    """Do what a job file says."""
    job = json.loads(Path(path).read_text(encoding="utf-8"))
    parent = os.getppid()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")  # an empty file forgets it
    build_box(job["box"])
    for polygons, name, colour in (
        (job["obstacles"], "obstacle", OBSTACLE),
        (job["goal"], "goal", GOAL),
    ):
        material = matte(name, colour)
        for polygon in polygons:
            add_mesh(name, *extruded(polygon, job["box"]["depth"]), material)
    light(job["box"])
    aim(job["box"], job["size"])
    configure(job)
    material = liquid_material(job["liquid_colour"])
    for mesh, picture in job["pictures"]:
        if os.getppid() != parent:  # whoever wanted the pictures is gone
            return
        with np.load(mesh) as arrays:
            vertices, triangles = arrays["vertices"], arrays["triangles"]
        body = add_mesh("liquid", upright(vertices), triangles, material, smooth=True)
        render(Path(picture))
        data = body.data
        bpy.data.objects.remove(body)
        bpy.data.meshes.remove(data)
        print("picture done", flush=True)


def upright(vertices: Any) -> Any:
    """From the scene's axes (y up, z into the screen) to Blender's."""
    return np.asarray(vertices, dtype=np.float32).reshape(-1, 3)[:, [0, 2, 1]]


def extruded(
    polygon: Sequence[Sequence[float]], depth: float
) -> tuple[list[tuple[float, float, float]], list[tuple[int, ...]]]:
    """Prism of a polygon: vertices, and faces as lists of places."""
    count = len(polygon)
    vertices = [(x, 0.0, y) for x, y in polygon] + [(x, depth, y) for x, y in polygon]
    sides = [(k, count + k, count + (k + 1) % count, (k + 1) % count) for k in range(count)]
    front = tuple(range(count))
    back = tuple(range(2 * count - 1, count - 1, -1))
    return vertices, [front, back, *sides]


def add_mesh(
    name: str, vertices: Iterable[Any], faces: Iterable[Any], material: Any, smooth: bool = False
) -> Any:
    """Put a body into the scene; solids get a narrow bevel, liquids a smooth surface."""
    mesh = bpy.data.meshes.new(name)
    corners = [tuple(int(k) for k in face) for face in faces]
    mesh.from_pydata([tuple(float(v) for v in vertex) for vertex in vertices], [], corners)
    mesh.update()
    if smooth:
        # Swapping two axes turned the surface inside out.
        mesh.flip_normals()
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    mesh.materials.append(material)
    body = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(body)
    if not smooth and len(corners) > 1:
        bevel = body.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = 0.003, 2
    return body


def slab(name: str, low: Sequence[float], high: Sequence[float], material: Any) -> None:
    """Put a block into the scene, given two of its corners."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    polygon = [(x0, z0), (x1, z0), (x1, z1), (x0, z1)]
    vertices, faces = extruded(polygon, y1 - y0)
    add_mesh(name, [(x, y + y0, z) for x, y, z in vertices], faces, material)


def build_box(box: dict[str, float]) -> None:
    """Floor, side walls and a back wall; the front is open to the eye."""
    wall, t = matte("wall", WALL), THICKNESS
    width, height, depth = box["width"], box["height"], box["depth"]
    slab("back", (-t, depth, -t), (width + t, depth + t, height), wall)
    side = matte("side", tuple(0.75 * c for c in WALL))
    slab("floor", (-t, 0.0, -t), (width + t, depth, 0.0), side)
    slab("left", (-t, 0.0, 0.0), (0.0, depth, height), side)
    slab("right", (width, 0.0, 0.0), (width + t, depth, height), side)


def matte(name: str, colour: tuple[float, ...]) -> Any:
    """Make a material without gloss."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    shader.inputs["Roughness"].default_value = 0.7
    return material


def liquid_material(tint: Sequence[float]) -> Any:
    """The paper's mix of diffuse and glass, in a colour (red, green, blue, 0..1)."""
    material = bpy.data.materials.new("liquid")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    mix = nodes.new("ShaderNodeMixShader")
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    glass = nodes.new("ShaderNodeBsdfGlass")
    colour = (*tint, 1.0)
    mix.inputs["Fac"].default_value = DIFFUSE_SHARE
    diffuse.inputs["Color"].default_value = colour
    glass.inputs["Color"].default_value = colour
    glass.inputs["Roughness"].default_value = ROUGHNESS
    glass.inputs["IOR"].default_value = REFRACTION
    glass.distribution = "BECKMANN"
    links.new(glass.outputs[0], mix.inputs[1])
    links.new(diffuse.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], output.inputs["Surface"])
    return material


def light(box: dict[str, float]) -> None:
    """Put lamps and surrounding light into the scene."""
    width, height = box["width"], box["height"]
    add_lamp("key", (0.1 * width, -1.6, height + 1.0), (width / 2, 0.0, 0.5 * height), 1.6, 48.0)
    add_lamp("fill", (width + 1.4, -1.8, 0.5 * height), (width / 2, 0.0, 0.4 * height), 1.2, 16.0)
    world = bpy.data.worlds.new("world")
    bpy.context.scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.85, 0.92, 1.0, 1.0)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.45


def add_lamp(
    name: str, place: Sequence[float], target: Sequence[float], size: float, power: float
) -> None:
    """Put a square lamp into the scene; `power` in watts."""
    data = bpy.data.lights.new(name, "AREA")
    data.size, data.energy = size, power
    lamp = bpy.data.objects.new(name, data)
    lamp.location = place
    look_at(lamp, target)
    bpy.context.collection.objects.link(lamp)


def look_at(body: Any, target: Sequence[float]) -> None:
    """Turn a lamp or camera towards a point."""
    direction = Vector(target) - body.location
    body.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()


def aim(box: dict[str, float], size: Sequence[int]) -> None:
    """Put the camera straight in front, far enough that the whole box is in the picture."""
    width, height = box["width"] + 2 * THICKNESS, box["height"] + THICKNESS
    middle = (box["width"] / 2, 0.0, (box["height"] - THICKNESS) / 2)
    data = bpy.data.cameras.new("camera")
    data.sensor_fit = "VERTICAL"
    # What must fit at the front of the box, with a narrow margin.
    needed = 1.02 * max(height, width * size[1] / size[0])
    data.lens = data.sensor_height * DISTANCE / needed
    camera = bpy.data.objects.new("camera", data)
    camera.location = (middle[0], -DISTANCE, middle[2])
    look_at(camera, middle)
    bpy.context.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def configure(job: dict[str, Any]) -> None:
    """Choose renderer, quality and size."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = job["samples"]
    scene.cycles.seed = 0
    scene.cycles.use_denoising = job["denoise"]
    scene.cycles.max_bounces = 12
    scene.cycles.transmission_bounces = 12
    scene.cycles.caustics_reflective = False
    scene.render.use_persistent_data = True
    scene.render.resolution_x, scene.render.resolution_y = job["size"]
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.view_settings.view_transform = "Standard"
    if job["threads"]:
        scene.render.threads_mode = "FIXED"
        scene.render.threads = job["threads"]


def render(picture: Path) -> None:
    """Render to a temporary name first: a picture is whole or not there."""
    temporary = picture.with_name(f".{picture.name}")
    bpy.context.scene.render.filepath = str(temporary)
    bpy.ops.render.render(write_still=True)
    temporary.replace(picture)


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1])
