"""A ceiling for the engine: the same work in C++ with vector extensions (`ceiling.cpp`).

Contacts included. Needs g++ or clang++; of several programs the fastest counts.
"""

import shutil
import subprocess
import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import llvmlite.binding
import numpy as np

from pourcast.engine.batch import run_batch
from pourcast.engine.job import Job, Stepping
from pourcast.engine.polygons import Solids
from pourcast.sweep.bench import DURATION, PAPER_STEP, obstacle_courses, undamped_jobs
from pourcast.sweep.machine import vector_instructions

SCENES = 16
"""Simulations of a run, whatever the number of lanes; `ceiling.cpp` has it too."""
STEPS = round(DURATION / PAPER_STEP)
STEPPING = Stepping(PAPER_STEP, 200)
COMPILERS = ("g++", "clang++")
FLAGS = ("-O3", "-fno-math-errno", "-ffp-contract=fast", "-std=c++17")


def numbers(job: Job, solids: Solids) -> str:
    """Input of the C++ program: box, liquid, start, and the polygons of each scene."""
    values = [
        len(job.position), job.width, job.depth, job.radius, job.support_radius,
        job.reference_density, job.sound_speed, job.viscosity_alpha, job.gravity, PAPER_STEP,
        *job.position.ravel(),
    ]  # fmt: skip
    for scene in range(SCENES):
        polygons = range(solids.scene_start[scene], solids.scene_start[scene + 1])
        values.append(len(polygons))
        for polygon in polygons:
            edges = slice(*solids.polygon_start[polygon : polygon + 2])
            rows = np.column_stack(
                [solids.vertices[edges], solids.normals[edges], solids.lengths[edges]]
            )
            values += [len(rows), *rows.ravel()]
    return "\n".join(f"{float(value):.9g}" for value in values)


def build(folder: Path) -> dict[str, Path]:
    """Programs by compiler and lanes, for the vectors that our kernels use too.

    None without a compiler. Eight lanes of AVX-512 leave more pairs out than sixteen.
    """
    vectors = vector_instructions()
    has_more = bool(llvmlite.binding.get_host_cpu_features().get("avx512f"))
    if vectors == "AVX2" and has_more:
        target = "-march=haswell"  # the machine is taken for a lesser one
    else:
        target = "-mcpu=native" if vectors == "NEON" else "-march=native"
    lanes = {"AVX-512": (16, 8), "AVX2": (8,), "AVX": (8,)}.get(vectors, (4,))
    source, programs = Path(__file__).with_name("ceiling.cpp"), {}
    for compiler, count in product(filter(shutil.which, COMPILERS), lanes):
        program = folder / f"ceiling-{compiler}-{count}"
        command = [compiler, *FLAGS, target, f"-DLANES={count}", str(source), "-o", str(program)]
        subprocess.run(command, check=True, capture_output=True)
        programs[f"{compiler}, {count} lanes"] = program
    return programs


def run_ceiling(program: Path, count: int, steps: int) -> tuple[float, float, float]:
    """Processor seconds of the C++ program for `SCENES` simulations; mean x and y at their end."""
    data = program.with_name(f"scenes-{count}.txt")
    if not data.exists():
        data.write_text(numbers(undamped_jobs(count)[0], obstacle_courses(SCENES)))
    run = subprocess.run(
        [str(program), str(data), str(steps)], check=True, capture_output=True, text=True
    )
    seconds, mean_x, mean_y = map(float, run.stdout.split())
    return seconds, mean_x, mean_y


def run_engine(count: int, steps: int) -> tuple[float, float, float]:
    """The same of the engine, on one thread."""
    duration = steps * PAPER_STEP
    jobs = [replace(job, duration=duration) for job in undamped_jobs(count, SCENES)]
    start = time.process_time()
    ends = run_batch(jobs, obstacle_courses(SCENES), STEPPING, threads=1)
    seconds = time.process_time() - start
    x, y, _ = np.mean([end.position for end in ends], axis=(0, 1))
    return seconds, float(x), float(y)
