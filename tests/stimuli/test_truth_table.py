"""The table of stimuli against truths keeps what it has poured."""

from dataclasses import replace

import pytest
from benchmarks.stimulus_truth import Film, films_of, outcomes_in, shifted

from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann


def test_what_was_kept_is_known_again_but_for_a_line_that_was_cut_off(tmp_path):
    assert outcomes_in(tmp_path) == {}
    (tmp_path / "outcomes.jsonl").write_text(
        '\n{"film": "a", "outcome": 0.25, "stranded": 0.0}\n{"film": "b", "outco'
        '\n{"film": "c", "outcome": 1.0, "stranded": 0.5}'
    )
    assert outcomes_in(tmp_path) == {"a": (0.25, 0.0), "c": (1.0, 0.5)}


def test_films_that_differ_in_scene_liquid_length_or_cells_are_told_apart(ramp):
    coarse, fine = (LatticeBoltzmann(resolution=cells) for cells in (40, 60))
    films = [
        Film(ramp, WATER, coarse),
        Film(ramp, WATER, fine),
        Film(ramp.mirrored(), WATER, coarse),
        Film(ramp, HONEY_EXP1, coarse),
        Film(ramp, replace(WATER, film_seconds=5.0), coarse),
    ]
    assert len({film.digest for film in films}) == len(films)
    assert Film(ramp, replace(WATER, colour="#000000"), coarse).digest == films[0].digest


def test_scenes_are_moved_by_parts_of_a_cell(ramp):
    half = 0.5 * 1.5 / 60
    ((film,),) = films_of(
        [ramp], [60], [], ["water"], lambda scene, cell: shifted(scene, 0.5 * cell), layers=3
    ).values()
    assert film.solver == LatticeBoltzmann(resolution=60, layers=3)
    assert film.scene.box == ramp.box
    step = pytest.approx(half)
    assert film.scene.obstacles[0][0][0] - ramp.obstacles[0][0][0] == step
    assert film.scene.obstacles[0][0][1] == ramp.obstacles[0][0][1]
    assert film.scene.goal.divider_x - ramp.goal.divider_x == step
    assert film.scene.liquid.centre[0] - ramp.liquid.centre[0] == step
