"""Doors for scenes made elsewhere."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from pourcast.errors import InputError
from pourcast.scenes.importers import import_scene, splishsplash
from tests.make import ramp_scene, random_scenes

EXAMPLES = Path(__file__).parents[1] / "examples"


def svg(body, attributes='width="500" height="750" viewBox="0 0 500 750"'):
    return f'<svg xmlns="http://www.w3.org/2000/svg" {attributes}>{body}</svg>'


LIQUID = '<circle id="liquid" cx="250" cy="60" r="37"/>'


def read_svg(tmp_path, body, **kwargs):
    path = tmp_path / "d.svg"
    path.write_text(svg(body, **kwargs))
    return import_scene(path)


def test_the_example_drawing():
    scene = import_scene(EXAMPLES / "drawing.svg")
    assert (scene.id, scene.box.width, scene.box.height) == ("drawing", 1.0, 1.5)
    assert scene.liquid.centre == pytest.approx((0.425, 1.383333))
    assert scene.liquid.diameter == pytest.approx(88 / 600, abs=1e-5)
    assert scene.goal.kind == "cup"
    assert scene.goal.width == pytest.approx(200 / 600, abs=1e-5)
    areas = sum(shapely.Polygon(p).area for p in scene.obstacles)
    # plank, ellipse and triangle by formula; the slide by its outline
    known = (180 * 28 + np.pi * 70 * 34 + 90 * 80 / 2) / 600**2
    assert areas > known


def test_names_colours_and_groups(tmp_path):
    scene = read_svg(
        tmp_path,
        '<rect width="500" height="750" fill="white"/>'
        '<circle cx="250" cy="60" r="37" fill="#3377dd"/>'
        '<g transform="translate(100 300) rotate(90)"><rect width="50" height="20" fill="gray"/></g>'
        '<rect id="divider" x="225" y="650" width="50" height="100"/>'
        '<rect x="10" y="10" width="20" height="20" fill="none" stroke="black"/>'
        '<rect x="10" y="500" width="20" height="20" fill="gray" display="none"/>',
    )
    assert len(scene.obstacles) == 1
    corners = np.array(scene.obstacles[0])
    assert corners.min(axis=0) == pytest.approx([0.16, 0.8], abs=1e-5)
    assert corners.max(axis=0) == pytest.approx([0.2, 0.9], abs=1e-5)
    goal = scene.goal
    assert (goal.kind, goal.divider_x, goal.divider_width) == ("basins", 0.5, 0.1)
    assert goal.divider_height == pytest.approx(0.2)


def test_curves_holes_and_overhanging_shapes(tmp_path):
    # A ring (even-odd hole), half of it outside the page: cut, and split into convex pieces.
    ring = "M -100 400 a 100 100 0 1 0 200 0 a 100 100 0 1 0 -200 0 Z M -50 400 a 50 50 0 1 0 100 0 a 50 50 0 1 0 -100 0 Z"
    scene = read_svg(tmp_path, LIQUID + f'<path fill="#444" d="{ring}"/>')
    area = sum(shapely.Polygon(p).area for p in scene.obstacles)
    assert area == pytest.approx(np.pi * (0.2**2 - 0.1**2) / 2, rel=0.02)
    assert not any(shapely.Polygon(p).contains(shapely.Point(0.03, 0.7)) for p in scene.obstacles)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "expected one shape named 'liquid' or filled blue, found 0"),
        (LIQUID + LIQUID, "found 2"),
        (LIQUID + '<rect id="cup1" width="9" height="9"/><rect id="cup2" width="9" height="9"/>', "at most one"),
        (LIQUID + '<rect id="obstacle" x="200" y="20" width="90" height="90"/>', "overlaps the liquid"),
    ],
)  # fmt: skip
def test_bad_drawings_are_refused_in_one_line(tmp_path, body, message):
    with pytest.raises(InputError, match=message) as caught:
        read_svg(tmp_path, body)
    assert "d.svg: " in str(caught.value)


@pytest.mark.parametrize("text", ["<svg", "hello", "<svg/>", ""])
def test_what_is_no_drawing_is_refused(tmp_path, text):
    path = tmp_path / "d.svg"
    path.write_text(text)
    with pytest.raises(InputError, match=r"d\.svg: "):
        import_scene(path)


def plinko():
    return json.loads((EXAMPLES / "plinko.json").read_text())


def test_plinko_geometry():
    scene = import_scene(EXAMPLES / "plinko.json")
    # Box: 600 px wide around x = 350; floor at ground_y + 5 = 100; ball at (350, 620), radius 20.
    assert scene.box.width == 1.0
    assert scene.box.height == pytest.approx((640 - 100) / 600)
    assert scene.liquid.centre == pytest.approx((0.5, 520 / 600), abs=1e-6)
    assert scene.liquid.diameter == pytest.approx(40 / 600, abs=1e-6)
    triangle, rectangle, pentagon = (np.array(p) for p in scene.obstacles)
    assert [len(p) for p in (triangle, rectangle, pentagon)] == [3, 4, 5]
    # First corner straight up, turned by 0.4 counter-clockwise.
    centre = np.array([240 - 50, 330 - 100]) / 600
    corner = centre + 60 / 600 * np.array([-np.sin(0.4), np.cos(0.4)])
    assert np.min(np.hypot(*(triangle - corner).T)) < 2e-6
    assert triangle.mean(axis=0) == pytest.approx(centre, abs=1e-6)


def test_plinko_drop_from_a_hole():
    content = plinko()
    del content["data"]
    path_scene = splice(content)
    assert path_scene.liquid.centre[0] == pytest.approx(0.5)
    assert path_scene.liquid.centre[1] == pytest.approx((600 + 20 - 100) / 600, abs=1e-5)


def splice(content, tmp=None):
    from pourcast.scenes.importers import plinko as reader

    return reader.read(content, Path("world.json"), 1.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["config"].pop("width"), r"config\.width: missing"),
        (lambda c: c["config"].update(width="wide"), r"config\.width: expected a finite number"),
        (lambda c: c["config"].update(width=0), "positive number of pixels"),
        (lambda c: c["config"].update(obstacles=[]), "expected an object of name -> obstacle"),
        (
            lambda c: c["config"]["obstacles"]["triangle"].pop("size"),
            r"obstacles\.triangle\.size: missing",
        ),
        (lambda c: c["config"]["obstacles"]["triangle"].update(n_sides=2.5), "whole number from 3"),
        (lambda c: c["data"].update(ball=[{"x": 1}]), r"data\.ball\[0\]\.y: missing"),
    ],
)
def test_bad_plinko_is_refused_in_one_line(change, message):
    content = plinko()
    change(content)
    with pytest.raises(InputError, match=message):
        splice(content)


def test_splishsplash_boxes():
    scene = import_scene(EXAMPLES / "splishsplash.json")
    assert (scene.box.width, scene.box.height, scene.box.depth) == (1.0, 1.5, 0.148)
    assert scene.liquid.centre == pytest.approx((0.4, 1.35))
    # The cylinder has the box's cross-section.
    assert np.pi * (scene.liquid.diameter / 2) ** 2 == pytest.approx(0.13**2, rel=1e-4)
    plank = shapely.Polygon(scene.obstacles[0])
    assert plank.area == pytest.approx(0.4 * 0.04, abs=1e-5)
    assert (plank.centroid.x, plank.centroid.y) == pytest.approx((0.38, 0.8), abs=1e-5)
    left, right = min(scene.obstacles[0]), max(scene.obstacles[0])
    assert left[1] > right[1]  # turned clockwise: falls to the right


def test_splishsplash_round_trip(tmp_path):
    for scene in [ramp_scene(), *random_scenes(6, seed=2)]:
        files = splishsplash.write(scene, tmp_path / f"{scene.id}.json")
        assert all(path.exists() for path in files)
        back = import_scene(tmp_path / f"{scene.id}.json")
        assert back.goal == scene.goal
        assert back.box == scene.box
        assert back.liquid.centre == pytest.approx(scene.liquid.centre, abs=1e-6)
        assert back.liquid.diameter == pytest.approx(scene.liquid.diameter, abs=1e-6)
        for one, other in zip(back.obstacles, scene.obstacles, strict=True):
            gap = shapely.Polygon(one).symmetric_difference(shapely.Polygon(other)).area
            assert gap < 1e-6


def test_meshes_are_closed_and_face_outwards():
    text = splishsplash.prism_obj(np.array([[0, 0], [2, 0], [2, 1], [0, 1.0]]), 0.0, 3.0)
    lines = [line.split() for line in text.splitlines()]
    vertices = np.array([line[1:] for line in lines if line[0] == "v"], float)
    faces = np.array([line[1:] for line in lines if line[0] == "f"], int) - 1
    corners = vertices[faces]
    volume = (
        np.sum(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6
    )
    assert volume == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["RigidBodies"].pop(0), "one body with isWall, found 0"),
        (lambda c: c.pop("FluidModels"), "FluidModels: expected a liquid"),
        (lambda c: c["RigidBodies"][1].update(rotationAxis=[1, 0, 0]), r"rotationAxis: expected \[0, 0, 1\]"),
        (lambda c: c["RigidBodies"][1].update(geometryFile="bunny.obj"), "expected UnitBox.obj"),
        (lambda c: c["RigidBodies"][1].update(scale=[1]), "expected 3 numbers"),
        (lambda c: c.update(RigidBodies=3), "RigidBodies: expected a list"),
    ],
)  # fmt: skip
def test_bad_splishsplash_is_refused_in_one_line(tmp_path, change, message):
    content = json.loads((EXAMPLES / "splishsplash.json").read_text())
    change(content)
    path = tmp_path / "s.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        import_scene(path, kind="splishsplash")


def test_formats_are_recognised_or_refused(tmp_path):
    path = tmp_path / "x.json"
    path.write_text('{"a": 1}')
    with pytest.raises(InputError, match="found neither"):
        import_scene(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        import_scene(path)
    with pytest.raises(InputError, match="expected one of svg, plinko"):
        import_scene(EXAMPLES / "plinko.json", kind="blend")
