"""One simulation in SPlisHSPlasH, in a process of its own: ``python -m benchmarks.splishsplash N``.

Its weakly compressible solver at the paper's step, on one core; the liquid, a block of N
particles, meets the walls of the box only. Prints the seconds that `DURATION` takes.
"""

import ctypes.util
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pourcast.scenes.importers.splishsplash import UNIT_BOX, prism_obj
from pourcast.sweep.bench import DURATION, PAPER_STEP, undamped_jobs

BLOCKS = {25: (4, 3, 2), 50: (5, 5, 2), 100: (5, 5, 4), 200: (5, 8, 5)}
"""Particles along x, y and z; 24 for 25, as it fills no single layer."""


def scene(count: int) -> dict[str, object]:
    """Scene file: the box of our benchmark, and a block of liquid where our cylinder starts."""
    job = undamped_jobs(count)[0]
    # One particle less along each side than spheres would fit.
    size = 2.0 * job.radius * (np.array(BLOCKS[count]) + 1.1)
    centre = np.array([0.5, 1.35, job.depth / 2])
    return {
        "Configuration": {
            "particleRadius": job.radius,
            "gravitation": [0.0, -job.gravity, 0.0],
            "timeStepSize": PAPER_STEP,
            "cflMethod": 0,
            "simulationMethod": 0,
            "boundaryHandlingMethod": 2,
            "stopAt": DURATION,
        },
        "RigidBodies": [
            {
                "geometryFile": "UnitBox.obj",
                "translation": [job.width / 2, job.height / 2, job.depth / 2],
                "scale": [job.width, job.height, job.depth],
                "isDynamic": False,
                "isWall": True,
                "mapInvert": True,
                "mapResolution": [20, 30, 10],
            }
        ],
        "FluidBlocks": [
            {"start": list(centre - size / 2), "end": list(centre + size / 2), "denseMode": 0}
        ],
    }


def run(count: int) -> float:
    """Seconds that the steps of one simulation take, the loading left out."""
    import pysplishsplash as splash

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "UnitBox.obj").write_text(prism_obj(UNIT_BOX, -0.5, 0.5))
        (folder / "scene.json").write_text(json.dumps(scene(count)))
        base = splash.Exec.SimulatorBase()
        base.init(useGui=False, sceneFile=str(folder / "scene.json"), outputDir=str(folder))
        base.initSimulation()
        found = splash.Simulation.getCurrent().getFluidModel(0).numActiveParticles()
        if found != np.prod(BLOCKS[count]):
            raise ValueError(f"SPlisHSPlasH made {found} particles for N = {count}")
        times = [time.perf_counter()]
        base.setTimeStepCB(lambda: times.append(time.perf_counter()))
        base.runSimulation()
    return times[-1] - times[1]


def seconds(count: int, batch: int) -> float:  # noqa: ARG001 (one after the other)
    """What a simulation takes in a process of its own; nan if that fails."""
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    # Its wheel brings a GL dispatcher, and crashes beside the system's: that one first.
    library = ctypes.util.find_library("GLdispatch")
    if library is not None:
        environment["LD_PRELOAD"] = library
    command = [sys.executable, "-m", "benchmarks.splishsplash", str(count)]
    done = subprocess.run(
        command, check=False, capture_output=True, text=True, env=environment,
        cwd=Path(__file__).parents[1],
    )  # fmt: skip
    return float(done.stdout.split()[-1]) if done.returncode == 0 else np.nan


if __name__ == "__main__":
    print(run(int(sys.argv[1])))
