"""The kernels say the same in plain Python (NUMBA_DISABLE_JIT=1), where coverage can see them."""

import json
import os
import subprocess
import sys

import pytest

CODE = """
import json
import numpy as np
from pourcast.engine import neighbours
from pourcast.stimuli.lattice_boltzmann.solver import LatticeFlow
from pourcast import HONEY_EXP1, EngineSettings, Pour, WATER, read_scenes, simulate, make_model
scene = read_scenes("examples/ramp.json")[0]
scene = scene.model_copy(update={"liquid": scene.liquid.model_copy(update={"centre": (0.4, 0.945)})})
settings = EngineSettings(max_duration=0.034)
found = []
for pour in (
    Pour(scene, WATER, 4),
    Pour(scene, HONEY_EXP1, 4, 5.0),
    Pour(scene, WATER, 4, kind="marbles"),
):
    found.append(simulate([pour], settings=settings, threads=1)[0].position.tolist())
neighbours.ALL_PAIRS_LIMIT = 3
found.append(simulate([Pour(scene, WATER, 4)], settings=settings)[0].position.tolist())
found.append([p.tolist() for p in make_model("simple:n_points=3,g=0.3").paths(scene)])
solid = np.tril(np.ones((6, 9), dtype=bool), -5)[..., None].repeat(3, axis=2)
fill = np.zeros((6, 9, 3))
fill[1:5, 3:8] = 1.0
fill[5, 8, 1] = 0.4
flow = LatticeFlow(fill * ~solid, solid, cell=0.01, viscosity=1e-4, slip=0.5, adhesion=1.0)
flow.advance(0.012)
found.append(flow.grid("fill").tolist() + flow.grid("density").tolist() + flow.droplets.tolist())
print(json.dumps(found))
"""


def positions(**environment):
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CODE],
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


def flat(values):
    return [v for value in values for v in (flat(value) if isinstance(value, list) else [value])]
