"""Speed of the stimuli's solver, beside what the machine's memory allows.

Makes the table of `docs/explanation/stimuli.md`:

    python -m benchmarks.lattice > table.md

MLUPS are millions of lattice updates (cells times steps) a second. A cell reads and writes 19
populations of 4 bytes, and what is written is read first (write allocate): 228 bytes.
"""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from pourcast.pictures.demo import demo_scenes
from pourcast.scenes.liquids.registry import WATER
from pourcast.stimuli.lattice_boltzmann.solver import LatticeFlow, LatticeSettings
from pourcast.stimuli.lattice_boltzmann.voxels import voxelise
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann, start_flow

BYTES_PER_UPDATE = 3 * 19 * 4
SIDE = 100
RESOLUTIONS = (60, 100, 150, 200)
REPEATS = 3


def copied_bytes(threads: int) -> float:
    """Bytes a second that pass the memory when arrays are copied, write allocate included."""
    sources = np.ones((threads, 20_000_000))
    targets = np.zeros_like(sources)
    with ThreadPoolExecutor(threads) as pool:

        def copy_all() -> float:
            begin = time.perf_counter()
            list(pool.map(lambda k: np.copyto(targets[k], sources[k]), range(threads)))
            return time.perf_counter() - begin

        return 1.5 * 2 * sources.nbytes / min(copy_all() for _ in range(2 * REPEATS))


def updates_per_second(flow: LatticeFlow, seconds: float) -> float:
    """Lattice updates a second over some time of the liquid's."""
    before, begin = flow.updates, time.perf_counter()
    flow.advance(flow.time + seconds)
    return (flow.updates - before) / (time.perf_counter() - begin)


def full_box(threads: int) -> float:
    """Lattice updates a second in a box full of liquid."""
    shape = (SIDE, SIDE, SIDE)
    flow = LatticeFlow(
        np.ones(shape), np.zeros(shape, dtype=bool), cell=0.01, viscosity=1e-4, time_step=1e-3,
        settings=LatticeSettings(threads=threads),
    )  # fmt: skip
    flow.advance(0.002)
    return max(updates_per_second(flow, 0.01) for _ in range(REPEATS))


def whole_pour(resolution: int, threads: int) -> tuple[float, float]:
    """Seconds for 4 s of water, and lattice updates a second."""
    scene, solver = demo_scenes()[0], LatticeBoltzmann(resolution=resolution)
    flow = start_flow(scene, WATER, solver, voxelise(scene, resolution), threads)
    begin = time.perf_counter()
    rate = updates_per_second(flow, 4.0)
    return time.perf_counter() - begin, rate


def main() -> None:
    print("| | 1 core | 2 cores |\n| --- | --- | --- |")
    limits = [copied_bytes(n) / BYTES_PER_UPDATE for n in (1, 2)]
    print("| memory's limit [MLUPS] |", " | ".join(f"{r / 1e6:.0f}" for r in limits), "|")
    rates = [full_box(n) for n in (1, 2)]
    print(
        f"| box of {SIDE} x {SIDE} x {SIDE} full cells [MLUPS] |",
        " | ".join(f"{rate / 1e6:.1f}" for rate in rates),
        "|",
    )
    for resolution in RESOLUTIONS:
        found = [whole_pour(resolution, n) for n in (1, 2)]
        cells = " | ".join(f"{seconds:.1f} s, {rate / 1e6:.1f} MLUPS" for seconds, rate in found)
        print(f"| 4 s of water, resolution {resolution} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
