"""Simulations per second: ours, with contacts, beside a hand-written ceiling without them.

    python -m benchmarks.throughput

20,000 steps of 2e-4 s, a batch of 64 scenes with 7 obstacles and a divider. The
ceiling (`ceiling.cpp`, AVX-512 intrinsics, forces only) needs g++ and AVX-512.
"""

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from pourcast.engine.batch import Job, Stepping, available_cores, run_batch
from pourcast.engine.packing import (
    SUPPORT_IN_SPACINGS,
    pack_cylinder,
    reference_density,
    spacing_of,
)
from pourcast.engine.solids import Solids, pack_solids

STEPS = 20_000
BATCH = 64
STEPPING = Stepping(2e-4, 200)
DIVIDER = np.array([[0.45, 0.0], [0.55, 0.0], [0.5, 0.2]])


def scenes(count: int) -> Solids:
    """Random polygons in mid-air, and the divider."""
    rng = np.random.default_rng(0)

    def polygon() -> np.ndarray:
        angles = rng.uniform(0, 6) + 2 * np.pi * np.arange(sides := rng.integers(3, 8)) / sides
        centre, radius = rng.uniform((0.1, 0.4), (0.9, 1.1)), rng.uniform(0.05, 0.09)
        return centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    return pack_solids(
        [[(polygon(), False) for _ in range(7)] + [(DIVIDER, True)] for _ in range(count)]
    )


def jobs(count: int) -> list[Job]:
    """The water case of a whole batch, without an early end."""
    depth = 0.148
    spacing = spacing_of(count, depth / 2, depth)
    support = SUPPORT_IN_SPACINGS * spacing
    position = pack_cylinder(count, (0.5, 1.35), depth / 2, depth)
    common = {
        "position": position, "width": 1.0, "height": 1.5, "depth": depth, "radius": spacing / 2,
        "support_radius": support, "reference_density": reference_density(position, support, depth),
        "sound_speed": 30.0, "viscosity_alpha": 0.01, "damping": 0.0, "duration": STEPS * 2e-4,
        "rim": -1e9,
    }  # fmt: skip
    return [Job(scene=k, **common) for k in range(BATCH)]


def ours(count: int, threads: int) -> float:
    """Simulations per second of the engine, the best of three runs."""
    solids, batch = scenes(BATCH), jobs(count)
    run_batch(batch[:1], solids, Stepping(2e-4, 1), threads=1)
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        run_batch(batch, solids, STEPPING, threads=threads)
        seconds.append(time.perf_counter() - start)
    return BATCH / min(seconds)


def ceiling(count: int) -> float | None:
    """Simulations per second of the C++ program on one core, or None where it can't run."""
    compiler = shutil.which("g++")
    if compiler is None or "avx512f" not in Path("/proc/cpuinfo").read_text():
        return None
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "ceiling"
        source = Path(__file__).with_name("ceiling.cpp")
        command = [compiler, "-O3", "-march=native", "-std=c++17", str(source), "-o", str(program)]
        subprocess.run(command, check=True)
        steps = max(200, STEPS * 50 // count**2 * 2)
        run = [str(program), str(count), str(steps)]
        seconds = [
            float(subprocess.run(run, check=True, capture_output=True, text=True).stdout.split()[0])
            for _ in range(3)
        ]
    return 16 / (min(seconds) / steps * STEPS)


def main() -> None:
    """Print the table in Markdown."""
    cores = available_cores()
    print(
        f"| N | ours / ceiling | {cores} cores / 1 | ours, 1 core [1/s] | ceiling, 1 core [1/s] |"
    )
    print("| --- | --- | --- | --- | --- |")
    for count in (25, 50, 100, 200):
        one, all_cores, top = ours(count, 1), ours(count, cores), ceiling(count)
        ratio, absolute = (f"{one / top:.2f}", f"{top:.1f}") if top else ("-", "-")
        print(f"| {count} | {ratio} | {all_cores / one:.2f} | {one:.1f} | {absolute} |", flush=True)


if __name__ == "__main__":
    main()
