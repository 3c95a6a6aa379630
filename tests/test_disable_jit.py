"""The kernels say the same in plain Python (NUMBA_DISABLE_JIT=1), where coverage can see them."""

import json
import os
import subprocess
import sys

import pytest

CODE = """
import json
import numpy as np
from pourcast.engine import batch
from pourcast.stimuli.lattice_boltzmann.solver import LatticeFlow
from pourcast import HONEY_EXP1, EngineSettings, Pour, WATER, read_scenes, simulate, make_model
scene = read_scenes("examples/ramp.json")[0]
scene = scene.model_copy(update={"liquid": scene.liquid.model_copy(update={"centre": (0.4, 0.945)})})
settings = EngineSettings(max_duration=0.034)
found = []
batch.lanes_worth = lambda count: 0.0
for pour in (
    Pour(scene, WATER, 4),
    Pour(scene, HONEY_EXP1, 4, 5.0),
    Pour(scene, WATER, 4, kind="marbles"),
):
    found.append(simulate([pour], settings=settings, threads=1)[0].position.tolist())
batch.lanes_worth = lambda count: np.inf
found.append(simulate([Pour(scene, WATER, 4)], settings=settings)[0].position.tolist())
found.append([p.tolist() for p in make_model("simple:n_points=3,g=0.3").paths(scene)])
found.append(make_model("blobs:n_molecules=12").film(scene)[0].tolist())
solid = np.tril(np.ones((6, 9), dtype=bool), -5)[..., None].repeat(3, axis=2)
fill = np.zeros((6, 9, 3))
fill[1:5, 3:8] = 1.0
fill[5, 8, 1] = 0.4
flow = LatticeFlow(fill * ~solid, solid, cell=0.01, viscosity=1e-4, slip=0.5, adhesion=1.0)
flow.advance(0.012)
found.append(flow.grid("fill").tolist() + flow.grid("density").tolist() + flow.droplets.tolist())
print(json.dumps(found))
"""


FAULTS = """
import json
import numpy as np
from pourcast.engine import batch
from pourcast.engine.batch import run_batch
from pourcast.engine.job import Stepping
from pourcast.errors import SimulationDivergedError
from pourcast.stimuli.lattice_boltzmann.solver import LatticeFlow
from tests.make import NO_SOLIDS, job
rng = np.random.default_rng(0)
found = []
def tried(call):
    try:
        call()
        found.append("no error")
    except SimulationDivergedError as error:
        found.append(str(error).split("; ")[0])
for worth, kind in ((0.0, "liquid"), (np.inf, "liquid"), (0.0, "marbles")):
    batch.lanes_worth = lambda count, worth=worth: worth
    for value in (np.nan, np.inf, 1e30, 1e3, 0.1):
        velocity = np.zeros((5, 3), np.float32)
        velocity[2, 1] = value
        one = job(rng.uniform(0.04, 0.12, (5, 3)) + [0.3, 0.5, 0.0], velocity=velocity)
        tried(lambda: run_batch([one], NO_SOLIDS, Stepping(2e-4, 3), kind=kind, threads=1))
    one = job(rng.uniform(0.04, 0.12, (5, 3)) + [0.3, 0.5, 0.0], damping=5e5)
    tried(lambda: run_batch([one], NO_SOLIDS, Stepping(2e-4, 30), kind=kind, threads=1))
for fault in ("none", "speed", "mass"):
    fill = np.zeros((5, 6, 3))
    fill[:, :3] = 1.0
    flow = LatticeFlow(fill, np.zeros((5, 6, 3), dtype=bool), cell=0.01, viscosity=1e-4, time_step=1e-4)
    if fault == "speed":
        flow._cells.velocity[1, flow.active[3]] = np.nan
        flow._cells.populations[:, flow.active[3]] = np.nan
    if fault == "mass":
        flow._parts.owed[0] -= 1.0
    tried(lambda: flow.advance(2e-3))
print(json.dumps(found))
"""


def positions(code=CODE, **environment):
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        capture_output=True, text=True, check=False, env=os.environ | environment,
        cwd=os.path.dirname(os.path.dirname(__file__)),
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_plain_python_agrees_with_compiled_kernels():
    plain = positions(NUMBA_DISABLE_JIT="1")
    compiled = positions(NUMBA_DISABLE_JIT="0")
    for one, other in zip(plain, compiled, strict=True):
        for a, b in zip(one, other, strict=True):
            assert flat(a) == pytest.approx(flat(b), abs=2e-6)


def test_broken_simulations_raise_in_plain_python_as_in_compiled_kernels():
    plain = positions(FAULTS, NUMBA_DISABLE_JIT="1")
    compiled = positions(FAULTS, NUMBA_DISABLE_JIT="0")
    assert plain == compiled
    for back_end in (compiled[:6], compiled[6:12], compiled[12:18]):
        assert back_end[4] == "no error"
        assert "no error" not in back_end[:4] + back_end[5:]
    sound, speed, mass = compiled[18:]
    assert sound == "no error"
    assert "no finite number" in speed
    assert "its volume was" in mass


def flat(values):
    return [v for value in values for v in (flat(value) if isinstance(value, list) else [value])]
