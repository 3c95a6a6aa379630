"""Sweeps with other engine settings than those that come."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pourcast.errors import InputError
from pourcast.models.base import SimulationModel
from pourcast.models.ife import IntuitiveFluidsEngine
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from pourcast.sweep.grid import GridPoint
from pourcast.sweep.judgments import study_judgments
from pourcast.sweep.plan import Shard, Span, _needed, make_plan
from pourcast.sweep.settings import JudgeSetting, PourSetting
from pourcast.sweep.shard import compute, task_of
from pourcast.sweep.table import write_judgments
from tests.make import random_scenes
from tests.sweep.make import small_grid, swept

SOFT = EngineSettings(sound_speed=20.0, max_duration=1.0)

GRID = """
[[models]]
model = "ife"
parameters = { n_particles = 15, damping_zeta = [4, 6], zeta_sigma = 0 }

[[models]]
model = "position-uncertainty"
parameters = { n_particles = 15, n_draws = 3, damping_zeta = 6 }

[[models]]
model = "simple"
"""


def pour_setting(engine=None, **changes):
    pour = Pour(random_scenes(1, seed=31)[0], WATER, 15, 4.0)
    return PourSetting.of(replace(pour, **changes), engine)


def test_settings_as_they_come_are_not_named():
    assert "engine" not in json.loads(pour_setting().identity)
    assert pour_setting() == pour_setting(EngineSettings())


def test_only_what_is_changed_is_named():
    named = json.loads(pour_setting(replace(EngineSettings(), sound_speed=25.0)).identity)
    assert named["engine"] == {"sound_speed": 25.0}
    assert pour_setting(SOFT) != pour_setting()
    assert len({pour_setting(SOFT), pour_setting(), pour_setting(SOFT)}) == 2


def test_a_model_without_pours_has_one_name_with_any_engine():
    plans = [make_plan(small_grid(GRID), random_scenes(1, seed=31), one) for one in (None, SOFT)]
    identities = [
        {type(s).__name__ + getattr(s, "name", ""): s.identity for s in plan.settings}
        for plan in plans
    ]
    same = {name for name in identities[0] if identities[0][name] == identities[1][name]}
    assert same == {"JudgeSettingsimple"}


def test_shorter_steps_are_more_work():
    scene = random_scenes(1, seed=31)[0]
    short = pour_setting(EngineSettings(step=1e-4))
    assert short.seconds(scene) > 3.0 * pour_setting().seconds(scene)


def test_a_sweep_computes_with_its_engine_and_mixes_nothing_up(tmp_path):
    scenes, grid = random_scenes(2, seed=31), small_grid(GRID)
    as_it_comes, _ = swept(make_plan(grid, scenes), tmp_path)
    soft, _ = swept(make_plan(grid, scenes, SOFT), tmp_path)
    again, executor = swept(make_plan(grid, scenes, SOFT), tmp_path)
    assert executor.did == []
    assert soft.reused_simulations == len(scenes)  # SimpleSim's
    assert again.table.equals(soft.table)
    for zeta in (4.0, 6.0):
        pours = [Pour(scene, WATER, 15, zeta) for scene in scenes]
        for result, settings in ((soft, SOFT), (as_it_comes, EngineSettings())):
            table = result.table
            mine = table[(table["model"] == "ife") & (table["damping_zeta"] == zeta)]
            ends = simulate(pours, settings=settings)
            assert list(mine["judgment"]) == [end.judgment for end in ends]
    differs = soft.table["judgment"].to_numpy() != as_it_comes.table["judgment"].to_numpy()
    models = soft.table["model"]
    assert differs[models == "ife"].any()
    assert differs[models == "position-uncertainty"].any()
    assert not differs[models == "simple"].any()


def test_a_study_knows_which_tables_were_computed_with_other_settings(tmp_path):
    scenes, grid = random_scenes(2, seed=31), small_grid(GRID)
    soft, _ = swept(make_plan(grid, scenes, SOFT), tmp_path)
    write_judgments(tmp_path / "judgments", "soft", soft.table)
    judged = study_judgments(tmp_path, scenes)
    assert judged.engines == {"soft": {"sound_speed": 20.0, "max_duration": 1.0}}
    assert judged.on(scenes).engines == judged.engines
    # What no engine computes may stand in both tables.
    usual, _ = swept(make_plan(grid, scenes), tmp_path)
    simple = usual.table[usual.table["model"] == "simple"]
    write_judgments(tmp_path / "judgments", "usual", simple)
    assert study_judgments(tmp_path, scenes).engines == judged.engines
    write_judgments(tmp_path / "judgments", "usual", usual.table)
    with pytest.raises(
        InputError, match=r"soft\.parquet: judges \S+ with other engine settings than .*usual"
    ):
        study_judgments(tmp_path, scenes)


def test_one_shard_can_hold_several_engines(tmp_path):
    scenes, grid = random_scenes(2, seed=31), small_grid(GRID)
    plans = [make_plan(grid, scenes, one) for one in (None, SOFT)]
    first = [swept(plan, tmp_path / str(k))[0].table for k, plan in enumerate(plans)]
    settings = tuple(s for plan in plans for s in plan.settings if isinstance(s, PourSetting))
    spans = tuple(Span(k, 0, 2) for k in range(len(settings)))
    both = replace(plans[0], settings=settings, rows=(), answers=())
    shard = Shard("both", 0, spans, 1.0, 2 * len(settings))
    told = []
    table, _ = compute(task_of(both, shard, tmp_path), on_done=told.append)
    alone = [t[t["model"] == "ife"].sort_values("damping_zeta")["judgment"] for t in first]
    expected = {
        (s.engine, s.damping_zeta): values
        for s, values in zip(settings, np.split(table["judgment"].to_numpy(), 4), strict=True)
    }
    for engine, judgments in ((EngineSettings(), alone[0]), (SOFT, alone[1])):
        ours = np.concatenate([expected[engine, zeta] for zeta in (4.0, 6.0)])
        assert np.array_equal(ours, judgments.to_numpy())
    assert sum(told) == 2 * len(settings)


class Stubborn(SimulationModel):
    def pours(self, scene, liquid, seed=0):
        return IntuitiveFluidsEngine().pours(scene, liquid)

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        return np.zeros(len(scenes))


def test_a_model_that_runs_its_own_pours_cannot_be_given_an_engine():
    point, scene = GridPoint("stubborn", "stubborn", Stubborn(), "water", 0), random_scenes(1)[0]
    assert isinstance(_needed(point, scene, (), EngineSettings())[0][0], JudgeSetting)
    with pytest.raises(InputError, match="stubborn"):
        _needed(point, scene, (), SOFT)


def test_liquids_of_any_cohesion_have_names_of_their_own():
    held = replace(HONEY_EXP1, tension=0.1)
    assert pour_setting(liquid=held) != pour_setting(liquid=HONEY_EXP1)
