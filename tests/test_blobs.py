"""Blobs: molecules on a grid do what liquid does, as far as that can be said by hand."""

import numpy as np
import pytest
import shapely

from pourcast import WATER, Box, LiquidStart, Scene
from pourcast.errors import InputError
from pourcast.models.base import Model
from pourcast.models.blobs import Blobs
from pourcast.models.simple import SimpleSim
from pourcast.pictures.predictions import make_predictions
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.goals.cup import Cup
from tests.make import ramp_scene, random_scenes
from tests.yardstick import ratio

FLAT = Basins(divider_width=0.002, divider_height=0.002)
"""A wedge that is in nobody's way: smaller than any cell."""


def scene(*obstacles, centre=(0.5, 1.3), goal=FLAT, **more):
    return Scene(id="a", obstacles=obstacles, liquid=LiquidStart(centre=centre, **more), goal=goal)


def block(left, right, bottom, top):
    return ((left, bottom), (right, bottom), (right, top), (left, top))


def cells_of(positions, size):
    """Columns and rows of the cells, shape [..., 2]."""
    return np.round(positions / size - 0.5).astype(int)


def filmed(one, n_molecules=50, seed=0):
    """Every time step; columns and rows, shape [step_count, n_molecules, 2], and a cell's side [m]."""
    positions, size = Blobs(n_molecules).film(one, seed)
    assert size > 0.0135  # else steps would be left out
    return cells_of(positions, size), size


def levels(cells):
    """Height of the highest molecule in each column that has one, by its column."""
    return {c: int(cells[cells[:, 0] == c, 1].max()) + 1 for c in np.unique(cells[:, 0]).tolist()}


def test_molecules_are_neither_made_nor_lost_and_none_is_in_a_solid():
    for one in random_scenes(10, seed=21):
        cells, size = filmed(one)
        for frame in cells:
            assert len({*map(tuple, frame.tolist())}) == 50
        points = shapely.points((cells[-1] + 0.5) * size)
        assert not shapely.contains_properly(
            shapely.union_all([shapely.Polygon(solid) for solid in one.solids]), points
        ).any()
        assert (cells >= 0).all()
        assert (cells[..., 0] < round(one.box.width / size)).all()


def test_a_molecule_moves_by_one_cell_and_all_together_only_sink():
    for one in random_scenes(10, seed=22):
        cells, _ = filmed(one)
        steps = np.abs(np.diff(cells, axis=0)).sum(axis=2)
        assert steps.max() == 1
        assert (steps.sum(axis=1) > 0).all()
        assert (np.diff(cells[..., 1].sum(axis=1)) <= 0).all()


def test_without_obstacles_liquid_falls_straight_down():
    cells, size = filmed(scene(centre=(0.3, 1.3)))
    height = cells[0, :, 1].min()
    fallen = cells[: height + 1]
    assert (fallen[..., 0] == fallen[0, :, 0]).all()
    assert (fallen[..., 1] == fallen[0, :, 1] - np.arange(height + 1)[:, None]).all()
    start = (cells[0] + 0.5) * size - (0.3, 1.3)
    assert np.hypot(*start.T).max() < 0.148 / 2 + size
    # 50 molecules on a floor of 54 cells: one layer.
    assert set(levels(cells[-1]).values()) == {1}


def test_a_cup_is_filled_level():
    one = scene(goal=Cup(centre_x=0.5, width=0.2))
    assert Blobs().judge([one], WATER)[0] == 1.0
    cells, size = filmed(one, 87)
    heights = levels(cells[-1])
    inside = range(round(0.415 / size), round(0.585 / size))
    assert set(inside) <= set(heights)
    assert max(heights.values()) - min(heights.values()) <= 1
    assert sum(heights.values()) == 87


@pytest.mark.parametrize("side", [1, -1])
def test_communicating_basins_have_one_level(side):
    # A wall that ends above the floor parts two arms; all is poured into one of them.
    arms = (block(0.3, 0.35, 0.0, 0.6), block(0.475, 0.525, 0.05, 0.7), block(0.65, 0.7, 0.0, 0.6))
    one = scene(*arms, centre=(0.5 + side * 0.1, 1.3), diameter=0.12)
    positions, size = Blobs(80).film(one)
    heights = levels(cells_of(positions[-1], size))
    arm = [[h for c, h in heights.items() if (c * size < 0.5) is left] for left in (True, False)]
    assert sum(map(len, arm)) == len(heights)
    assert len(arm[0]) == len(arm[1]) > 5
    assert max(heights.values()) - min(heights.values()) <= 1
    assert min(heights.values()) >= 3


@pytest.mark.parametrize("slope", [0.02, 0.1, 0.3, 1.1])
def test_down_a_ramp_to_its_lower_end_however_steep_it_is(slope):
    ramp = ((0.0, 0.4), (0.9, 0.4), (0.0, 0.4 + 0.9 * slope))
    one = scene(ramp, centre=(0.4, 1.4), goal=Basins())
    assert Blobs().judge([one], WATER)[0] == 1.0
    assert Blobs().judge([one.mirrored()], WATER)[0] == 0.0


@pytest.mark.parametrize("n_molecules", [1, 2, 9, 50, 51, 100, 333])
def test_a_wedge_parts_liquid_half_and_half(n_molecules):
    wedge = ((0.3, 0.5), (0.7, 0.5), (0.5, 0.9))
    share = Blobs(n_molecules).judge([scene(wedge, goal=Basins())], WATER)[0]
    # Those that stand in the very middle go where the seed sends them.
    assert abs(share - 0.5) * n_molecules <= 0.5 * (n_molecules % 2) + 1e-9


def test_what_a_basin_cannot_hold_spills_over():
    # Inside the cup are 6 x 5 cells of 1/54 m, below its rim.
    cup = Cup(centre_x=0.5, width=6 / 54 + 0.03, height=5 / 54)
    one = scene(goal=cup)
    cells, _ = filmed(one)
    inside = (cells[-1, :, 0] >= 24) & (cells[-1, :, 0] < 30)
    assert inside.sum() == 30
    assert Blobs(50).judge([one], WATER)[0] == 30 / 50
    # Into the left of two basins, whose wall is 0.1 m high: what is above it goes to the right.
    wall = block(0.2, 0.21, 0.0, 0.05)
    two = scene(wall, centre=(0.1, 1.3), goal=FLAT.model_copy(update={"divider_x": 0.205}))
    stays = 0.2 * 0.05 / (np.pi * 0.074**2)
    assert Blobs(400).judge([two], WATER)[0] == pytest.approx(1.0 - stays, abs=0.03)


def test_liquid_stays_in_a_hollow_and_leaves_level_tops():
    hollow = (
        block(0.3, 0.7, 0.5, 0.55),
        block(0.3, 0.35, 0.55, 0.75),
        block(0.65, 0.7, 0.55, 0.75),
    )
    end = filmed(scene(*hollow))[0][-1]
    assert (end[:, 1] >= 0.55 * 54 - 1).all()
    assert (filmed(scene(hollow[0]))[0][-1, :, 1] <= 1).all()


def test_no_wall_is_too_thin_to_hold_liquid_and_no_seam_lets_it_through():
    vee = (
        ((0.2, 0.9), (0.5, 0.6), (0.5, 0.6001), (0.2001, 0.9001)),
        ((0.8, 0.9), (0.7999, 0.9001), (0.5, 0.6001), (0.5, 0.6)),
    )
    for n_molecules in (20, 50, 100, 300):
        positions, size = Blobs(n_molecules).film(scene(*vee))
        assert positions[-1, :, 1].min() > 0.6 - size


def test_at_the_end_nobody_has_room_below():
    """Looked for without the model's questions: in what is joined, from row to row."""
    for one in random_scenes(12, seed=23):
        cells, size = filmed(one)
        filled = {*map(tuple, cells[-1].tolist())}
        solids = shapely.union_all([shapely.Polygon(p).buffer(1e-6) for p in one.solids])
        shapely.prepare(solids)
        columns = round(one.box.width / size)

        def ways(cell, solids=solids, size=size, columns=columns):
            for dx, dy in ((0, -1), (1, 0), (-1, 0), (0, 1)):
                there = (cell[0] + dx, cell[1] + dy)
                line = shapely.LineString(
                    [((x + 0.5) * size, (y + 0.5) * size) for x, y in (cell, there)]
                )
                if 0 <= there[0] < columns and there[1] >= 0 and not solids.intersects(line):
                    yield there

        for row in {y for _, y in filled}:
            reached = [cell for cell in filled if cell[1] == row]
            seen = {*reached}
            for cell in reached:
                for there in ways(cell):
                    if there[1] > row or there in seen:
                        continue
                    assert there in filled or there[1] == row
                    seen.add(there)
                    reached.append(there)


def test_the_same_seed_gives_the_same_bytes_and_another_the_other_side():
    peg = scene(((0.45, 0.5), (0.55, 0.5), (0.5, 0.6)), goal=Basins())
    # Its grid has a column in the middle.
    drop = peg.model_copy(update={"liquid": LiquidStart(centre=(0.5, 1.3), diameter=0.12)})
    assert {float(Blobs(1).judge([drop], WATER, seed)[0]) for seed in range(8)} == {0.0, 1.0}
    for one in random_scenes(4, seed=27):
        films = [Blobs(60).film(one, 5)[0].tobytes() for _ in range(2)]
        assert films[0] == films[1]


def test_a_mirrored_scene_is_judged_in_the_mirror_to_the_bit():
    scenes = random_scenes(40, seed=24)
    for model in (Blobs(37), Blobs(100)):
        here, there = (
            model.judge(ones, WATER, 3) for ones in (scenes, [s.mirrored() for s in scenes])
        )
        back = [s.goal.mirrored_judgment(j) for s, j in zip(scenes, there, strict=True)]
        assert here == pytest.approx(back, abs=1e-12)
    films = [Blobs(50).film(one)[0] for one in (scenes[0], scenes[0].mirrored())]
    assert films[0][..., 0] == pytest.approx(1.0 - films[1][..., 0])


def test_a_scene_that_is_its_own_mirror_image_has_one_judgment():
    peg = scene(((0.45, 0.5), (0.55, 0.5), (0.5, 0.6)), goal=Basins())
    there = peg.mirrored()  # the same, but for the order of corners
    odd = [Blobs(37).judge([one], WATER, 3)[0] for one in (peg, there)]
    assert odd[0] == odd[1] != peg.goal.mirrored_judgment(odd[0])  # 37 can't be halved


@pytest.mark.parametrize(
    ("width", "diameter", "count"), [(1.0, 0.001, 100), (20.0, 0.05, 100), (1.0, 0.06, 5000)]
)
def test_a_grid_too_fine_to_be_run_is_refused(width, diameter, count):
    start = LiquidStart(centre=(width / 2, 1.3), diameter=diameter)
    goal = Basins(divider_x=width / 2)
    wide = Scene(id="a", obstacles=(), box=Box(width=width), liquid=start, goal=goal)
    with pytest.raises(InputError, match=r"^scene 'a': liquid\.diameter: .* at most 1,000,000: "):
        Blobs(count).judge([wide], WATER)


@pytest.mark.parametrize(
    ("width", "height", "diameter"), [(0.1, 0.15, 0.0148), (9.0, 3.0, 0.3), (0.15, 1.5, 0.148)]
)
def test_boxes_of_any_size(width, height, diameter):
    half = Basins(divider_x=width / 2, divider_width=width / 10, divider_height=height / 10)
    box = Box(width=width, height=height)
    one = Scene(
        id="a",
        box=box,
        goal=half,
        liquid={"centre": (width / 2, 0.8 * height), "diameter": diameter},
    )
    assert Blobs(100).judge([one], WATER)[0] == pytest.approx(0.5, abs=0.011)
    positions, size = Blobs(7).film(one)
    assert (positions >= 0.0).all()
    assert (positions <= (width, height + size)).all()


def test_a_scene_may_have_no_solids_at_all():
    class Floor(Basins):
        @property
        def solids(self):
            return ()

    bare = scene().model_copy(update={"goal": Floor()})
    assert Blobs().judge([bare], WATER)[0] == pytest.approx(0.5, abs=0.02)


def test_judgments_hardly_change_with_the_seed_nor_with_more_and_smaller_molecules():
    scenes = random_scenes(30, seed=25)
    coarse, fine = (Blobs(n).judge(scenes, WATER) for n in (100, 400))
    # Measured over 200 scenes: 0.002.
    assert np.abs(coarse - Blobs(100).judge(scenes, WATER, 1)).mean() < 0.01
    # Measured over 200 scenes, and 1,600 molecules: 0.04.
    assert np.abs(coarse - fine).mean() < 0.07


def test_a_film_is_drawn_and_paths_are_where_there_is_no_film():
    blobs, paths = make_predictions(ramp_scene(), ["blobs:n_molecules=30", "gravity"], WATER)
    assert blobs.look == "cells"
    assert blobs.frames.shape[1:] == (30, 2)
    assert blobs.frames[-1, :, 1].max() < 0.1
    assert len(paths.paths) == 100
    assert isinstance(Blobs(), Model)


def test_a_judgment_costs_little_more_than_simple_sims():
    scenes, blobs, simple = random_scenes(12, seed=26), Blobs(), SimpleSim()
    blobs.judge(scenes[:1], WATER)  # compiles
    # Measured: 0.3.
    assert ratio(lambda: blobs.judge(scenes, WATER), lambda: simple.judge(scenes, WATER)) < 1.5
