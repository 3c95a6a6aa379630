"""SimpleSim and the gravity heuristic against paths worked out by hand."""

from typing import ClassVar

import numpy as np
import pytest

from pourcast.models import simple
from pourcast.models.simple import SimpleSim
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.goals.cup import Cup
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene import Box, LiquidStart, Scene
from tests import simple_oracle
from tests.make import random_scenes

TINY = 1e-4
"""Diameter of the liquid in these scenes [m]: all points fall at the same x."""


def scene(*obstacles, x=0.4, goal=None, box=None):
    return Scene(
        id="by-hand",
        box=box or Box(),
        obstacles=obstacles,
        liquid=LiquidStart(centre=(x, 1.4), diameter=TINY),
        goal=goal or Basins(),
    )


def path(one, *, g=0.0, m=0.0):
    """Path of a single point that starts in the very middle of the liquid."""
    return SimpleSim(g=g, m=m, m_sigma=0.0, n_points=1).paths(one)[0].round(4).tolist()


LEFT_RAMP = ((0.2, 0.8), (0.6, 0.8), (0.6, 1.0))  # its top falls from (0.6, 1.0) to (0.2, 0.8)
RIGHT_RAMP = ((0.2, 0.8), (0.6, 0.8), (0.2, 1.0))  # its top falls from (0.2, 1.0) to (0.6, 0.8)
BLOCK = ((0.3, 0.6), (0.6, 0.6), (0.6, 0.8), (0.3, 0.8))


def test_nothing_in_the_way():
    assert path(scene()) == [[0.4, 1.4], [0.4, 0.0]]


def test_downhill_to_the_left_then_down():
    assert path(scene(LEFT_RAMP)) == [[0.4, 1.4], [0.4, 0.9], [0.2, 0.8], [0.2, 0.0]]


def test_downhill_to_the_right_then_onto_the_divider():
    # Off the ramp at x = 0.54 above the wedge (0.55 .. 0.5 at height 0 .. 0.2): lands on its right side.
    ramp = ((0.2, 0.8), (0.54, 0.8), (0.2, 1.0))
    found = path(scene(ramp))
    assert found[:3] == [[0.4, 1.4], [0.4, 0.8824], [0.54, 0.8]]
    assert found[3:] == [[0.54, 0.04], [0.55, 0.0]]


def test_wrong_way_goes_over_the_top_and_off_the_high_edge():
    assert path(scene(LEFT_RAMP), g=1.0) == [[0.4, 1.4], [0.4, 0.9], [0.6, 1.0], [0.6, 0.0]]


def test_wrong_way_is_kept_over_the_crest():
    roof = ((0.2, 0.7), (0.7, 0.7), (0.5, 0.9))
    # Lands left of the crest, sets off uphill to the right, and goes on down to the right edge.
    assert path(scene(roof), g=1.0) == [
        [0.4, 1.4], [0.4, 0.8333], [0.5, 0.9], [0.7, 0.7], [0.7, 0.0],
    ]  # fmt: skip


def test_level_top_goes_to_the_nearer_edge():
    assert path(scene(BLOCK)) == [[0.4, 1.4], [0.4, 0.8], [0.3, 0.8], [0.3, 0.0]]
    assert path(scene(BLOCK), g=1.0) == [[0.4, 1.4], [0.4, 0.8], [0.6, 0.8], [0.6, 0.0]]


def test_momentum_carries_past_an_edge():
    assert path(scene(LEFT_RAMP), m=0.1) == [
        [0.4, 1.4], [0.4, 0.9], [0.2, 0.8], [0.1, 0.8], [0.1, 0.0],
    ]  # fmt: skip


def test_momentum_ends_at_the_side_wall():
    assert path(scene(LEFT_RAMP), m=0.5) == [
        [0.4, 1.4], [0.4, 0.9], [0.2, 0.8], [0.0, 0.8], [0.0, 0.0],
    ]  # fmt: skip


def test_momentum_into_the_upper_side_of_a_neighbour():
    # Flies left from (0.2, 0.8) onto a slope through (0.15, 0.8): slides back down to the right.
    neighbour = ((0.05, 0.6), (0.2, 0.6), (0.2, 0.7), (0.05, 1.0))
    found = path(scene(LEFT_RAMP, neighbour), m=0.15)
    assert found == [
        [0.4, 1.4], [0.4, 0.9], [0.2, 0.8], [0.15, 0.8], [0.2, 0.7], [0.35, 0.7], [0.35, 0.0],
    ]  # fmt: skip


def test_momentum_into_the_steep_side_of_a_neighbour_drops_along_it():
    wall = ((0.05, 0.5), (0.15, 0.5), (0.15, 1.1), (0.05, 1.1))
    found = path(scene(LEFT_RAMP, wall), m=0.15)
    assert found == [[0.4, 1.4], [0.4, 0.9], [0.2, 0.8], [0.15, 0.8], [0.15, 0.0]]


def test_momentum_under_an_overhang_falls_straight():
    overhang = ((0.1, 0.9), (0.15, 0.7), (0.18, 1.1))
    found = path(scene(LEFT_RAMP, overhang), m=0.15)
    assert found[3][1] == 0.8
    assert found[-1] == [found[3][0], 0.0]


def test_from_one_obstacle_to_the_next_and_off_both():
    lower = ((0.1, 0.3), (0.3, 0.3), (0.1, 0.5))  # falls to the right
    assert path(scene(LEFT_RAMP, lower)) == [
        [0.4, 1.4], [0.4, 0.9], [0.2, 0.8], [0.2, 0.4], [0.3, 0.3], [0.3, 0.0],
    ]  # fmt: skip


def test_a_valley_between_two_slopes_holds_a_point():
    left = ((0.1, 0.6), (0.45, 0.6), (0.1, 0.9))
    right = ((0.45, 0.6), (0.8, 0.6), (0.8, 0.9))
    found = path(scene(left, right))
    assert found[-1] == pytest.approx([0.45, 0.6], abs=1e-3)
    # The wrong way is no way out: up to the side, and off.
    assert path(scene(left, right), g=1.0)[-1] == [0.1, 0.0]


def test_a_seam_between_two_cells_is_closed():
    left = ((0.3, 0.6), (0.5, 0.6), (0.5, 0.8), (0.3, 0.9))
    right = ((0.5, 0.6), (0.7, 0.6), (0.7, 0.7), (0.5, 0.8))
    assert path(scene(left, right)) == [
        [0.4, 1.4], [0.4, 0.85], [0.5, 0.8], [0.7, 0.7], [0.7, 0.0],
    ]  # fmt: skip


def test_a_notch_below_another_solid_is_a_dead_end():
    wall = ((0.15, 0.85), (0.25, 0.7), (0.25, 1.2), (0.15, 1.2))
    found = path(scene(LEFT_RAMP, wall))
    assert found[-1] == pytest.approx([0.25, 0.825], abs=1e-4)


def test_a_ramp_that_ends_at_the_side_wall_holds_a_point():
    ramp = ((0.0, 0.6), (0.5, 0.6), (0.5, 0.9))
    assert path(scene(ramp), m=0.1)[-1] == [0.0, 0.6]


def test_cup_walls_are_left_downhill_without_momentum():
    cup = Cup(centre_x=0.5, width=0.4, wall=0.1)
    # The wall's top runs from 0.3 to 0.4: from 0.36 to the inside.
    assert path(scene(x=0.36, goal=cup), m=0.2) == [
        [0.36, 1.4], [0.36, 0.18], [0.4, 0.18], [0.4, 0.0],
    ]  # fmt: skip


def test_judgment_counts_the_points():
    # A liquid 0.2 m wide over a vertical edge at 0.35: a quarter left of it, and g splits the rest.
    one = Scene(
        id="split",
        obstacles=(((0.35, 0.8), (0.7, 0.8), (0.35, 1.0)),),
        liquid=LiquidStart(centre=(0.4, 1.3), diameter=0.2),
    )
    gravity = SimpleSim(g=0.0, m=0.0, m_sigma=0.0)
    assert gravity.judge([one], WATER)[0] == pytest.approx(0.75)
    half = SimpleSim(g=0.5, m=0.0, m_sigma=0.0, n_points=4000)
    assert half.judge([one], WATER, seed=1)[0] == pytest.approx(0.375, abs=0.03)


def test_uncertainty_averages_over_m():
    one = scene(LEFT_RAMP)
    narrow = [
        SimpleSim(g=0.0, m=m, m_sigma=0.0).judge([one], WATER)[0]
        for m in (0.06, 0.08, 0.1, 0.12, 0.14)
    ]
    assert SimpleSim(g=0.0, m=0.1).judge([one], WATER)[0] == pytest.approx(np.mean(narrow))


def test_same_seed_same_draws_and_other_points_do_not_matter():
    one = scene(LEFT_RAMP)
    model = SimpleSim(g=0.5, m=0.0, m_sigma=0.0)
    assert model.judge([one], WATER, 3) == model.judge([one], WATER, 3)
    twice = model.judge([one, one], WATER, 3)
    assert twice[0] == twice[1] == model.judge([one], WATER, 3)[0]


@pytest.mark.parametrize(
    "model",
    [SimpleSim(g=0.0, m=0.0), SimpleSim(), SimpleSim(g=0.5, m=0.3), SimpleSim(g=1.0, m=0.02)],
)
def test_paths_are_those_of_plain_loops_to_the_bit(model):
    for one in random_scenes(6, seed=3):
        expected = simple_oracle.paths(model, one, 7, model.m)
        assert [list(map(tuple, path)) for path in model.paths(one, 7)] == expected


def test_points_that_are_followed_together_do_not_matter(monkeypatch):
    model, (one,) = SimpleSim(g=0.5, n_points=50), random_scenes(1)
    expected, judgment = [path.tolist() for path in model.paths(one)], model.judge([one], WATER)
    monkeypatch.setattr(simple, "_TOGETHER", 7)
    assert [path.tolist() for path in model.paths(one)] == expected
    assert model.judge([one], WATER) == judgment


def test_nothing_to_land_on():
    class Target(Basins):
        solids: ClassVar = ()

    assert path(scene(goal=Target())) == [[0.4, 1.4], [0.4, 0.0]]
