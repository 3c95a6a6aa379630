"""One simulation by clusters of its particles: the same bits as in lockstep, near pairs alone."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import llvmlite.binding
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from pourcast import HONEY_EXP1, WATER, EngineSettings, Pour, simulate
from pourcast.engine import batch, block, clusters, pairs
from pourcast.engine.block import Lockstep, Simulation, SingleLiquid
from pourcast.engine.contact import collide_with_polygons
from pourcast.engine.job import Stepping
from pourcast.engine.packing import pack_cylinder
from pourcast.engine.simd import LANES, flush_denormals
from pourcast.engine.solids import BroadPhase, build_broad_phase
from pourcast.sweep.bench import obstacle_courses
from tests.make import NO_SOLIDS, job, random_scenes

SHORT = EngineSettings(max_duration=1.0)


def always(monkeypatch, way: str) -> None:
    worth = {"lockstep": 0.0, "single": np.inf}[way]
    monkeypatch.setattr(batch, "lanes_worth", lambda count: worth)


def told(outcome) -> tuple[object, ...]:
    return (
        outcome.position.tobytes(), outcome.frames.tobytes(), outcome.judgment, outcome.touched,
        outcome.time, outcome.settled,
    )  # fmt: skip


@pytest.mark.parametrize("count", [1, 2, 7, 16, 17, 50, 130])
def test_lockstep_and_single_simulations_have_the_same_bits(monkeypatch, count):
    pours = [
        Pour(scene, liquid, count, zeta, kind=kind)
        for scene in random_scenes(2, seed=count)
        for liquid in (WATER, HONEY_EXP1, replace(WATER, cohesion=0.05, tension=0.01))
        for zeta in (0.0, 5.0)
        for kind in ("liquid", "marbles")
    ]
    found = []
    for way in ("lockstep", "single"):
        always(monkeypatch, way)
        found.append([told(o) for o in simulate(pours, settings=SHORT, record=True)])
    assert found[0] == found[1]


@settings(max_examples=10, deadline=None)
@given(
    st.lists(st.sampled_from([15, 20, 33]), min_size=1, max_size=40),
    st.integers(1, 4),
    st.sampled_from([1.5, 4.0, 7.0]),
    st.integers(0, 1000),
    st.sampled_from(["liquid", "marbles"]),
)
def test_simulations_may_change_between_both_at_any_frame(counts, threads, worth, seed, kind):
    # Durations differ, so that blocks run out of simulations and hand over the rest.
    rng = np.random.default_rng(seed)
    scenes = random_scenes(4, seed=1)
    pours = [
        Pour(scenes[rng.integers(4)], WATER, count, float(rng.integers(40)), kind=kind)
        for count in counts
    ]
    brief = EngineSettings(max_duration=0.5, step=1e-3, marble_step=1e-3)
    with pytest.MonkeyPatch.context() as patch:
        always(patch, "single")
        expected = [told(o) for o in simulate(pours, settings=brief, record=True, threads=1)]
        patch.setattr(batch, "lanes_worth", lambda count: worth)
        assert [
            told(o) for o in simulate(pours, settings=brief, record=True, threads=threads)
        ] == expected


@pytest.mark.parametrize("count", [1, 5, 64, 500])
def test_lists_hold_all_that_is_near_in_the_order_of_numbers(count):
    rng = np.random.default_rng(count)
    place = (rng.uniform(0, 1, (count, 3)) * [1.0, 1.5, 0.148]).astype(np.float32)
    single, one = SingleLiquid(count), job(place, support_radius=0.13)
    single.put([Simulation(0, one)], 1e-4)
    lists = single._clusters
    assert sorted(lists.order) == list(range(len(lists.order)))
    tree = KDTree(place)
    for cluster, partners in enumerate(lists.partner):
        listed = partners[: lists.partner_count[cluster]]
        assert (np.diff(listed) > 0).all()
        members = lists.order[cluster * LANES : (cluster + 1) * LANES]
        members = np.minimum(members, count - 1)  # copies of the last particle
        near = set(np.concatenate(tree.query_ball_point(place[members], 0.13)).astype(int))
        assert near <= set(listed.tolist())
        far = set(np.concatenate(tree.query_ball_point(place[members], 0.2)).astype(int))
        assert set(listed.tolist()) <= far
    assert not lists.marked.any()


@pytest.mark.parametrize("members", [2, 3])
def test_a_team_of_threads_has_the_same_bits(monkeypatch, members):
    monkeypatch.setattr(clusters, "PARTICLES_A_MEMBER", 40)
    monkeypatch.setattr(block, "available_cores", lambda: members)
    scenes = random_scenes(2, seed=6)
    pours = [Pour(scenes[0], WATER, 170), Pour(scenes[1], HONEY_EXP1, 120, 3.0)]
    for pour in pours:
        alone, shared = (
            simulate([pour], settings=SHORT, record=True, threads=threads)
            for threads in (1, members)
        )
        assert told(alone[0]) == told(shared[0])


def test_threads_without_simulations_of_their_own_help_with_the_others(monkeypatch):
    joined = []
    monkeypatch.setattr(block, "available_cores", lambda: 3)
    join = SingleLiquid.join
    monkeypatch.setattr(SingleLiquid, "join", lambda single: joined.append(single) or join(single))
    simulate([Pour(random_scenes(1)[0], WATER, 400)], settings=SHORT, threads=3)
    assert len(joined) == 2
    joined.clear()
    simulate([Pour(random_scenes(1)[0], WATER, 40)], settings=SHORT, threads=3)
    assert not joined


def test_a_team_that_is_slower_than_its_leader_alone_is_let_go(monkeypatch):
    monkeypatch.setattr(block, "available_cores", lambda: 2)
    single, frame = SingleLiquid(310), Stepping(1e-4, 3)
    one = job(pack_cylinder(310, (0.5, 1.0), 0.074, 0.148), radius=0.01, support_radius=0.046)
    single.put([Simulation(0, one)], frame.step)
    cells = BroadPhase(*build_broad_phase(NO_SOLIDS, np.array([[1.0, 1.5]]), 0.1, 0, 1))
    single.advance(NO_SOLIDS, cells, frame)
    assert single.wants_help
    with ThreadPoolExecutor(1, initializer=flush_denormals) as pool:
        helping = pool.submit(single.join())
        single.regroup(alone=False)
        assert len(single.helpers) == 1
        single._seconds_alone = 0.0
        for _ in range(3):
            assert not helping.done()
            single.regroup(alone=False)
            single.advance(NO_SOLIDS, cells, frame)
        single.regroup(alone=False)
        helping.result(timeout=30)
    assert not single.helpers
    assert not single.wants_help


def test_clusters_are_of_particles_near_one_another():
    # A cluster of a packed blob is wider than its share of the volume, but not by much.
    rng = np.random.default_rng(3)
    place = (0.4 + 0.2 * rng.uniform(0, 1, (512, 3))).astype(np.float32)
    single = SingleLiquid(512)
    single.put([Simulation(0, job(place, depth=1.0, radius=0.0125, support_radius=0.06))], 1e-4)
    widths = (single._clusters.high - single._clusters.low)[:, : 512 // LANES]
    assert widths.mean() < 2.2 * 0.2 * (LANES / 512) ** (1 / 3)


def test_what_falls_as_one_keeps_its_lists():
    place = 0.5 + 0.02 * np.arange(30).reshape(10, 3).astype(np.float32) % 0.3
    single = SingleLiquid(10)
    single.put([Simulation(0, job(place))], 1e-4)
    moved = (single.state, single.parameters, single._clusters)
    assert not clusters.have_moved(*moved)
    single.state.position[1] -= 0.4
    assert not clusters.have_moved(*moved)
    single.state.position[1, 0, 0] -= 0.7 * clusters.SKIN * 0.085
    assert clusters.have_moved(*moved)


BITS = """
from pourcast import HONEY_EXP1, WATER, EngineSettings, Pour, simulate
from pourcast.engine.simd import LANES
from tests.make import random_scenes
pours = [
    Pour(scene, liquid, count, zeta, kind=kind)
    for scene in random_scenes(3, seed=4)
    for count, liquid, zeta, kind in (
        (20, WATER, 0.0, "liquid"), (50, HONEY_EXP1, 5.0, "liquid"), (330, WATER, 0.0, "liquid"),
        (20, WATER, 3.0, "marbles"),
    )
]
ends = simulate(pours, settings=EngineSettings(max_duration=0.7), threads=2)
print(LANES, "".join(end.position.tobytes().hex() for end in ends))
"""


@pytest.mark.slow
@pytest.mark.skipif(LANES < 16, reason="this machine has vectors of one width")
def test_bits_do_not_depend_on_the_width_of_the_vectors(tmp_path):
    host = llvmlite.binding.get_host_cpu_features()
    narrow = {name: on and not name.startswith("avx512") for name, on in host.items()}
    found = {}
    for features in (host, narrow):
        listed = ",".join(f"{'+' if on else '-'}{name}" for name, on in features.items())
        run = subprocess.run(
            [sys.executable, "-c", BITS], capture_output=True, text=True, check=True,
            env=os.environ | {"NUMBA_CPU_FEATURES": listed, "NUMBA_CACHE_DIR": str(tmp_path)},
        )  # fmt: skip
        lanes, bits = run.stdout.split()
        found[int(lanes)] = bits
    assert sorted(found) == [8, 16]
    assert found[8] == found[16]


@pytest.mark.parametrize("way", ["never filled", "finished"])
def test_an_empty_lane_adds_no_pairs_to_those_of_the_others(way):
    rng = np.random.default_rng(5)
    jobs = [
        job((rng.uniform(0, 1, (60, 3)) * [1.0, 1.5, 0.148]).astype(np.float32))
        for _ in range(LANES)
    ]
    some = Lockstep(60, "liquid")
    some.put([Simulation(number, one) for number, one in enumerate(jobs[:2])], 1e-4)
    listed = some._pairs.start[60]
    if way == "finished":
        some = Lockstep(60, "liquid")
        some.put([Simulation(number, one) for number, one in enumerate(jobs)], 1e-4)
        assert some._pairs.start[60] > listed
        for lane in range(2, LANES):
            some._empty(lane)
        some._find_density()
    near = np.zeros((60, 60), bool)
    for one in jobs[:2]:
        near |= (
            KDTree(one.position)
            .sparse_distance_matrix(KDTree(one.position), (1.0 + pairs.SKIN) * one.support_radius)
            .toarray()
            > 0.0
        )
    assert some._pairs.start[60] == np.tril(near, -1).sum()


def test_a_list_of_solids_is_made_anew_at_the_same_time_in_any_company():
    # A displacement whose square is above the slack's if it is rounded twice, and not if once.
    f, rng = np.float32, np.random.default_rng(0)
    start = np.array([0.31, 0.8], f)
    while True:
        place = start + rng.uniform(-0.01, 0.01, 2).astype(f)
        dx, dy = place - start
        once = f(np.float64(dx) ** 2 + np.float64(dy * dy))
        if dx * dx + dy * dy > once:
            break
    jobs = [job(np.array([[x, 0.8, 0.07]], f)) for x in (0.31, 0.33)]
    solids = obstacle_courses(1)
    with ThreadPoolExecutor(1) as pool:
        broad_phase = batch._broad_phase_of(jobs, solids, pool, 1)
    listed = []
    for company in (False, True):
        two = Lockstep(1, "liquid")
        two.put([Simulation(number, one) for number, one in enumerate(jobs)], 1e-4)
        collide_with_polygons(two.state, two.parameters, solids, broad_phase, 0, 1)
        two.state.position[:2, 0, 0], two.state.squared_slack[0, 0] = place, once
        two.state.squared_slack[0, 1] = -1.0 if company else np.inf
        collide_with_polygons(two.state, two.parameters, solids, broad_phase, 0, 1)
        listed.append(two.state.listed_at[:, 0, 0].tolist())
    assert listed[0] == listed[1] == start.tolist()
