"""The engine beside its ceiling and its peers, and its cost against the number of particles.

    python -m benchmarks

prints tables in Markdown, ratios first, and writes docs/images/speed.png. Takes ten
minutes. What isn't there (g++, Warp, Taichi, JAX, MuJoCo) is left out.
"""

import importlib.util
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pourcast.engine.neighbours import ALL_PAIRS_LIMIT

from benchmarks import ceiling, peers
from pourcast.engine.batch import available_cores, run_batch
from pourcast.engine.simd import LANES
from pourcast.simulation.settings import EngineSettings
from pourcast.sweep.bench import COUNTS, obstacle_courses, speed, undamped_jobs

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "speed.png"
GROWTH_COUNTS = (15, 50, 100, 200, 300, 301, 500, 1000, 2000, 5000)
_GROWTH_DURATION = 0.6


def installed(found: dict[str, peers.Peer]) -> dict[str, peers.Speed]:
    """Peers whose module can be imported."""
    return {name: run for name, (module, run) in found.items() if importlib.util.find_spec(module)}


def liquid_speeds() -> dict[str, list[float]]:
    """Simulations per second at each of `COUNTS`: ours, ceiling, peers."""
    cores = available_cores()
    ours, every, top = "pourcast", f"pourcast, {cores} cores", "ceiling (C++)"
    found: dict[str, list[float]] = {ours: [], every: [], top: []}
    with tempfile.TemporaryDirectory() as folder:
        program = ceiling.build(Path(folder))
        for count in COUNTS:
            # In turns, the best of three: the machine may have other things to do.
            runs = [
                (
                    speed(count, "liquid", ceiling.STEPPING, 1),
                    speed(count, "liquid", ceiling.STEPPING, cores),
                    ceiling.ceiling_speed(program, count) if program else np.nan,
                )
                for _ in range(3)
            ]
            for name, best in zip((ours, every, top), np.max(runs, axis=0), strict=True):
                found[name].append(float(best))
    if program is None:
        del found[top]
    for name, run in installed(peers.LIQUID_PEERS).items():
        found[name] = [run(n) for n in COUNTS]
    return found


def marble_speeds() -> dict[str, list[float]]:
    """The same for marbles, at our default step."""
    stepping = EngineSettings().stepping("marbles", 0.03, 0.0)
    found = {"pourcast": [speed(n, "marbles", stepping, 1) for n in COUNTS]}
    for name, run in installed(peers.MARBLE_PEERS).items():
        found[name] = [run(n) for n in COUNTS]
    return found


def print_ratios(title: str, found: dict[str, list[float]]) -> None:
    """Ours over the others, then simulations per second."""
    heads = "".join(f" N = {n} |" for n in COUNTS)
    print(f"\n**{title}**\n\n| |{heads}\n|{' --- |' * (len(COUNTS) + 1)}")
    for name, speeds in found.items():
        if name != "pourcast":
            ratios = np.array(found["pourcast"]) / np.array(speeds)
            print(f"| ours / {name} |" + "".join(f" {r:.2f} |" for r in ratios))
    for name, speeds in found.items():
        print(f"| {name} [1/s] |" + "".join(f" {s:.3g} |" for s in speeds))


def growth() -> dict[int, float]:
    """Milliseconds per step and simulation against the number of particles, on one core."""
    found = {}
    for count in GROWTH_COUNTS:
        batch = LANES if count <= ALL_PAIRS_LIMIT else 1
        jobs = [replace(job, duration=_GROWTH_DURATION) for job in undamped_jobs(count, batch)]
        run = [jobs, obstacle_courses(batch), ceiling.STEPPING]
        run_batch([replace(jobs[0], duration=1e-3)], *run[1:], threads=1)  # for the compiler
        seconds = []
        for _ in range(3):
            start = time.perf_counter()
            run_batch(*run, threads=1)
            seconds.append(time.perf_counter() - start)
        steps = _GROWTH_DURATION / ceiling.STEPPING.step
        found[count] = 1e3 * min(seconds) / steps / batch
    return found


def plot(found: dict[str, list[float]]) -> None:
    """Speed against N, log-log, the ceiling as a line."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    for name, speeds in found.items():
        style = "k--" if name.startswith("ceiling") else "o-"
        axes.loglog(COUNTS, speeds, style, label=name, markersize=4)
    axes.set(xlabel="particles", ylabel="simulations of 4 s per second")
    axes.set_xticks(COUNTS, [str(n) for n in COUNTS], minor=False)
    axes.set_xticks([], minor=True)
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(PICTURE, dpi=110)


def main() -> None:
    """Measure, print, draw."""
    liquid = liquid_speeds()
    print_ratios("Liquid, 20,000 steps of 2e-4 s; ours on one core", liquid)
    plot(liquid)
    print_ratios("Marbles, 4 s; ours on one core", marble_speeds())
    costs = growth()
    print("\n| N |" + "".join(f" {n} |" for n in costs) + f"\n|{' --- |' * (len(costs) + 1)}")
    print("| ms per step |" + "".join(f" {cost:.3g} |" for cost in costs.values()))
    large = [n for n in costs if n >= 1000]
    slope = np.polyfit(np.log(large), np.log([costs[n] for n in large]), 1)[0]
    span = f"From N = {large[0]:,} to {large[-1]:,}"
    print(f"\n{span} the cost grows as N to the power of {slope:.2f}.")


if __name__ == "__main__":
    main()
