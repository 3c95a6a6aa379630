"""What networks reach, with how many training scenes, and whether pre-training helps.

    python -m benchmarks.learning_curve FOLDER

trains every backbone on 500, 2,000 and 10,000 scenes of both experiments, for water and, tuned
from it with a quarter of the scenes, for honey. FOLDER keeps scenes, labels (which all share) and
networks: the same command goes on after an interruption. Prints the tables of
`docs/reference/convnet.md`, and writes its figure, `FOLDER/learning-curve.png` and `.svg`.
`--quick --scenes 200 --held-out 60` is a rehearsal.
"""

import argparse
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd

from pourcast.cli.terminal import progress_bar
from pourcast.files import write_text
from pourcast.networks.network import Card, Recipe, read_card
from pourcast.networks.training.data import drawn_scenes, truth_labels
from pourcast.networks.training.pair import QUICK, NetworkRequest, default_recipe, train_networks
from pourcast.pictures.style import BLUE, GREY, ORANGE, PAGE, RC, new_figure, save_figure
from pourcast.progress import Report
from pourcast.statistics.correlation import pearson
from pourcast.statistics.differences import compare_pairs
from pourcast.statistics.jackknife import LEVEL, r_interval
from pourcast.study.experiments.registry import EXPERIMENTS

Array = np.ndarray[Any, np.dtype[np.float64]]

COUNTS = (500, 2000, 10_000)
HELD_OUT = 480
"""Four times the paper's 120 scenes: intervals are half as wide."""

NETWORKS: dict[str, dict[str, Any]] = {
    "lite0": {"backbone": "efficientnet-lite0"},
    "lite0-at-once": {"backbone": "efficientnet-lite0", "stage_passes": 0},
    "lite0-random": {"backbone": "efficientnet-lite0", "start": "random"},
    "small": {"backbone": "convnet-small"},
    "alexnet": {
        "backbone": "alexnet", "height": 128, "width": 128, "passes": 8, "learning_rate": 1e-4,
    },
}  # fmt: skip

TITLES = {
    "lite0": "`efficientnet-lite0`, pre-trained",
    "lite0-at-once": "the same, all layers at once",
    "lite0-random": "`efficientnet-lite0`, random start",
    "small": "`convnet-small`, random start",
    "alexnet": "`alexnet`, 128 x 128, random start",
}

MARKS = {"lite0": (BLUE, "o"), "lite0-at-once": (BLUE, "D"), "lite0-random": (BLUE, "s"),
         "small": (ORANGE, "^"), "alexnet": (GREY, "v")}  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """What is trained, and where."""

    folder: Path
    experiments: tuple[str, ...]
    counts: tuple[int, ...]
    networks: tuple[str, ...]
    held_out: int
    quick: bool
    workers: int | None

    @property
    def data(self) -> Path:
        """Scenes and labels, which all networks share."""
        return self.folder / "data"

    def recipe(self, network: str) -> Recipe:
        """How a network of `NETWORKS` is made."""
        return default_recipe(**{**(QUICK if self.quick else {}), **NETWORKS[network]})

    def request(self, experiment: str, network: str, count: int) -> NetworkRequest:
        """Networks of an experiment's liquids: water's on so many scenes."""
        return NetworkRequest(
            experiment, count, recipe=self.recipe(network), held_out=self.held_out
        )

    def place(self, experiment: str, network: str, count: int) -> Path:
        """Their folder."""
        return self.folder / f"{experiment}-{network}-{count}"


def trained(plan: Plan, report: Report) -> pd.DataFrame:
    """All networks, a row each: what was asked, the card, r with both truths."""
    rows: list[dict[str, Any]] = []
    for experiment in plan.experiments:
        truths = held_out_truths(plan, experiment, report)
        for count in plan.counts:
            for network in plan.networks:
                request = plan.request(experiment, network, count)
                folder = plan.place(experiment, network, count)
                with timed(folder / "minutes.json"):
                    paths = train_networks(
                        folder, request, data=plan.data, workers=plan.workers, report=report
                    )
                minutes = json.loads((folder / "minutes.json").read_text())
                for liquid, path in zip(request.liquids, paths, strict=True):
                    card = read_card(path)
                    asked = {"experiment": experiment, "network": network, "scenes": count}
                    row = {**asked, "liquid": liquid, "card": card, "minutes": minutes}
                    rows.append(row | {"truths": truths, "judgments": judgments(card)})
    return pd.DataFrame(rows)


def held_out_truths(plan: Plan, experiment: str, report: Report) -> dict[str, Array]:
    """The experiment's ground truths of the held-out scenes: not those that label (N = 100).

    Labels of the largest count are made first, so that minutes are those of learning.
    """
    known = EXPERIMENTS.get(experiment)
    most = plan.request(experiment, plan.networks[0], max(plan.counts))
    tell = {"workers": plan.workers, "report": report}
    for liquid in most.liquids:
        scenes = drawn_scenes(plan.data, most.draws, most.count(liquid), report)
        truth_labels(plan.data, scenes, liquid, most.label_spec(liquid), **tell)
    scenes = drawn_scenes(plan.data, most.held_out_draws, plan.held_out, report)
    for liquid in most.liquids:
        truth_labels(plan.data, scenes, liquid, most.label_spec(liquid), **tell)
    return {
        liquid: truth_labels(plan.data, scenes, liquid, known.truth(liquid), **tell)
        for liquid in most.liquids
    }


@contextmanager
def timed(path: Path) -> Iterator[None]:
    """Add the processor time of what is done within to that of earlier tries [minutes]."""
    before = json.loads(path.read_text()) if path.is_file() else 0.0
    begin = time.process_time()
    try:
        yield
    finally:
        if path.parent.is_dir():
            write_text(path, f"{before + (time.process_time() - begin) / 60:.2f}\n")


def judgments(card: Card) -> Array:
    assert card.held_out is not None
    return np.array(card.held_out.judgments)


def with_interval(one: Array, other: Array) -> str:
    """Pearson's r, and its 95 % interval over scenes."""
    low, high = r_interval(one[None], other[None], "scenes", LEVEL)
    return f"{float(pearson(one, other[None])[0]):.2f} [{low[0]:.2f}, {high[0]:.2f}]"


def main_table(found: pd.DataFrame) -> list[str]:
    """A row for each network, beside the paper's r with both truths."""
    heads = ["experiment", "liquid", "network", "scenes", "r with water truth",
             "r with honey truth", "RMSE", "mirror", "passes", "minutes"]  # fmt: skip
    lines = [heads, ["---"] * len(heads)]
    order = found.sort_values(["experiment", "liquid"], kind="stable", ascending=[True, False])
    for row in order.itertuples():
        card = row.card
        lines.append([
            row.experiment, row.liquid, TITLES[row.network], f"{card.scenes:,}",
            *(with_interval(truth, row.judgments) for truth in row.truths.values()),
            f"{card.held_out.rmse:.2f}", f"{card.held_out.mirror:.3f}", str(len(card.epochs)),
            f"{row.minutes:.1f}",
        ])  # fmt: skip
    return [f"| {' | '.join(line)} |" for line in lines]


def help_table(found: pd.DataFrame) -> list[str]:
    """How much nearer the pre-trained network is to its truth than each other, per row."""
    others = [name for name in found["network"].unique() if name != "lite0"]
    if not others or "lite0" not in set(found["network"]):
        return []
    heads = ["experiment", "liquid", "scenes", *(f"minus {TITLES[name]}" for name in others)]
    lines = [heads, ["---"] * len(heads)]
    asked = ["experiment", "liquid", "scenes"]
    for (experiment, liquid, _), rows in found.groupby(asked, sort=False):
        said = rows.set_index("network")["judgments"]
        first = rows.iloc[0]
        gains = [gain(first["truths"][liquid], said["lite0"], said[name]) for name in others]
        lines.append([experiment, liquid, f"{first['card'].scenes:,}", *gains])
    return [f"| {' | '.join(line)} |" for line in lines]


def gain(truth: Array, one: Array, other: Array) -> str:
    """Difference of two networks' r with the truth on the same scenes, with its interval."""
    pair = compare_pairs(truth[None], np.stack([one, other]), "scenes")
    low, high = (float(limit[0]) for limit in pair.interval(LEVEL))
    return f"{float(pair.difference[0]):+.2f} [{low:+.2f}, {high:+.2f}]"


def draw(found: pd.DataFrame, path: Path) -> None:
    """The learning curves, a panel for each experiment and liquid."""
    panels = list(found.groupby(["experiment", "liquid"], sort=False))
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 2.6 * ((len(panels) + 1) // 2))
        for k, ((experiment, liquid), rows) in enumerate(panels, start=1):
            axes = figure.add_subplot((len(panels) + 1) // 2, min(2, len(panels)), k)
            for name, own in rows.groupby("network", sort=False):
                scenes = [card.scenes for card in own["card"]]
                r = [float(pearson(t[liquid], j[None])[0]) for t, j in
                     zip(own["truths"], own["judgments"], strict=True)]  # fmt: skip
                colour, mark = MARKS[name]
                style = "-" if name == "lite0" else "--"
                title = TITLES[name].replace("`", "")
                axes.plot(scenes, r, style, color=colour, marker=mark, markersize=4, label=title)
            published = EXPERIMENTS.get(experiment).published
            if published is not None:
                r = published.with_truth[f"truth-{liquid}"][f"{liquid}-convnet"]
                axes.axhline(r, color=GREY, linewidth=0.7, linestyle=":", label="published")
            ticks = sorted({card.scenes for card in rows["card"]})
            axes.set(
                xscale="log", title=f"{experiment}, {liquid}", xlabel="training scenes",
                ylabel="r with truth", xticks=ticks, xticklabels=[f"{n:,}" for n in ticks],
            )  # fmt: skip
            axes.minorticks_off()
            if k == 1:
                axes.legend(frameon=False, loc="lower right")
    save_figure(figure, path, simulated=False)


def arguments() -> Plan:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = partial(parser.add_argument, nargs="+")
    parser.add_argument("folder", type=Path)
    add("--experiments", default=["exp1", "exp2"])
    add("--scenes", type=int, default=COUNTS, help="training scenes of the water networks")
    add("--networks", default=list(NETWORKS), choices=NETWORKS)
    parser.add_argument("--held-out", type=int, default=HELD_OUT)
    parser.add_argument("--quick", action="store_true", help="fewer passes")
    parser.add_argument("--workers", type=int)
    got = parser.parse_args()
    return Plan(
        got.folder, tuple(got.experiments), tuple(got.scenes), tuple(got.networks), got.held_out,
        got.quick, got.workers,
    )  # fmt: skip


def main() -> None:
    plan = arguments()
    with progress_bar() as report:
        found = trained(plan, report)
    draw(found, plan.folder / "learning-curve")
    print(*main_table(found), "", *help_table(found), sep="\n")


if __name__ == "__main__":
    main()
