"""A scene as cells: its volumes, its mirror image, and the directions of its surfaces."""

import numpy as np
import pytest
import shapely

from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.scene import LiquidStart, Scene
from pourcast.stimuli.lattice_boltzmann.lattice import VELOCITY
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
    solids = shapely.union_all([shapely.Polygon(polygon) for polygon in ramp.solids])
    right = shapely.box(ramp.goal.divider_x, 0.0, ramp.box.width, ramp.box.height)
    counted = (voxels.goal * voxels.cut.room).sum() * area
    # A grid that is wider than the box by parts of a cell has more room at its sides.
    assert counted == pytest.approx(right.difference(solids).area, rel=0.01)


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


@pytest.mark.parametrize("resolution", [40, 60, 100, 150])
def test_a_cups_share_is_what_is_inside_its_walls(resolution):
    cup = Cup(centre_x=0.4, width=0.3, height=0.2)
    scene = Scene(id="cup", liquid=LiquidStart(centre=(0.5, 1.2)), goal=cup)
    voxels = voxelise(scene, resolution)
    counted = (voxels.goal * voxels.cut.room).sum() * voxels.cell**2
    assert counted == pytest.approx((0.3 - 2 * 0.015) * 0.2, rel=0.01)


def reaches_the_floor(scene, resolution):
    """Whether any way leads from the start to the floor."""
    voxels = voxelise(scene, resolution)
    ways = [(int(dx), int(dy)) for dx, dy, dz in VELOCITY if dz == 0 and (dx, dy) != (0, 0)]
    passages = {(int(dx), int(dy)): voxels.cut.passage[i] for i, (dx, dy, _) in enumerate(VELOCITY)}
    free = np.pad(~voxels.solid[:, :, 0], 1)
    reached = np.pad(voxels.fill[:, :, 0] > 0.0, 1)
    before = 0
    while reached.sum() > before:
        before = reached.sum()
        for way in ways:
            leaving = reached & np.pad(passages[way] > 0.0, 1)
            reached |= np.roll(leaving, way, axis=(0, 1)) & free
    return bool(reached[:, 1].any())


def barred(*obstacles):
    return Scene(id="barred", obstacles=obstacles, liquid=LiquidStart(centre=(0.43, 1.2)))


RESOLUTIONS = [40, 57, 60, 70, 100, 103]


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize("thickness", [0.0006, 0.005, 0.03])
@pytest.mark.parametrize("slant", [0.0, 0.07])
def test_a_shelf_from_side_to_side_holds_all(resolution, thickness, slant):
    # The grid may be wider than the box by parts of a cell; a wall thinner than points can tell.
    low, high = 0.4, 0.4 + slant
    shelf = ((0.0, low), (1.0, high), (1.0, high + thickness), (0.0, low + thickness))
    assert not reaches_the_floor(barred(shelf), resolution)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
@pytest.mark.parametrize("gap", [0.0, 0.003])
def test_solids_that_touch_in_a_point_or_nearly_are_tight(resolution, gap):
    left = ((0.0, 0.7), (0.5 - gap / 2, 0.45), (0.0, 0.55))
    right = ((1.0, 0.7), (0.5 + gap / 2, 0.45), (1.0, 0.55))
    assert not reaches_the_floor(barred(left, right), resolution)


@pytest.mark.parametrize("resolution", RESOLUTIONS)
def test_what_is_wider_than_a_cell_stays_open(resolution):
    gap = 1.2 * 1.5 / resolution
    left = ((0.0, 0.5), (0.5 - gap / 2, 0.5), (0.5 - gap / 2, 0.6), (0.0, 0.6))
    right = ((1.0, 0.5), (0.5 + gap / 2, 0.5), (0.5 + gap / 2, 0.6), (1.0, 0.6))
    assert reaches_the_floor(barred(left, right), resolution)


@pytest.mark.parametrize("place", np.linspace(0.4, 0.43, 7))
@pytest.mark.parametrize("cells", [0.6, 1.0, 2.5])
def test_a_start_smaller_than_a_cell_has_its_volume(place, cells):
    diameter = cells * 1.5 / 60
    start = LiquidStart(centre=(place, 1.2), diameter=diameter)
    voxels = voxelise(Scene(id="small", liquid=start), 60)
    volume = voxels.fill[:, :, 0].sum() * voxels.cell**2
    assert volume == pytest.approx(np.pi / 4 * diameter**2, rel=0.05)


def test_the_dividers_tip_favours_no_side(ramp):
    voxels = voxelise(ramp, 100)
    middle = voxels.solid.shape[0] // 2
    tip = np.flatnonzero(voxels.solid[middle, : int(0.25 / voxels.cell), 0]).max()
    assert abs(inner(voxels, 0)[middle, tip]) == pytest.approx(1.0, abs=1e-5)
