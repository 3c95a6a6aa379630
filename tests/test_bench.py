"""The benchmark commands measure something, and count right."""

import json
from pathlib import Path

import pytest
from benchmarks import __main__ as benchmark
from benchmarks import ceiling

from pourcast import cli
from pourcast.sweep import bench
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
    rows = json.loads(capsys.readouterr().out)
    assert [row["simulations"] for row in rows] == [120, 60]
    assert [row["run"] for row in rows] == [64, 60]
    assert all(row["minutes"] > 0 for row in rows)
    assert cli.run(["bench", "--plan", "paper", "--share", "0.01"]) == 0
    assert "180 simulations" in capsys.readouterr().out


def test_speed_is_measured_for_liquid_and_marbles(monkeypatch):
    monkeypatch.setattr(bench, "DURATION", 0.1)
    table = bench.speed_table([15])
    assert list(table.index) == [
        ("liquid, 2e-4 s", 15),
        ("liquid", 15),
        ("marbles", 15),
    ]
    assert (table.filter(like="[1/s]") > 0).all(axis=None)
    assert table["step [ms]"].to_list() == pytest.approx([0.2, 0.4, 0.5], rel=0.02)


def test_the_ceiling_does_the_same_work(tmp_path: Path):
    program = ceiling.build(tmp_path)
    if program is None:
        pytest.skip("no g++ here")
    _, x, y = ceiling.run_ceiling(program, 25, 2000)
    assert (x, y) == pytest.approx(ceiling.mean_place(25, 0.4), abs=1e-4)


def test_the_benchmark_prints_tables_and_draws(monkeypatch, tmp_path, capsys):
    # Without the peers, which take minutes.
    small = {"COUNTS": (15, 25), "GROWTH_COUNTS": (15, 1000, 1100), "_GROWTH_DURATION": 0.1}
    small |= {"PICTURE": tmp_path / "speed.png"}
    for name, value in small.items():
        monkeypatch.setattr(benchmark, name, value)
    monkeypatch.setattr(benchmark.peers, "LIQUID_PEERS", {})
    monkeypatch.setattr(benchmark.peers, "MARBLE_PEERS", {})
    monkeypatch.setattr(bench, "DURATION", 0.05)
    monkeypatch.setattr(benchmark.ceiling, "STEPS", 250)
    benchmark.main()
    printed = capsys.readouterr().out
    assert "| ours / pourcast, " in printed
    assert "From N = 1,000 to 1,100 the cost grows" in printed
    assert (tmp_path / "speed.png").stat().st_size > 5_000
