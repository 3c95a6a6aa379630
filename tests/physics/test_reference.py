"""The engine against a plain float64 implementation."""

from dataclasses import replace

import numpy as np
import pytest

from pourcast import HONEY_EXP1, WATER, EngineSettings, Pour, simulate
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.study.selection import filtered_scenes
from tests import reference
from tests.make import OPEN_CHOICES, ramp_scene, random_scenes


@pytest.mark.parametrize("liquid", [WATER, HONEY_EXP1], ids=lambda liquid: liquid.name)
def test_the_first_moments_agree_particle_by_particle(liquid):
    # Falling, the first impacts, the first slide; later, chaos parts any two computations.
    settings = EngineSettings(max_duration=0.6)
    pours = [Pour(scene, liquid, 40, 5.0) for scene in [ramp_scene(), *random_scenes(4, seed=12)]]
    outcomes = simulate(pours, settings=settings)
    assert sum(ours.touched > 0.3 for ours in outcomes) >= 3
    for pour, ours in zip(pours, outcomes, strict=True):
        theirs = reference.run(pour, ours.time, settings)
        assert np.abs(ours.position - theirs).max() < 1e-3


@pytest.mark.parametrize("choice", OPEN_CHOICES)
def test_every_open_choice_is_what_the_plain_implementation_makes_of_it(choice):
    liquid, settings = OPEN_CHOICES[choice]
    brief = replace(settings, max_duration=0.6)
    pour = Pour(ramp_scene(), liquid, 30, 5.0)
    ours = simulate([pour], settings=brief)[0]
    usual = simulate(
        [Pour(ramp_scene(), WATER if liquid is WATER else HONEY_EXP1, 30, 5.0)],
        settings=EngineSettings(max_duration=0.6),
    )[0]
    theirs = reference.run(pour, ours.time, brief)
    assert ours.touched > 0.2
    assert np.abs(ours.position - theirs).max() < 1e-3
    assert np.abs(ours.position - usual.position).max() > 1e-2


@pytest.mark.study
def test_judgments_agree_over_120_scenes():
    scenes = filtered_scenes(VoronoiFamily(), 120, 1).scenes
    pours = [Pour(scene, WATER, 50, 5.0) for scene in scenes]
    settings = EngineSettings()
    gaps = []
    for pour, ours in zip(pours, simulate(pours), strict=True):
        end = reference.run(pour, ours.time, settings)
        judged = np.mean([pour.scene.goal.holds(x, y) for x, y in end[:, :2]])
        gaps.append(ours.judgment - judged)
    print(f"mean |dJ| {np.abs(gaps).mean():.4f}, mean dJ {np.mean(gaps):+.4f}")
    assert np.abs(gaps).mean() < 0.01
