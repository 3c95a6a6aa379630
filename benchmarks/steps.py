"""What the time step changes, beside a displacement of the start that nobody could see.

    python -m benchmarks.steps

prints the table of `docs/explanation/physics.md`, section "The step": 60 scenes of Experiment 1,
against the paper's step of 2e-4 s. A minute on two cores.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.calibration.chaos import moved
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from pourcast.study.experiments.exp1 import EXPERIMENT
from pourcast.study.selection import filtered_scenes

PAPERS = EngineSettings(step=2e-4)

POURS = {
    "water, N = 50, zeta = 5": (WATER, 50, 5.0),
    "honey, N = 50, zeta = 5": (HONEY_EXP1, 50, 5.0),
    "water, N = 200, zeta = 0": (WATER, 200, 0.0),
    "honey, N = 100, zeta = 0": (HONEY_EXP1, 100, 0.0),
}

Judged = NDArray[np.float64]


def judged(
    scenes: Sequence[Scene], of: tuple[Liquid, int, float], settings: EngineSettings
) -> Judged:
    """Judgments by one pour each."""
    pours = [Pour(scene, *of) for scene in scenes]
    return np.array([end.judgment for end in simulate(pours, settings=settings)])


def change(one: Judged, other: Judged) -> str:
    """Mean |dJ| and r."""
    return f"{np.abs(one - other).mean():.3f}, {np.corrcoef(one, other)[0, 1]:.3f}"


def main() -> None:
    """Print the table."""
    rule = EXPERIMENT.choice.rule
    scenes = filtered_scenes(EXPERIMENT.family, 60, 1, rule=rule).scenes
    aside = [moved(scene) for scene in scenes]
    print("| mean \\|dJ\\|, r | step 1e-4 s | step 4e-4 s, or less | start moved by 0.1 mm |")
    print("| --- | --- | --- | --- |")
    for name, of in POURS.items():
        before = judged(scenes, of, PAPERS)
        others = (
            judged(scenes, of, replace(PAPERS, step=1e-4)),
            judged(scenes, of, replace(PAPERS, step=4e-4)),
            judged(aside, of, PAPERS),
        )
        cells = " | ".join(change(one, before) for one in others)
        print(f"| {name} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
