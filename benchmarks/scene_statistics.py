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

from benchmarks.published import WITH_TRUTH_HONEY, WITH_TRUTH_WATER
from pourcast import predict
from pourcast.generate.select import filtered_scenes
from pourcast.generate.voronoi import VoronoiFamily

RIVALS = tuple(WITH_TRUTH_WATER)
TRUTHS = ("truth-water", "truth-honey")


def settings() -> Iterator[VoronoiFamily]:
    """Settings to compare: the default, and one or two changes at a time."""
    default = VoronoiFamily()
    yield default
    for cell_count in (30, 45, 80, 110, 180):
        yield replace(default, cell_count=cell_count)
    for change in (
        {"band_top": 1.1},
        {"band_bottom": 0.5},
        {"band_bottom": 0.6},
        {"wall_gap": 0.06},
        {"liquid_spread": 0.1},
        {"liquid_spread": 0.3},
    ):
        yield replace(default, **change)


def measure(family: VoronoiFamily, count: int, seed: int) -> list[str]:
    """Cells of a table row: acceptance, obstacles, correlations, distance from the paper."""
    selection = filtered_scenes(family, count, seed)
    table = predict(selection.scenes, [*TRUTHS, *RIVALS])
    r = table.pivot(index="scene", columns="model", values="judgment").corr()
    published = {"truth-water": WITH_TRUTH_WATER, "truth-honey": WITH_TRUTH_HONEY}
    errors = [r.loc[m, t] - published[t][m] for t in TRUTHS for m in RIVALS]
    obstacles = np.mean([len(scene.obstacles) for scene in selection.scenes])
    cells = [f"{selection.kept / selection.drawn:.2f}", f"{obstacles:.1f}"]
    cells += [
        f"{r.loc[m, t]:.2f}" for t in TRUTHS for m in ("gravity", "water-simple", "water-marble")
    ]
    cells.append(f"{r.loc['truth-water', 'truth-honey']:.2f}")
    cells.append(f"{np.sqrt(np.mean(np.square(errors))):.3f}")
    return cells


def main() -> None:
    """Print the table, row by row, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--scenes", type=int, default=120)
    parser.add_argument("--seed", type=int, default=101)
    arguments = parser.parse_args()
    heads = ["cells", "band [m]", "wall gap [m]", "spread [m]", "kept", "obstacles"]
    heads += [f"{m} / {t[6:]}" for t in TRUTHS for m in ("gravity", "simple", "marble")]
    heads += ["water / honey truth", "RMS from paper"]
    print(f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}", flush=True)
    for family in settings():
        band = f"{family.band_bottom:g}-{family.band_top:g}"
        row = [str(family.cell_count), band, f"{family.wall_gap:g}", f"{family.liquid_spread:g}"]
        row += measure(family, arguments.scenes, arguments.seed)
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
