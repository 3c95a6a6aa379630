"""How far the stimuli's solver and the particle engine's ground truths agree.

Makes the table of `docs/reference/stimulus-truth.md`:

    python -m benchmarks.stimulus_truth [scenes] [cells ...] > table.md

Every scene is poured by the lattice-Boltzmann solver at several resolutions (by default 60, 100
and 150 cells), as water and as honey, and judged by the particle engine's ground truths.
"""

import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray

from pourcast.cores import available_cores
from pourcast.prediction import predict
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann, pour_to_end
from pourcast.study.folder import SceneRequest, generate_scenes

Array = NDArray[np.float64]

RESOLUTIONS = (60, 100, 150)
LIQUIDS = ("water", "honey")
STANDARD = 100
"""Resolution with which the others are compared."""
TRUTHS = ("truth-water", "truth-honey")

Key = tuple[str, int]


def outcome(work: tuple[Scene, Key]) -> tuple[float, float]:
    """Outcome, and what is stranded, of a pour."""
    scene, (name, resolution) = work
    liquid = resolve_liquid(name, scene)
    solver = LatticeBoltzmann(resolution=resolution)
    return pour_to_end(scene, liquid, solver, liquid.film_seconds)


def judged(scenes: Sequence[Scene]) -> dict[str, Array]:
    """The ground truths' judgments."""
    table = predict(scenes, list(TRUTHS))
    places = [scene.id for scene in scenes]
    return {
        name: rows.drop_duplicates("scene").set_index("scene")["judgment"][places].to_numpy()
        for name, rows in table.groupby("model")
    }


def r(one: Array, other: Array) -> str:
    return f"{np.corrcoef(one, other)[0, 1]:.2f}"


def difference(one: Array, other: Array) -> str:
    return f"{np.abs(one - other).mean():.2f}"


def main(count: int, resolutions: Sequence[int]) -> None:
    scenes = generate_scenes(SceneRequest("exp1", count, 1)).scenes
    truths = judged(scenes)
    keys = [(name, n) for name in LIQUIDS for n in resolutions]
    with ProcessPoolExecutor(available_cores()) as pool:
        shares = np.array(list(pool.map(outcome, [(s, key) for key in keys for s in scenes])))
    outcomes = dict(zip(keys, shares[:, 0].reshape(len(keys), -1), strict=True))
    stranded = dict(zip(keys, shares[:, 1].reshape(len(keys), -1).mean(axis=1), strict=True))
    print(f"{count} scenes of Experiment 1 (`pourcast scenes exp1 -n {count} --seed 1`).\n")
    head = ["lattice Boltzmann", "cells", *(f"r, {name}" for name in TRUTHS)]
    head += [f"mean difference, {name}" for name in TRUTHS]
    head += [f"r, {STANDARD} cells", "r, water", "mean (SD)", "stranded"]
    print("|", " | ".join(head), "|\n|", " | ".join("---" for _ in head), "|")
    for (name, n), own in outcomes.items():
        row = [r(own, truths[truth]) for truth in TRUTHS]
        row += [difference(own, truths[truth]) for truth in TRUTHS]
        standard = outcomes.get((name, STANDARD))
        row += [r(own, standard) if standard is not None else "", r(own, outcomes["water", n])]
        row += [f"{own.mean():.2f} ({own.std():.2f})", f"{stranded[name, n]:.2f}"]
        print("|", " | ".join([name, str(n), *row]), "|", flush=True)
    water, honey = (truths[name] for name in TRUTHS)
    print(f"\nThe truths among themselves: r {r(water, honey)}, ", end="")
    print(f"mean difference {difference(water, honey)}.")


if __name__ == "__main__":
    scene_count, *cells = (int(word) for word in sys.argv[1:] or ["40"])
    main(scene_count, cells or RESOLUTIONS)
