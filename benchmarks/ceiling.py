"""A ceiling for the engine: the same work in C++ with vector extensions (`ceiling.cpp`).

Contacts included. Needs g++.
"""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np

from pourcast.engine.batch import Job, Stepping, run_batch
from pourcast.engine.polygons import Solids
from pourcast.engine.simd import LANES
from pourcast.sweep.bench import DURATION, PAPER_STEP, obstacle_courses, undamped_jobs

STEPS = round(DURATION / PAPER_STEP)
STEPPING = Stepping(PAPER_STEP, 200)
FLAGS = ["-O3", "-march=native", "-fno-math-errno", "-ffp-contract=fast", "-std=c++17"]


def numbers(job: Job, solids: Solids) -> str:
    """Input of the C++ program: box, liquid, start, and the polygons of the first 16 scenes."""
    values = [
        len(job.position), job.width, job.depth, job.radius, job.support_radius,
        job.reference_density, job.sound_speed, job.viscosity_alpha, job.gravity, PAPER_STEP,
        *job.position.ravel(),
    ]  # fmt: skip
    for scene in range(LANES):
        polygons = range(solids.scene_start[scene], solids.scene_start[scene + 1])
        values.append(len(polygons))
        for polygon in polygons:
            edges = slice(*solids.polygon_start[polygon : polygon + 2])
            rows = np.column_stack(
                [solids.vertices[edges], solids.normals[edges], solids.lengths[edges]]
            )
            values += [len(rows), *rows.ravel()]
    return "\n".join(f"{float(value):.9g}" for value in values)


def build(folder: Path) -> Path | None:
    """Compile the ceiling, or return None where there is no compiler."""
    compiler = shutil.which("g++")
    if compiler is None:
        return None
    program = folder / "ceiling"
    source = Path(__file__).with_name("ceiling.cpp")
    subprocess.run([compiler, *FLAGS, str(source), "-o", str(program)], check=True)
    return program


def run_ceiling(program: Path, count: int, steps: int) -> tuple[float, float, float]:
    """Seconds that the C++ program takes for 16 simulations; mean x and y at their end."""
    data = program.with_name(f"block-{count}.txt")
    data.write_text(numbers(undamped_jobs(count)[0], obstacle_courses(LANES)))
    run = subprocess.run(
        [str(program), str(data), str(steps)], check=True, capture_output=True, text=True
    )
    seconds, mean_x, mean_y = map(float, run.stdout.split())
    return seconds, mean_x, mean_y


def ceiling_speed(program: Path, count: int) -> float:
    """Simulations of `DURATION` per second on one core; the better of two runs."""
    return LANES / min(run_ceiling(program, count, STEPS)[0] for _ in range(2))


def mean_place(count: int, duration: float) -> tuple[float, float]:
    """Mean x and y of the same 16 simulations in the engine, to see that both do the same."""
    jobs = [replace(job, duration=duration) for job in undamped_jobs(count, LANES)]
    ends = run_batch(jobs, obstacle_courses(LANES), STEPPING)
    x, y, _ = np.mean([end.position for end in ends], axis=(0, 1))
    return float(x), float(y)
