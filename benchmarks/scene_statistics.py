"""Search the statistics of Experiment 1's scenes that the paper leaves open.

For each setting of the generator, scenes are drawn and filtered, and models
are correlated with both ground truths over them. The published correlations
say how the original scenes must have been. Run with

    python -m benchmarks.scene_statistics

and paste the table into docs/explanation/scene-statistics.md.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from pourcast import predict
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.study.experiments.exp1 import PUBLISHED
from pourcast.study.selection import CoarseFilter, filtered_scenes

RIVALS = ("gravity", "water-simple", "honey-simple")
"""Cheap enough for many scenes. MarbleSim hardly moves with the scenes."""

TRUTHS = ("truth-water", "truth-honey")


def settings() -> Iterator[tuple[VoronoiFamily, CoarseFilter]]:
    """Settings to compare: the default, and one change at a time."""
    family, rule = VoronoiFamily(), CoarseFilter()
    yield family, rule
    for change in (
        {"cell_count": 30},
        {"cell_count": 45},
        {"cell_count": 90},
        {"cell_count": 130},
        {"liquid_spread": 0.0},
        {"liquid_spread": 0.1},
        {"liquid_spread": 0.2},
        {"band_bottom": 0.5},
        {"band_top": 1.1},
        {"wall_gap": 0.06},
    ):
        yield replace(family, **change), rule
    for min_touched in (0.2, 0.5):
        yield family, replace(rule, min_touched=min_touched)


def measure(family: VoronoiFamily, rule: CoarseFilter, count: int, seed: int) -> list[str]:
    """Cells of a table row: acceptance, obstacles, correlations, distance from the paper."""
    selection = filtered_scenes(family, count, seed, rule=rule)
    table = predict(selection.scenes, [*TRUTHS, *RIVALS])
    r = table.pivot(index="scene", columns="model", values="judgment").corr()
    published = PUBLISHED.with_truth
    errors = [r.loc[m, t] - published[t][m] for t in TRUTHS for m in RIVALS]
    obstacles = np.mean([len(scene.obstacles) for scene in selection.scenes])
    cells = [f"{selection.kept / selection.drawn:.2f}", f"{obstacles:.1f}"]
    cells += [f"{r.loc[m, t]:.2f}" for t in TRUTHS for m in RIVALS]
    cells.append(f"{r.loc['truth-water', 'truth-honey']:.2f}")
    cells.append(f"{np.sqrt(np.mean(np.square(errors))):.2f}")
    return cells


def main() -> None:
    """Print the table, row by row, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--scenes", type=int, default=300)
    parser.add_argument("--seed", type=int, default=101)
    arguments = parser.parse_args()
    heads = ["cells", "band [m]", "wall gap [m]", "spread [m]", "touched", "kept", "obstacles"]
    heads += [f"{m} / {t[6:]}" for t in TRUTHS for m in RIVALS]
    heads += ["water / honey", "RMS from paper"]
    print(f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}", flush=True)
    for family, rule in settings():
        band = f"{family.band_bottom:g}-{family.band_top:g}"
        row = [str(family.cell_count), band, f"{family.wall_gap:g}", f"{family.liquid_spread:g}"]
        row += [f"{rule.min_touched:g}"]
        row += measure(family, rule, arguments.scenes, arguments.seed)
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
