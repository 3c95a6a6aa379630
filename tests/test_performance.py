"""What speed promises: ratios and counts, never the wall clock; and what it may not cost."""

import sys
import tracemalloc
from importlib.metadata import packages_distributions
from threading import Barrier

import llvmlite.binding
import numpy as np
import pytest

from pourcast import HONEY_EXP1, WATER, EngineSettings, Pour, simulate
from pourcast.engine.block import (
    Block,
    Lockstep,
    Simulation,
    SingleLiquid,
    SingleMarbles,
    lanes_worth,
)
from pourcast.engine.compile import kernel
from pourcast.engine.job import Stepping
from pourcast.engine.simd import LANES
from pourcast.engine.solids import BroadPhase, build_broad_phase
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.study.selection import filtered_scenes
from pourcast.sweep import bench
from tests.make import job, ramp_scene, random_scenes, run_one
from tests.test_dependencies import EXTRAS, canonical, declared
from tests.yardstick import processor_seconds_of, ratio, ratio_of, started

FIRST_SIMULATION = """
from pourcast import WATER, Pour, read_scenes, simulate
print(simulate([Pour(read_scenes("examples/ramp.json")[0], WATER, 50)])[0].position.tobytes().hex())
"""

OTHERS = "import numba, pydantic, scipy.spatial, shapely"
"""What a simulation needs of others, whatever we do; about half a second."""


def in_fresh_processes(code: str, yardstick: str) -> float:
    return ratio_of(lambda: processor_seconds_of(code), lambda: processor_seconds_of(yardstick))


def printed_by(code: str) -> str:
    process = started(code)
    answer, complaints = process.communicate(timeout=200)
    assert process.returncode == 0, complaints
    return answer


def test_the_package_alone_is_imported_at_first():
    code = (
        "import sys; before = set(sys.modules); import pourcast; print(*set(sys.modules) - before)"
    )
    rooms = {name.partition(".")[0] for name in printed_by(code).split()}
    assert rooms - set(sys.stdlib_module_names) == {"pourcast"}
    assert in_fresh_processes("import pourcast", OTHERS) < 1.0


PARSING = {"typer", "pydantic", "pydantic-core"}
"""What reads a command line; Typer hands arguments to pydantic."""

SCENES = PARSING | {"numpy", "shapely", "platformdirs"}

EVERY_HELP = """
import typer
from pourcast.cli.app import app

def paths(command, path=()):
    yield path
    for name, inner in getattr(command, "commands", {}).items():
        yield from paths(inner, (*path, name))

for path in paths(typer.main.get_command(app)):
    assert run([*path, "--help"]) == 0
"""

LOADED = {
    "list": SCENES | {"rich"},
    "models": SCENES | {"rich", "pillow"},  # Pillow by the ConvNet
    "predict examples/ramp.json -m gravity -m simple": SCENES | {"rich"},
    "predict examples/ramp.json -m gravity --json": SCENES | {"rich"},
    "import examples/drawing.svg -o {folder}/mine.json": SCENES | {"svgelements"},
    "export examples/ramp.json -o {folder}/splish.json": SCENES | {"svgelements"},
}
"""Command -> distributions that it may load, of those that we depend on."""


def loaded_by(code: str) -> set[str]:
    """Distributions of our dependencies that some code loads in a fresh process."""
    loaded = printed_by(
        f"import sys\nfrom pourcast.cli import run\n{code}\nprint(*sys.modules)"
    ).splitlines()[-1]
    rooms, owners = {name.partition(".")[0] for name in loaded.split()}, packages_distributions()
    return {canonical(one) for room in rooms for one in owners.get(room, ())} & declared(*EXTRAS)


def test_help_loads_what_parses_alone():
    assert loaded_by(EVERY_HELP) <= PARSING


@pytest.mark.parametrize("command", LOADED)
def test_what_commands_load_that_simulate_nothing(command, tmp_path):
    arguments = command.format(folder=tmp_path).split()
    assert loaded_by(f"assert run({arguments}) == 0") <= LOADED[command]


def test_a_heuristics_judgment_takes_little_more_than_the_imports_it_needs():
    command = (
        "from pourcast.cli import run; run(['predict', 'examples/ramp.json', '-m', 'gravity'])"
    )
    # Measured: 1.5; with Numba, pandas and the engine, 7.
    needed = "import numpy, pydantic.types, rich.progress, shapely, typer._adapters"
    assert in_fresh_processes(command, needed) < 3.0


def test_the_first_simulation_takes_little_more_than_the_imports_it_needs():
    printed_by(FIRST_SIMULATION)  # so that the kernels are in the cache
    # Measured: 2.0; without the cache, 18.
    assert in_fresh_processes(FIRST_SIMULATION, OTHERS) < 3.0


def test_the_first_simulation_compiles_nothing_that_is_in_the_cache():
    counted = (
        "from numba.core import event\n"
        "with event.install_recorder('numba:compile') as compiled:\n"
        f"    {'; '.join(FIRST_SIMULATION.split(chr(10))[1:-1])}\n"
        "print(len(compiled.buffer))\n"
    )
    printed_by(FIRST_SIMULATION)
    assert printed_by(counted).split()[-1] == "0"


FIRST_DISTANCES = """
import numpy as np
from pourcast.engine.polygons import pack_solids
from pourcast.engine.smoothing import weight
from pourcast.engine.solids import grid_index, obstacle_distances
solids = pack_solids([[(np.array([[0.2, 0.2], [0.8, 0.2], [0.5, 0.9]]), False)]])
distances = obstacle_distances(np.array([[0.5, 0.5]]), 0, solids)
print(distances.tobytes().hex(), weight(0.5), grid_index(2.5, 9))
"""
"""Kernels in several files, which take a second or two to compile; those of a liquid take ten."""


def test_several_processes_may_fill_an_empty_cache_at_once(tmp_path):
    processes = [started(FIRST_DISTANCES, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(4)]
    answers = [process.communicate(timeout=200) for process in processes]
    assert [process.returncode for process in processes] == [0] * 4, answers
    assert len({answer for answer, _ in answers}) == 1
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nbc")}
    assert len(before) == 3  # those that Python calls
    process = started(FIRST_DISTANCES, NUMBA_CACHE_DIR=str(tmp_path))
    assert process.communicate(timeout=200)[0] == answers[0][0]
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*.nbc")} == before


def test_bits_depend_neither_on_company_nor_order_nor_threads():
    rng = np.random.default_rng(4)
    scenes = random_scenes(40, seed=6)
    pours = [
        Pour(
            scenes[rng.integers(len(scenes))],
            (WATER, HONEY_EXP1)[rng.integers(2)],
            int(rng.choice([15, 18, 27, 50])),
            float(rng.integers(21)),
            kind="marbles" if rng.random() < 0.25 else "liquid",
        )
        for _ in range(200)
    ]
    settings = EngineSettings(max_duration=0.8)

    def bits(chosen, threads):
        outcomes = simulate([pours[k] for k in chosen], settings=settings, threads=threads)
        found = {k: o.position.tobytes() for k, o in zip(chosen, outcomes, strict=True)}
        return [found[k] for k in sorted(found)]

    expected = bits(range(200), 1)
    for threads in (1, 2, 3):
        assert bits(rng.permutation(200), threads) == expected
    for k in rng.choice(200, 20, replace=False):
        assert bits([k], 1) == [expected[k]]


def test_a_speed_too_small_for_a_normal_number_is_none():
    # Denormal numbers are slow on Intel's processors.
    place = np.array([[0.5, 0.7, 0.07]])
    tiny = np.full((1, 3), 1e-39, np.float32)
    for kind in ("liquid", "marbles"):
        end = run_one(job(place, velocity=tiny, gravity=0.0), 1e-3, 0.01, kind=kind)
        assert (end.velocity == 0.0).all()
    assert (tiny * np.float32(0.5) > 0.0).all()  # this thread's mode is left alone


@pytest.mark.parametrize(
    ("n", "kind", "few", "many"),
    [
        (15, "marbles", 50, 550),
        (400, "liquid", 4, 44),
        pytest.param(2000, "liquid", 4, 20, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("record", [False, True])
def test_a_batch_holds_of_each_pour_its_start_its_end_and_what_is_recorded(
    n, kind, few, many, record
):
    settings = EngineSettings(max_duration=0.006, frame_rate=500, marble_step=2e-3)

    def peak(count):
        pours = [Pour(ramp_scene(), WATER, n, kind=kind)] * count
        simulate(pours[:2], settings=settings)
        tracemalloc.start()
        simulate(pours, settings=settings, record=record, threads=1)
        held = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return held

    a_pour = (peak(many) - peak(few)) / (many - few)
    print(f"{a_pour:.0f} bytes a pour")
    # Measured: 1,100 bytes, 37 a particle, and 12 a particle and frame. Trajectories of these
    # three steps alone would be 48 more bytes a particle.
    frames = 4 if record else 0
    assert a_pour < 2_000 + (40 + 13 * frames) * n


def test_steps_twice_as_long_as_the_papers_leave_judgments_alone():
    scenes = filtered_scenes(VoronoiFamily(), 120, 1).scenes
    pours = [Pour(scene, WATER, 50, 5.0) for scene in scenes]
    ours, paper = (
        np.array([outcome.judgment for outcome in simulate(pours, settings=settings)])
        for settings in (EngineSettings(), EngineSettings(step=2e-4))
    )
    assert np.abs(ours - paper).mean() < 0.01
    assert np.corrcoef(ours, paper)[0, 1] > 0.995


@kernel
def chain(start: float, count: int) -> float:
    """Multiplications that wait for one another: three or four cycles each."""
    value = start
    for _ in range(count):
        value *= 0.9999999
    return value


SOLIDS = bench.obstacle_courses(LANES)
CELLS = BroadPhase(*build_broad_phase(SOLIDS, np.tile([1.0, 1.5], (LANES, 1)), 0.06, 0, LANES))
FRAME = Stepping(2e-4, 250)


def running(block: Block, count: int) -> Block:
    """A block full of water in flight."""
    jobs = bench.undamped_jobs(count, block.lanes)
    block.put([Simulation(number, job) for number, job in enumerate(jobs)], FRAME.step)
    for _ in range(6):
        block.advance(SOLIDS, CELLS, FRAME)
    return block


def test_the_engine_needs_few_cycles_a_pair():
    # Measured: 0.95 links of the chain (2.9 cycles) per pair and simulation with AVX-512.
    features = llvmlite.binding.get_host_cpu_features()
    allowed = 2.0 if features.get("avx512f") else 3.0 if features.get("avx2") else 6.0
    count, links = 50, 1_000_000
    block = running(Lockstep(count, "liquid"), count)
    chain(1.0, 10)
    found = ratio(lambda: block.advance(SOLIDS, CELLS, FRAME), lambda: chain(1.0, links), times=10)
    pairs = FRAME.steps_per_frame * LANES * count * (count - 1) / 2
    assert found * links / pairs < allowed


@pytest.mark.parametrize(
    ("kind", "single", "count"),
    [
        ("liquid", SingleLiquid, 50),
        ("liquid", SingleLiquid, 200),
        ("marbles", SingleMarbles, 50),
    ],
)
def test_one_pour_costs_a_small_part_of_a_full_block(kind, single, count):
    # Measured: 0.11 to 0.16 with 16 lanes, 0.24 to 0.29 with 8, 0.4 to 0.5 with 4.
    block, one = running(Lockstep(count, kind), count), running(single(count), count)
    found = ratio(
        lambda: one.advance(SOLIDS, CELLS, FRAME), lambda: block.advance(SOLIDS, CELLS, FRAME)
    )
    assert found < {16: 0.3, 8: 0.5, 4: 0.8}[LANES]


@pytest.mark.parametrize(("threads", "share"), [(1, 0.5), (2, 0.35)])
def test_blocks_in_lockstep_are_full_enough_to_be_worth_it(monkeypatch, threads, share):
    lanes, filled = [], []
    advance = Block.advance

    def noted(block, *arguments):
        if isinstance(block, Lockstep):
            lanes.append(block.lanes)
            filled.append(len(block.simulations))
            worth = lanes_worth(block.count)
            assert len(block.simulations) >= min(worth, LANES)
        advance(block, *arguments)

    monkeypatch.setattr(Block, "advance", noted)
    pours = [
        Pour(scene, liquid, count, zeta, kind=kind)
        for scene in random_scenes(4, seed=2)
        for zeta in (0.0, 2.0, 9.0)
        for count, liquid, kind in (
            (15, WATER, "liquid"), (20, HONEY_EXP1, "liquid"), (15, WATER, "marbles"),
            (130, WATER, "liquid"),
        )
    ]  # fmt: skip
    simulate(pours, settings=EngineSettings(max_duration=1.2), threads=threads)
    assert sum(filled) > share * sum(lanes)


def test_as_many_full_blocks_as_threads_are_filled_from_one_queue(monkeypatch):
    widths = []
    put = Block.put
    all_started = Barrier(3)

    def noted(block, simulations, step):
        if len(widths) < 3:
            widths.append(len(simulations))
            # A thread that starts late would find what the others have left of the queue.
            all_started.wait(timeout=60)
        put(block, simulations, step)

    monkeypatch.setattr(Block, "put", noted)
    pours = [Pour(scene, WATER, 15) for scene in random_scenes(3 * LANES, seed=3)]
    simulate(pours, settings=EngineSettings(max_duration=0.2), threads=3)
    assert widths == [LANES] * 3
