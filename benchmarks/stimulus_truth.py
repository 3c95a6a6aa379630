"""How far the stimuli's solver and the particle engine's ground truths agree.

Makes the table of `docs/reference/stimulus-truth.md`:

    python -m benchmarks.stimulus_truth [scenes] > table.md

Every scene is poured by the lattice-Boltzmann solver at two resolutions, as water and as two
honeys, and judged by the particle engine's ground truths.
"""

import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from pourcast.engine.batch import available_cores
from pourcast.judgments import predict
from pourcast.scene import Scene
from pourcast.stimuli.recipe import FILM_SECONDS, LatticeRecipe
from pourcast.stimuli.solvers.lbm import pour_to_end
from pourcast.study import SceneRequest, generate_scenes

RESOLUTIONS = (100, 150)
LIQUIDS = {
    "water": ("water", {}),
    "honey, the paper's (0.1 Pa s, free slip)": ("honey", {}),
    "honey, held by walls (0.1 Pa s, no slip)": ("honey", {"honey_slip": 0.0}),
}
TRUTHS = ("truth-water", "truth-honey")

Work = tuple[Scene, str, int]


def outcome(work: Work) -> tuple[float, float]:
    """Outcome, and what is stranded, of a pour."""
    scene, name, resolution = work
    liquid, changes = LIQUIDS[name]
    recipe = LatticeRecipe(resolution=resolution, **changes)
    return pour_to_end(scene, liquid, recipe, FILM_SECONDS[liquid])


def main(count: int) -> None:
    scenes = generate_scenes(SceneRequest("exp1", count, 1, 0)).scenes
    table = predict(scenes, list(TRUTHS))
    truths = {
        name: rows.set_index("scene")["judgment"].reindex([s.id for s in scenes]).to_numpy()
        for name, rows in table[table["liquid"] == "water"].groupby("model")
    }
    work = [(s, name, n) for name in LIQUIDS for n in RESOLUTIONS for s in scenes]
    with ProcessPoolExecutor(available_cores()) as pool:
        found = np.array(list(pool.map(outcome, work)))
    outcomes, stranded = found.T.reshape(2, len(LIQUIDS), len(RESOLUTIONS), len(scenes))
    print(f"{len(scenes)} scenes of Experiment 1 (`pourcast scenes exp1 -n {count} --seed 1`).\n")
    head = ["lattice Boltzmann", "cells", *(f"r, {name}" for name in TRUTHS)]
    head += [f"mean difference, {name}" for name in TRUTHS]
    head += ["r, other resolution", "r, water", "mean (SD)", "stranded"]
    print("|", " | ".join(head), "|\n|", " | ".join("---" for _ in head), "|")
    for k, name in enumerate(LIQUIDS):
        for j, resolution in enumerate(RESOLUTIONS):
            own = outcomes[k, j]
            others = [truths[truth] for truth in TRUTHS]
            row = [f"{np.corrcoef(own, other)[0, 1]:.2f}" for other in others]
            row += [f"{np.abs(own - other).mean():.2f}" for other in others]
            row += [f"{np.corrcoef(own, outcomes[k, 1 - j])[0, 1]:.2f}"]
            row += [f"{np.corrcoef(own, outcomes[0, j])[0, 1]:.2f}"]
            row += [f"{own.mean():.2f} ({own.std():.2f})", f"{stranded[k, j].mean():.2f}"]
            print("|", " | ".join([name, str(resolution), *row]), "|", flush=True)
    water, honey = truths["truth-water"], truths["truth-honey"]
    r, difference = np.corrcoef(water, honey)[0, 1], np.abs(water - honey).mean()
    print(f"\nThe ground truths among themselves: r {r:.2f}, mean difference {difference:.2f}.")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
