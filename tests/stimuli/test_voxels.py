"""A scene as cells: its volumes, its mirror image, and the directions of its surfaces."""

import numpy as np
import pytest

from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.scene import LiquidStart, Scene
from pourcast.stimuli.lattice_boltzmann.voxels import voxelise
from tests.make import random_scenes


def inner(voxels, axis):
    return voxels.normal[axis, 1:-1, 1:-1, 1]


@pytest.mark.parametrize("resolution", [60, 100, 300])
def test_volumes_are_the_scenes(ramp, resolution):
    voxels = voxelise(ramp, resolution)
    liquid = np.pi / 4 * ramp.liquid.diameter**2
    area = voxels.cell**2
    assert voxels.fill[:, :, 0].sum() * area == pytest.approx(liquid, rel=0.01)
    solid = 0.4 * 0.25 / 2 + 0.1 * 0.2 / 2
    assert (1.0 - voxels.cut.room).sum() * area == pytest.approx(solid, rel=0.005)
    assert voxels.goal.mean() == pytest.approx(0.5)


def test_mirrored_scenes_have_mirrored_cells():
    for scene in random_scenes(6):
        one, other = voxelise(scene, 60), voxelise(scene.mirrored(), 60)
        assert (one.solid == other.solid[::-1]).all()
        assert (one.cut.room == other.cut.room[::-1]).all()
        assert one.fill == pytest.approx(other.fill[::-1])
        goal = other.goal[::-1] if scene.goal.kind == "cup" else 1.0 - other.goal[::-1]
        assert one.goal == pytest.approx(goal)


def test_surfaces_point_across_the_nearest_edge(ramp):
    voxels = voxelise(ramp, 150)
    # Cells that the ramp's slope cuts or covers, from (0.25, 0.95) to (0.65, 0.7).
    across = np.array([0.25, 0.4]) / np.hypot(0.25, 0.4)
    for x in (0.35, 0.45, 0.55):
        y = 0.95 - (x - 0.25) * 0.25 / 0.4 - voxels.cell
        i, j = int((x - voxels.origin[0]) / voxels.cell), int(y / voxels.cell)
        found = np.array([inner(voxels, 0)[i, j], inner(voxels, 1)[i, j]])
        assert voxels.cut.room[i, j] < 1.0
        assert abs(found @ across) == pytest.approx(1.0, abs=1e-5)


def test_the_edge_between_two_obstacles_that_touch_is_no_surface():
    # Two halves of a block, as cells of a tessellation are: its top is flat all along.
    left = ((0.3, 0.6), (0.5, 0.6), (0.5, 0.8), (0.3, 0.8))
    right = ((0.5, 0.6), (0.7, 0.6), (0.7, 0.8), (0.5, 0.8))
    scene = Scene(id="block", obstacles=(left, right), liquid=LiquidStart(centre=(0.5, 1.2)))
    voxels = voxelise(scene, 150)
    top = int(0.795 / voxels.cell)
    columns = slice(int(0.33 / voxels.cell), int(0.67 / voxels.cell))
    assert voxels.solid[columns, top].all()
    assert np.abs(inner(voxels, 1)[columns, top]) == pytest.approx(1.0)


def test_a_cups_share_is_what_is_inside_it():
    cup = Cup(centre_x=0.4, width=0.3, height=0.2)
    scene = Scene(id="cup", liquid=LiquidStart(centre=(0.5, 1.2)), goal=cup)
    voxels = voxelise(scene, 150)
    assert voxels.goal.sum() * voxels.cell**2 == pytest.approx(0.3 * 0.2, rel=0.02)


def test_the_dividers_tip_favours_no_side(ramp):
    voxels = voxelise(ramp, 100)
    middle = voxels.solid.shape[0] // 2
    tip = np.flatnonzero(voxels.solid[middle, : int(0.25 / voxels.cell), 0]).max()
    assert abs(inner(voxels, 0)[middle, tip]) == pytest.approx(1.0, abs=1e-5)
