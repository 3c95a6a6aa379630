"""Open choices, and what a point means."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.calibration import space
from benchmarks.calibration.space import CHOICES

from pourcast.errors import InputError
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.simulation.settings import EngineSettings
from pourcast.study.experiments.exp1 import EXPERIMENT


@pytest.mark.parametrize("choice", CHOICES, ids=lambda choice: choice.name)
def test_every_place_of_the_range_can_be_simulated(choice):
    for unit in (0.0, 0.31, 1.0):
        value = choice.value(unit)
        here = space.world({choice.name: value})
        section = here.rule if choice.section == "filter" else getattr(here, choice.section)
        assert getattr(section, choice.fields[0]) == value
        if not choice.whole:
            assert choice.unit(value) == pytest.approx(unit)
    assert choice.why


def test_the_product_lies_within_the_space():
    place = space.place_of({})
    assert ((place >= 0.0) & (place <= 1.0)).all()


def test_the_recommended_point_names_every_choice_and_lies_within_the_space():
    point = space.read_point(Path(space.__file__).with_name("recommended.toml"))
    assert set(point) == {choice.name for choice in CHOICES}
    place = space.place_of(point)
    assert ((place >= 0.0) & (place <= 1.0)).all()


def test_no_choice_is_one_that_the_paper_makes():
    names = {choice.name for choice in CHOICES}
    assert not names & {"water.viscosity_alpha", "honey.viscosity_alpha", "family.solid_area"}


def test_an_empty_point_is_the_product():
    here = space.world({})
    assert here.engine == EngineSettings()
    assert here.family == EXPERIMENT.family
    assert here.water.engine_identity == WATER.engine_identity
    assert here.honey.engine_identity == HONEY_EXP1.engine_identity
    assert here.rule.min_touched == EXPERIMENT.choice.rule.min_touched


def test_honeys_choices_go_to_honey_and_waters_to_water():
    here = space.world({"honey.adhesion_normal": 17.0})
    assert here.honey.adhesion_normal == 17.0
    assert here.water.adhesion_normal == WATER.adhesion_normal


def test_the_filter_pours_the_points_water_in_its_engine():
    here = space.world({"engine.sound_speed": 25.0})
    assert here.rule.settings.sound_speed == 25.0
    assert here.rule.liquid == here.water


def test_a_point_is_read_as_it_was_written(tmp_path):
    point = space.point_at(np.full(len(CHOICES), 0.3))
    path = tmp_path / "point.toml"
    path.write_text(space.point_text(point))
    assert space.read_point(path) == point


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[engine]\nspeed = 3", "speed"),
        ("[mercury]\nalpha = 1", "mercury"),
        ("engine = 3", "expected a table"),
        ("[engine]\nsound_speed = 0.1", "sound_speed: expected at least 1"),
        ("[engine]\nsound_speed = [1]", "expected a number or a word"),
        ("[engine]\nsound_speed = 'fast'", "sound_speed: expected a number, found 'fast'"),
        ("[engine", "not a TOML file"),
        ("[filter]\nmin_touched = '0.5'", r"\[filter\] min_touched: expected a number, 0 to 1"),
        ("[filter]\nmax_stranded = nan", r"\[filter\] max_stranded: expected a number, 0 to 1"),
        ("[filter]\nliquid = 'honey'", r"\[filter\]: .*liquid"),
        ("[family]\ncell_count = 0", r"\[family\] cell_count: expected a whole number, 1 to"),
        ("[family]\ncell_count = 'many'", r"\[family\] cell_count: expected a whole number"),
        ("[family]\ncell_count = 100.5", r"\[family\] cell_count: expected a whole number"),
        ("[family]\nliquid_spread = -1", r"\[family\] liquid_spread: expected a number, 0 to"),
        ("[honey]\ngoals = 'basins'", r"\[honey\]: .*goals"),
        ("[water]\ncohesion = '0'", r"\[water\] cohesion: expected a number"),
    ],
)
def test_a_wrong_point_is_told_in_one_line(tmp_path, text, said):
    path = tmp_path / "point.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as told:
        space.read_point(path)
    assert str(told.value).startswith(str(path))
    assert "\n" not in str(told.value)


def test_rounding_takes_two_digits():
    cells = next(choice for choice in CHOICES if choice.whole)
    assert cells.rounded(147) == 150
    stickiness = next(choice for choice in CHOICES if choice.fields == ("adhesion_normal",))
    assert stickiness.rounded(31.49) == 31.0
