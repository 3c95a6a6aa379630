"""The engine beside its ceiling and its peers, for batches and for one pour, and its growth with N.

    python -m benchmarks [batch] [latency] [marbles] [growth]

prints tables in Markdown, ratios first, and `batch` writes docs/images/speed.png; all take less
than ten minutes. On a machine with AVX-512, `batch` and `latency` come again without it, as on
laptops. What isn't there (g++, clang++, Warp, Taichi, JAX, SPlisHSPlasH, MuJoCo) is left out.
"""

import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import llvmlite.binding
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from benchmarks import ceiling, peers
from pourcast.cores import available_cores
from pourcast.engine.batch import run_batch
from pourcast.engine.block import lanes_worth
from pourcast.engine.simd import LANES
from pourcast.simulation.settings import EngineSettings, Kind
from pourcast.sweep.bench import COUNTS, DURATION, obstacle_courses, undamped_jobs
from pourcast.sweep.latency import latency_table
from pourcast.sweep.machine import describe_machine, vector_instructions

AGAIN_WITHOUT_AVX512 = ("batch", "latency")
PICTURE = Path(__file__).parents[1] / "docs" / "images" / "speed.png"
LATENCY_COUNTS = (50, 200)
GROWTH_COUNTS = (15, 50, 100, 200, 300, 301, 500, 1000, 2000, 5000)
GROWTH_FROM = 1000
"""The exponent of growth is of this many particles and more."""
_GROWTH_DURATION = 0.6
_TURNS = 3
"""Ours and the ceiling are measured in turns, the best counts: the machine may have other work."""
_BEYOND_AVX2 = ("avx512", "avxvnni", "gfni", "vaes", "vpclmulqdq")
"""Beginnings of LLVM's names of what came with AVX-512 or after it."""

Speeds = dict[str, list[float]]
"""By program: simulations of `DURATION` per second for several N."""


def avx2_environment() -> dict[str, str] | None:
    """What makes kernels as for a laptop without AVX-512; None where that is no change."""
    features = llvmlite.binding.get_host_cpu_features()
    if not features.get("avx512f") or vector_instructions() != "AVX-512":
        return None
    kept = {name: on and not name.startswith(_BEYOND_AVX2) for name, on in features.items()}
    text = ",".join(f"{'+' if on else '-'}{name}" for name, on in kept.items())
    return {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": text}


def peer_speeds(found: dict[str, peers.Peer], counts: Iterable[int], batch: int) -> Speeds:
    """Speeds of those peers whose module can be imported."""
    return {
        name: [1.0 / seconds(n, batch) for n in counts]
        for name, (module, seconds) in found.items()
        if importlib.util.find_spec(module)
    }


def our_speed(count: int, kind: Kind, simulations: int, threads: int) -> float:
    """Simulations per second of our engine, by the clock on the wall."""
    stepping = ceiling.STEPPING
    if kind == "marbles":
        stepping = EngineSettings().stepping("marbles", 0.03, 0.0)
    jobs, solids = undamped_jobs(count, simulations), obstacle_courses(simulations)
    run_batch([replace(jobs[0], duration=1e-3)], solids, stepping, kind=kind, threads=1)
    jobs = [replace(job, duration=ceiling.STEPS * ceiling.PAPER_STEP) for job in jobs]
    start = time.perf_counter()
    run_batch(jobs, solids, stepping, kind=kind, threads=threads)
    return simulations / (time.perf_counter() - start)


def batch_speeds() -> tuple[Speeds, Speeds]:
    """Liquid at each of `COUNTS`: ours on one core and on all, the ceiling; all its programs."""
    cores, simulations = available_cores(), ceiling.SCENES
    with tempfile.TemporaryDirectory() as folder:
        programs = ceiling.build(Path(folder))
        found: Speeds = {"pourcast": [], f"pourcast, {cores} cores": []}
        ceilings: Speeds = {f"ceiling ({name})": [] for name in programs}
        for count in COUNTS:
            our_speed(count, "liquid", 1, 1)
            turns = [
                [
                    simulations / ceiling.run_engine(count, ceiling.STEPS)[0],
                    our_speed(count, "liquid", simulations * cores, cores),
                    *(
                        simulations / ceiling.run_ceiling(program, count, ceiling.STEPS)[0]
                        for program in programs.values()
                    ),
                ]
                for _ in range(_TURNS)
            ]
            for speeds, best in zip(
                [*found.values(), *ceilings.values()], np.max(turns, axis=0), strict=True
            ):
                speeds.append(float(best))
    if ceilings:
        found["ceiling (C++)"] = list(np.max(list(ceilings.values()), axis=0))
    return found, ceilings


def print_markdown(table: pd.DataFrame) -> None:
    """Print a table, numbers with three digits."""
    frame = table.reset_index()
    print("| " + " | ".join(map(str, frame.columns)) + " |")
    print("|" + " --- |" * len(frame.columns))
    for row in frame.itertuples(index=False, name=None):
        cells = (f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in row)
        print("| " + " | ".join("" if cell == "nan" else cell for cell in cells) + " |")


def speed_rows(rows: Speeds, counts: Iterable[int]) -> pd.DataFrame:
    """A row a program, a column an N."""
    columns = [f"N = {n}" for n in counts]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("")


def print_speeds(title: str, found: Speeds, counts: Iterable[int], unit: str) -> None:
    """Ours over the others, then simulations per second, or milliseconds for one."""
    ours = np.array(found["pourcast"])
    rows = {
        f"ours / {name}": list(ours / np.array(speeds))
        for name, speeds in found.items()
        if name != "pourcast"
    }
    for name, speeds in found.items():
        values = np.array(speeds)
        rows[f"{name} [{unit}]"] = list(values if unit == "1/s" else 1e3 / values)
    print(f"\n**{title}**\n")
    print_markdown(speed_rows(rows, counts))


def plot(found: Speeds) -> None:
    """Speed against N, log-log, the ceiling as a line."""
    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes = figure.subplots()
    for name, speeds in found.items():
        style = "k--" if name.startswith("ceiling") else "o-"
        axes.loglog(COUNTS, speeds, style, label=name, markersize=4)
    axes.set(xlabel="particles", ylabel="simulations of 4 s per second")
    axes.set_xticks(COUNTS, [str(n) for n in COUNTS], minor=False)
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="lower left", fontsize=8)
    figure.savefig(PICTURE, dpi=110)


def batch(*, with_peers: bool) -> None:
    """Batches of liquid: ours, the ceiling, peers; and the picture."""
    found, ceilings = batch_speeds()
    if with_peers:
        found |= peer_speeds(peers.LIQUID_PEERS, COUNTS, ceiling.SCENES)
    print_speeds(
        f"Batches of liquid, {ceiling.STEPS:,} steps of 2e-4 s; ours on one core",
        found, COUNTS, "1/s",
    )  # fmt: skip
    print("\nThe ceiling's programs [1/s]:\n")
    print_markdown(speed_rows(ceilings, COUNTS))
    if with_peers:
        plot(found)


def latency(*, with_peers: bool) -> None:
    """One simulation from start to answer: as `pourcast bench --latency`, and beside peers."""
    print("\n**One pour or prediction, from start to answer, on all cores**\n")
    print_markdown(latency_table(COUNTS))
    cores = available_cores()
    kinds: dict[Kind, dict[str, peers.Peer]] = {
        "liquid": peers.LIQUID_PEERS,
        "marbles": peers.MARBLE_PEERS,
    }
    for kind, others in kinds.items():
        ours = [max(our_speed(n, kind, 1, cores) for _ in range(_TURNS)) for n in LATENCY_COUNTS]
        found: Speeds = {"pourcast": ours}
        if with_peers:
            found |= peer_speeds(others, LATENCY_COUNTS, 1)
        print_speeds(
            f"One simulation of {kind}, {DURATION:g} s; a ratio of 5 is five times faster",
            found, LATENCY_COUNTS, "ms",
        )  # fmt: skip


def marbles(*, with_peers: bool) -> None:
    """Batches of marbles at our default step."""
    found: Speeds = {"pourcast": [our_speed(n, "marbles", ceiling.SCENES, 1) for n in COUNTS]}
    if with_peers:
        found |= peer_speeds(peers.MARBLE_PEERS, COUNTS, ceiling.SCENES)
    print_speeds("Batches of marbles, 4 s; ours on one core", found, COUNTS, "1/s")


def growth_costs() -> dict[int, float]:
    """Milliseconds per step and simulation against the number of particles, on one core."""
    found = {}
    for count in GROWTH_COUNTS:
        batch = LANES if lanes_worth(count) <= LANES else 1
        jobs = [replace(job, duration=_GROWTH_DURATION) for job in undamped_jobs(count, batch)]
        run = [jobs, obstacle_courses(batch), ceiling.STEPPING]
        run_batch([replace(jobs[0], duration=1e-3)], *run[1:], threads=1)  # for the compiler
        seconds = []
        for _ in range(_TURNS):
            start = time.perf_counter()
            run_batch(*run, threads=1)
            seconds.append(time.perf_counter() - start)
        steps = _GROWTH_DURATION / ceiling.STEPPING.step
        found[count] = 1e3 * min(seconds) / steps / batch
    return found


def growth(*, with_peers: bool) -> None:  # noqa: ARG001 (no peer takes part)
    """Cost against the number of particles."""
    costs = growth_costs()
    print("\n**Cost against the number of particles, one core**\n")
    table = pd.DataFrame([list(costs.values())], columns=list(costs), index=["ms per step"])
    print_markdown(table.rename_axis("N"))
    large = [n for n in costs if n >= GROWTH_FROM]
    slope = np.polyfit(np.log(large), np.log([costs[n] for n in large]), 1)[0]
    span = f"From N = {large[0]:,} to {large[-1]:,}"
    print(f"\n{span} the cost grows as N to the power of {slope:.2f}.")


PARTS = {"batch": batch, "latency": latency, "marbles": marbles, "growth": growth}


def main(arguments: list[str] | None = None) -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--no-peers", action="store_true", help="leave other engines out")
    asked = parser.parse_args(arguments)
    parts = asked.parts or list(PARTS)
    if unknown := set(parts) - PARTS.keys():
        parser.error(f"expected {', '.join(PARTS)}, found {', '.join(sorted(unknown))}")
    print("\n" + ", ".join(f"{what}: {value}" for what, value in describe_machine().items()))
    for part in parts:
        PARTS[part](with_peers=not asked.no_peers)
    again = [part for part in parts if part in AGAIN_WITHOUT_AVX512]
    lesser = avx2_environment()
    if again and lesser is not None:
        sys.stdout.flush()
        command = [sys.executable, "-m", "benchmarks", *again, "--no-peers"]
        subprocess.run(command, check=True, env=os.environ | lesser)


if __name__ == "__main__":
    main()
