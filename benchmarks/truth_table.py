"""Table of every model against both ground truths, beside the published columns.

    python -m benchmarks.truth_table > docs/reference/models-against-truth.md

makes the page: 120 scenes of Experiment 1, seed 1, the scenes of
`pourcast scenes exp1 -n 120 --seed 1`.
"""

import argparse

import numpy as np

from pourcast import predict, summarise
from pourcast.models.registry import complete_presets
from pourcast.statistics.jackknife import LEVEL, r_interval
from pourcast.study.experiments.exp1 import PUBLISHED
from pourcast.study.folder import SceneRequest, generate_scenes

HEAD = """# Every model against both ground truths

Made by `python -m benchmarks.truth_table` on {count} scenes of Experiment 1 (`pourcast scenes exp1
-n {count} --seed {seed}`). Pearson r over the scenes; in brackets the 95 % interval over
*scenes*. The published columns are those of Bates et al. (2019), over
their 120 scenes, which are not public: ours resemble them only as far as
[the generator](../explanation/open-choices.md) does. The paper gives no value for the IFEs.

| model | mean J | r with truth, water | published | r with truth, honey | published |
| --- | --- | --- | --- | --- | --- |"""


def interval(a: np.ndarray, b: np.ndarray) -> str:
    """95 % interval of a correlation over scenes."""
    low, high = r_interval(b[None], a[None], "scenes", LEVEL)
    return f"[{low[0]:.2f}, {high[0]:.2f}]"


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", "--scenes", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    request = SceneRequest("exp1", arguments.scenes, arguments.seed)
    scenes = generate_scenes(request).scenes
    table = predict(scenes, complete_presets())
    wide = table.pivot(index="scene", columns="model", values="judgment")
    means = summarise(table)["mean"]
    print(HEAD.format(count=arguments.scenes, seed=arguments.seed))
    for name in complete_presets():
        cells = [f"`{name}`", f"{means[name]:.2f}"]
        for truth, published in PUBLISHED.with_truth.items():
            a, b = wide[name].to_numpy(), wide[truth].to_numpy()
            same = name == truth
            cells.append("1" if same else f"{np.corrcoef(a, b)[0, 1]:.2f} {interval(a, b)}")
            cells.append(f"{published[name]:.2f}" if name in published else "")
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
