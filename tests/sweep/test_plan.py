"""Plans: every simulation once, in shards whose names say what is in them."""

import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pourcast.scenes.liquids.registry import HONEY_EXP1, HONEY_EXP2
from pourcast.sweep import plan as planning
from pourcast.sweep.grid import read_grid
from pourcast.sweep.plan import make_plan
from pourcast.sweep.settings import JudgeSetting, PourSetting
from pourcast.sweep.shard import task_of
from tests.make import ramp_scene, random_scenes
from tests.sweep.make import SMALL, small_grid, small_plan


def cells(shards):
    return Counter(
        (span.setting, scene)
        for shard in shards
        for span in shard.spans
        for scene in range(span.start, span.stop)
    )


def wanted(plan):
    return {(row.setting, scene) for row in plan.rows for scene in range(row.start, row.stop)}


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 9), st.floats(0.001, 30), st.sampled_from([1, 2, 256]))
def test_every_simulation_is_in_one_shard(count, shard_seconds, tile):
    text = SMALL.replace("shard_seconds = 0.02", f"shard_seconds = {shard_seconds}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "TILE", tile)
        plan = small_plan(count, text)
        found = cells(plan.shards)
    assert set(found) == wanted(plan)
    assert set(found.values()) == {1}
    assert sum(shard.simulations for shard in plan.shards) == plan.simulations
    assert sum(shard.seconds for shard in plan.shards) == pytest.approx(plan.seconds)
    assert [shard.number for shard in plan.shards] == list(range(len(plan.shards)))


def test_shards_of_a_large_grid_are_half_a_minute_to_two():
    plan = make_plan(read_grid("paper-exp1"), random_scenes(120, seed=5))
    seconds = np.array([shard.seconds for shard in plan.shards])
    assert seconds.max() <= 62
    in_range = (seconds >= 30) & (seconds <= 120)
    assert seconds[in_range].sum() > 0.9 * plan.seconds
    # Smaller ones end the list, and each ends a group or is one of the last.
    assert in_range[: len(seconds) // 2].mean() > 0.9
    # Lockstep wants company: few kinds of simulation in a shard, in one piece each.
    kinds = [{plan.settings[s.setting].group for s in shard.spans} for shard in plan.shards]
    assert np.mean([len(kind) for kind in kinds]) < 3


def test_a_plan_depends_on_grid_and_scenes_alone():
    one, two = small_plan(), small_plan()
    assert [s.id for s in one.shards] == [s.id for s in two.shards]
    assert len({s.id for s in one.shards}) == len(one.shards) > 5


@pytest.mark.parametrize(
    "change", ["scene", "parameter", "seed", "engine", "trajectories", "model", "goal"]
)
def test_a_shards_name_changes_with_all_that_determines_it(change, monkeypatch):
    text = 'shard_seconds = 1000\n[[models]]\nmodel = "simple"\n[[models]]\nmodel = "ife"\n'
    before = {shard.id for shard in small_plan(4, text).shards}
    if change == "engine":
        monkeypatch.setattr("pourcast.sweep.settings.engine_version", lambda: "other")
    elif change == "model":
        monkeypatch.setattr("pourcast.sweep.settings.model_version", lambda kind: "other")
    elif change == "goal":
        monkeypatch.setattr(planning, "goal_version", lambda kind: "other")
    changed = {
        "parameter": text.replace('"ife"', '"ife"\nparameters.damping_zeta = 6'),
        "seed": text.replace('"simple"', '"simple"\nseeds = [1]'),
        "trajectories": "trajectories = true\n" + text,
    }.get(change, text)
    scenes = random_scenes(4, seed=31)
    if change == "scene":
        scenes[0] = scenes[0].mirrored()
    after = {shard.id for shard in make_plan(small_grid(changed), scenes).shards}
    # The IFE has no seed, and knows nothing of SimpleSim's source; SimpleSim has no zeta, and
    # doesn't pour.
    kept = {"seed": 1, "model": 1, "parameter": 1, "engine": 1}.get(change, 0)
    assert len(before) == len(after) == 2
    assert len(before & after) == kept


def test_the_uncertain_ife_needs_no_simulation_of_its_own():
    text = '[[models]]\nmodel = "ife"\nparameters.damping_zeta = { from = 0, to = 20, step = 1 }\n'
    deterministic = small_plan(3, text + "parameters.zeta_sigma = 0\n")
    both = small_plan(
        3,
        text + "parameters.zeta_sigma = 0\n"
        + text.replace("to = 20", "to = 16") + "parameters.zeta_sigma = 4\n",
    )  # fmt: skip
    assert both.settings == deterministic.settings
    assert len(both.answers) > len(deterministic.answers)


def test_honey_is_that_of_each_scenes_goal():
    plan = small_plan(6, '[[models]]\nmodel = "truth-honey"\n')
    assert {s.liquid for s in plan.settings} == {HONEY_EXP1, HONEY_EXP2}
    for row in plan.rows:
        expected = {HONEY_EXP1: "basins", HONEY_EXP2: "cup"}[plan.settings[row.setting].liquid]
        assert {s.goal.kind for s in plan.scenes[row.start : row.stop]} == {expected}


def test_the_same_scene_under_two_names_is_simulated_once():
    twin = ramp_scene().model_copy(update={"id": "twin"})
    plan = make_plan(small_grid(), [ramp_scene(), twin])
    assert len(plan.scenes) == 1
    assert len(plan.listed) == 2


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_what_is_done_elsewhere_is_left_out(data):
    plan = small_plan(5)
    masks = {
        k: np.array(data.draw(st.lists(st.booleans(), min_size=5, max_size=5)))
        for k in range(0, len(plan.settings), 2)
    }
    rest = [plan.without(shard, masks) for shard in plan.shards]
    expected = {(s, k) for s, k in wanted(plan) if s not in masks or not masks[s][k]}
    assert set(cells([shard for shard in rest if shard is not None])) == expected
    for shard, left in zip(plan.shards, rest, strict=True):
        if left is not None:
            assert (left.id == shard.id) == (left.spans == shard.spans)


def test_a_task_carries_only_what_it_needs(tmp_path):
    plan = small_plan(5)
    for shard in plan.shards:
        task = task_of(plan, shard, tmp_path)
        assert len(task.settings) == len({span.setting for span in shard.spans})
        there = {
            (task.settings[span.setting].identity, task.digests[k])
            for span in task.shard.spans
            for k in range(span.start, span.stop)
        }
        here = {(plan.settings[s].identity, plan.scene_digests[k]) for s, k in cells([shard])}
        assert there == here


def test_settings_say_all_that_matters():
    plan = small_plan()
    assert len({setting.identity for setting in plan.settings}) == len(plan.settings)
    kinds = {type(setting) for setting in plan.settings}
    assert kinds == {PourSetting, JudgeSetting}


MANY = """
import hashlib, re, sys
from pathlib import Path
from pourcast.sweep.plan import make_plan
from pourcast.sweep.status import status_of
from pourcast.sweep.store import Store
from tests.make import ramp_scene
from tests.sweep.make import small_grid
from tests.yardstick import ratio

def scene(k):
    start = ramp_scene().liquid.model_copy(update={"centre": (0.4, 1.3 + 1e-6 * k)})
    return ramp_scene().model_copy(update={"id": str(k), "liquid": start})

scenes = [scene(k) for k in range(800)]
text = '''
[[models]]
model = "ife"
parameters.n_particles = { from = 1800, to = 2000, step = 10 }
parameters.damping_zeta = { from = 0, to = 20, step = 1 }
parameters.zeta_sigma = 0
parameters.liquid = ["water", "honey"]
'''

def look_through(plan, store, done):
    status = status_of(plan, store)
    assert status.done_shards == done, status
    assert not status.damaged

def store_of(plan, folder):
    store = Store(folder)
    done = plan.shards[: len(plan.shards) // 2]
    for name in {shard.id[:2] for shard in done}:
        (store.shards / name).mkdir(parents=True)
    for shard in done:
        content = shard.id.encode()
        name = f"{shard.id}-{hashlib.sha256(content).hexdigest()[:16]}.parquet"
        with open(f"{store.shards}/{shard.id[:2]}/{name}", "xb", buffering=0) as stream:
            stream.write(content)
    return plan, store, len(done)

grid = small_grid(text)
planning = ratio(lambda: make_plan(grid, scenes), lambda: make_plan(grid, scenes[:80]), times=2)
many = make_plan(grid, scenes)
assert len(many.shards) > 100_000
many = store_of(many, Path(sys.argv[1], "many"))
few = store_of(make_plan(grid, scenes[:80]), Path(sys.argv[1], "few"))
looking = ratio(lambda: look_through(*many), lambda: look_through(*few), times=2)
# Not `getrusage`: that begins with the memory of the process that started this one.
peak = re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text()).group(1)
print(planning, looking, peak)
"""


def test_a_hundred_thousand_shards_are_planned_and_looked_through_soon_and_in_little_room(tmp_path):
    command = [sys.executable, "-c", MANY, str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    planning, looking, kilobytes = (float(word) for word in run.stdout.splitlines()[-1].split())
    # Over a tenth of them: 10 where each costs the same, 100 where each is compared with the others.
    assert planning < 30
    assert looking < 30
    assert kilobytes < 1_000_000
