"""How far a point's judgments hang on next to nothing: the start is moved by a tenth of a mm."""

import json
from pathlib import Path

import numpy as np

from benchmarks.calibration.measure import LIQUID_OF, parameters_of, read_json
from benchmarks.calibration.space import HONEY_NAME, Point, World, world
from pourcast.files import write_text
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate

SHIFT = 1e-4
"""[m]"""

DONE = "chaos.json"


def mean_changes(point: Point, folder: Path) -> dict[str, float]:
    """Mean change of a judgment by one pour, over a point's scenes, when the start is moved.

    Parameters
    ----------
    point
        The point.
    folder
        Where it was measured: its scenes are there, and the result is kept there.

    Returns
    -------
    dict
        Model that pours -> mean |dJ|.
    """
    done = folder / DONE
    if not done.exists():
        here, scenes = world(point), read_scenes(folder / "scenes.json")
        found = {name: _mean_change(here, name, scenes) for name in LIQUID_OF}
        write_text(done, json.dumps(found) + "\n")
    return read_json(done)


def _mean_change(here: World, name: str, scenes: list[Scene]) -> float:
    given = parameters_of(name)
    liquid = here.honey if LIQUID_OF[name] == HONEY_NAME else here.water
    pours = [
        Pour(scene, liquid, given["n_particles"], given["damping_zeta"])
        for one in scenes
        for scene in (one, moved(one))
    ]
    judged = np.array([outcome.judgment for outcome in simulate(pours, settings=here.engine)])
    return float(np.abs(np.diff(judged.reshape(-1, 2))).mean())


def moved(scene: Scene, shift: float = SHIFT) -> Scene:
    """The scene, its start moved to the right by so many metres."""
    x, y = scene.liquid.centre
    start = scene.liquid.model_copy(update={"centre": (x + shift, y)})
    return scene.model_copy(update={"liquid": start})
