"""Pictures of scenes: what is where, mirrored, zoomed."""

import numpy as np
import pytest

from pourcast.networks.picture import AIR, GOAL, LIQUID, MIRRORED, OBSTACLE, OUTSIDE, View, paint
from tests.make import ramp_scene, random_scenes

HEIGHT, WIDTH = 192, 128


def colour_at(picture, x, y):
    """Colour at a place [m] of a scene that is looked at straight."""
    scale = 0.96 * WIDTH
    column = WIDTH / 2 + (x - 0.5) * scale
    row = HEIGHT / 2 - (y - 0.75) * scale
    return tuple(int(v) for v in picture[:, int(row), int(column)])


def test_everything_is_in_its_place():
    picture = paint(ramp_scene(), HEIGHT, WIDTH)
    assert picture.shape == (3, HEIGHT, WIDTH)
    assert picture.dtype == np.uint8
    assert colour_at(picture, 0.4, 1.3) == LIQUID
    assert colour_at(picture, 0.3, 0.75) == OBSTACLE
    assert colour_at(picture, 0.5, 0.1) == GOAL
    assert colour_at(picture, 0.8, 0.4) == AIR
    assert tuple(int(v) for v in picture[:, 0, 0]) == OUTSIDE


def test_areas_are_those_of_the_scene():
    for scene in random_scenes(6, seed=3):
        picture = paint(scene, HEIGHT, WIDTH)
        metre = 0.96 * WIDTH
        blue = ((picture[2] > 200) & (picture[0] < 80)).sum() / metre**2
        assert blue == pytest.approx(np.pi * (scene.liquid.diameter / 2) ** 2, rel=0.08)


@pytest.mark.parametrize("scene", random_scenes(4, seed=4), ids=lambda scene: scene.id)
def test_a_mirrored_view_is_the_picture_of_the_mirrored_scene(scene):
    picture = paint(scene, HEIGHT, WIDTH)
    assert (paint(scene, HEIGHT, WIDTH, MIRRORED) == picture[:, :, ::-1]).all()
    there = paint(scene.mirrored(), HEIGHT, WIDTH).astype(int)
    # But for the pixels of edges, which a rasteriser gives to one side.
    assert np.abs(there - picture[:, :, ::-1]).mean() < 2.0


def test_zoom_and_place():
    scene = ramp_scene()
    small = paint(scene, HEIGHT, WIDTH, View(zoom=0.5, place=(0.0, 0.0)))
    outside = (small == np.array(OUTSIDE)[:, None, None]).all(axis=0)
    box = np.argwhere(~outside)
    assert box.max(axis=0)[0] == HEIGHT - 1
    assert box.min(axis=0)[1] == 0
    rows, columns = box.max(axis=0) - box.min(axis=0)
    assert rows == pytest.approx(0.48 * HEIGHT, abs=2)
    assert columns == pytest.approx(0.48 * WIDTH, abs=2)
    right = paint(scene, HEIGHT, WIDTH, View(zoom=0.5, place=(1.0, 1.0)))
    there = np.argwhere(~(right == np.array(OUTSIDE)[:, None, None]).all(axis=0))
    assert there.min(axis=0)[0] == 0
    assert there.max(axis=0)[1] == WIDTH - 1


def test_a_box_of_another_form_fits_too():
    scene = ramp_scene()
    wide = scene.model_copy(update={"box": scene.box.model_copy(update={"width": 3.0})})
    picture = paint(wide, 64, 64)
    inside = ~(picture == np.array(OUTSIDE)[:, None, None]).all(axis=0)
    rows, columns = np.argwhere(inside).max(axis=0) - np.argwhere(inside).min(axis=0)
    assert columns / rows == pytest.approx(2.0, rel=0.1)
