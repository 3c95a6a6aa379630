"""The benchmark commands measure something, and count right."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks import __main__ as benchmark
from benchmarks import ceiling

from pourcast import cli
from pourcast.cores import available_cores
from pourcast.engine.job import Stepping
from pourcast.engine.simd import LANES
from pourcast.sweep import bench, latency, machine
from pourcast.sweep.grid import parse_grid


def test_a_plan_is_measured_and_scaled(monkeypatch, capsys):
    text = (
        '[[models]]\nmodel = "ife"\n'
        "parameters = { n_particles = 15, zeta_sigma = 0, damping_zeta = [5, 9] }\n"
        '[[models]]\nmodel = "gravity"\n'
    )
    monkeypatch.setattr(bench, "experiment_grid", lambda one: parse_grid(text, one.name, "grid"))
    monkeypatch.setattr(bench, "PAPER", ("exp2",))
    assert cli.run(["bench", "--plan", "paper", "--share", "0.01", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["table"]
    assert [row["simulations"] for row in rows] == [120, 60]
    assert [row["run"] for row in rows] == [64, 60]
    assert all(row["minutes"] > 0 for row in rows)
    assert cli.run(["bench", "--plan", "paper", "--share", "0.01"]) == 0
    assert "180 simulations" in capsys.readouterr().out


def printed(capsys, *arguments: str) -> tuple[dict, list[dict]]:
    assert cli.run(["bench", *arguments, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    return found["machine"], found["table"]


def test_speed_is_measured_for_liquid_and_marbles(monkeypatch, capsys):
    monkeypatch.setattr(bench, "MEASURED_SECONDS", 0.1)
    monkeypatch.setattr(bench, "_MID_POUR", 0.1)
    machine, rows = printed(capsys, "-N", "15")
    assert machine["cores"] == available_cores()
    assert machine["lanes"] == LANES
    cores = [1] if machine["cores"] == 1 else [1, machine["cores"]]
    cases = [(kind, 15, n) for kind in ("liquid, 2e-4 s", "liquid", "marbles") for n in cores]
    assert [(row["kind"], row["N"], row["cores"]) for row in rows] == cases
    assert all(0 < row["least"] <= row["median [1/s]"] <= row["greatest"] for row in rows)
    steps = {row["kind"]: row["step [ms]"] for row in rows}
    assert list(steps.values()) == pytest.approx([0.2, 0.4, 0.5], rel=0.02)
    assert cli.run(["bench", "-N", "15"]) == 0
    text = capsys.readouterr().out
    assert f"lanes: {LANES}" in text
    assert machine["processor"] in text


@pytest.mark.parametrize(
    ("of_a_run", "seconds", "frames"),
    [(0.0, 0.1, (1, 1, 1)), (0.0, 7.001, (1, 10, 10)), (0.0, 1e6, (1, 400, 400)),
     (0.9, 70.0, (1, 10, 52))],
)  # fmt: skip
def test_a_run_is_as_long_as_its_time_allows(monkeypatch, of_a_run, seconds, frames):
    # A frame takes a tenth of a second, whatever the machine.
    durations, now = [], [0.0]

    def run_batch(jobs, *_arguments, **_options):
        durations.append(jobs[0].duration)
        now[0] += of_a_run + 0.1 * jobs[0].duration / 0.01
        return [SimpleNamespace(time=job.duration) for job in jobs]

    monkeypatch.setattr(bench, "run_batch", run_batch)
    monkeypatch.setattr(bench.time, "perf_counter", lambda: now[0])
    jobs, stepping = bench.undamped_jobs(15, LANES), Stepping(1e-3, 10)
    found = bench.speeds(jobs, "liquid", stepping, 1, seconds)
    first, second, others = frames
    run_frames = [first, second] + [others] * bench.RUNS
    assert durations == pytest.approx([0.01 * count for count in run_frames])
    simulated = LANES * others * stepping.frame
    expected = simulated / bench.DURATION / (of_a_run + 0.1 * others)
    assert found == pytest.approx(np.full(bench.RUNS, expected))


def test_what_rests_before_a_run_ends_counts_as_long_as_it_ran(monkeypatch):
    now = [0.0]

    def run_batch(jobs, *_arguments, **_options):
        now[0] += 1.0
        return [SimpleNamespace(time=job.duration / 2) for job in jobs]

    monkeypatch.setattr(bench, "run_batch", run_batch)
    monkeypatch.setattr(bench.time, "perf_counter", lambda: now[0])
    jobs = bench.undamped_jobs(15, LANES)
    found = bench.speeds(jobs, "liquid", Stepping(1e-3, 10), 1, 1e9)
    assert found == pytest.approx(np.full(bench.RUNS, LANES / 2))


def test_latency_is_measured_for_pours_and_predictions(monkeypatch, capsys):
    monkeypatch.setattr(latency, "MEASURED_SECONDS", 1e-3)
    monkeypatch.setattr(latency, "PREDICTED", ("water-ife",))
    _, rows = printed(capsys, "--latency", "-N", "15")
    assert [(row["what"], row["N"]) for row in rows] == [
        ("water", 15), ("honey", 15), ("marbles", 15), ("predict, water-ife", 50),
    ]  # fmt: skip
    assert all(0 < row["least"] <= row["median [ms]"] <= row["greatest"] for row in rows)
    assert all(row["runs"] == 1 for row in rows)
    assert all(row["ends at [s]"] > 0.1 for row in rows[:3])
    assert cli.run(["bench", "--latency", "-N", "15"]) == 0
    assert "15.00" not in capsys.readouterr().out


def test_runs_are_repeated_while_they_fit():
    assert len(latency.milliseconds(lambda: None, 10.0)) == latency.MOST_RUNS
    assert len(latency.milliseconds(lambda: None, 0.0)) == 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["-N", "0"], "'-N': Input should be greater than or equal to 1"),
        (["-N", "301"], "'-N': Input should be less than or equal to 300"),
        (["-N", "x"], "'-N': Input should be a valid integer"),
        (["--latency", "--plan", "paper"], "expected --plan or --latency, found both"),
        (["-N", "50", "--plan", "paper"], "expected --plan or -N, found both"),
        (["--plan", "own"], "'own' is not one of 'paper'"),
    ],
)
def test_a_wrong_call_is_one_line(arguments, complaint, capsys):
    assert cli.run(["bench", *arguments]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1


def test_the_machine_is_named_as_its_kernels_see_it(monkeypatch):
    assert machine.processor_name()
    for features, name in (
        ("+sse2,+avx,+avx2,-avx512f", "AVX2"), ("+neon", "NEON"), ("-sse2", "none known"),
    ):  # fmt: skip
        monkeypatch.setattr(machine.numba.config, "CPU_FEATURES", features)
        assert machine.vector_instructions() == name


def test_the_ceiling_does_the_same_work(tmp_path):
    programs = ceiling.build(tmp_path)
    if not programs:
        pytest.skip("no C++ compiler here")
    _, x, y = ceiling.run_engine(25, 2000)
    for program in programs.values():
        assert ceiling.run_ceiling(program, 25, 2000)[1:] == pytest.approx((x, y), abs=1e-4)


def test_the_benchmark_prints_tables_and_draws(monkeypatch, tmp_path, capsys):
    # Without the peers, which take minutes.
    small = {"COUNTS": (15, 25), "LATENCY_COUNTS": (15,), "GROWTH_COUNTS": (15, 301, 310)}
    small |= {
        "GROWTH_FROM": 301,
        "_GROWTH_DURATION": 0.1,
        "_TURNS": 1,
        "PICTURE": tmp_path / "speed.png",
    }
    for name, value in small.items():
        monkeypatch.setattr(benchmark, name, value)
    monkeypatch.setattr(benchmark, "avx2_environment", lambda: None)
    monkeypatch.setattr(benchmark.peers, "LIQUID_PEERS", {"None": ("no_such_module", None)})
    monkeypatch.setattr(benchmark.peers, "MARBLE_PEERS", {})
    monkeypatch.setattr(benchmark.ceiling, "STEPS", 250)
    monkeypatch.setattr(benchmark.ceiling, "build", lambda folder: {"g++, 8 lanes": folder})
    monkeypatch.setattr(benchmark.ceiling, "run_ceiling", lambda *_: (0.1, 0.5, 0.5))
    monkeypatch.setattr(latency, "MEASURED_SECONDS", 1e-3)
    monkeypatch.setattr(latency, "PREDICTED", ())
    benchmark.main([])
    printed = capsys.readouterr().out
    assert "| ours / pourcast, " in printed
    assert "| ceiling (C++) [1/s] | 160 | 160 |" in printed
    assert "| pourcast [ms] |" in printed
    assert "From N = 301 to 310 the cost grows" in printed
    assert (tmp_path / "speed.png").stat().st_size > 5_000


def test_a_machine_is_taken_for_a_lesser_one_only_if_it_is_more(monkeypatch):
    features = {"avx512f": True, "avx512vl": True, "avx2": True, "fma": True, "sse4a": False}
    monkeypatch.setattr(benchmark.llvmlite.binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(benchmark, "vector_instructions", lambda: "AVX-512")
    found = benchmark.avx2_environment()["NUMBA_CPU_FEATURES"].split(",")
    assert found == ["-avx512f", "-avx512vl", "+avx2", "+fma", "-sse4a"]
    monkeypatch.setattr(benchmark, "vector_instructions", lambda: "AVX2")
    assert benchmark.avx2_environment() is None
