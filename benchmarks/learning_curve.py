"""What networks reach, and with how many training scenes.

    python -m benchmarks.learning_curve FOLDER [curve] [alexnet] [honey]

trains what is asked (all, by default) in FOLDER, which keeps scenes, labels and networks: the same
command goes on after an interruption. Prints the tables of `docs/reference/convnet.md`, and
writes its figure, `FOLDER/learning-curve.png` and `.svg`. Two hours on two cores in all.
"""

import sys
import time
from pathlib import Path

import matplotlib as mpl
import numpy as np

from pourcast.cli.terminal import progress_bar
from pourcast.networks.network import Card, read_card, read_network
from pourcast.networks.training.data import Draws, drawn_scenes
from pourcast.networks.training.pair import HELD_OUT, NetworkRequest, default_recipe, train_networks
from pourcast.pictures.style import BLUE, COLUMN, GREY, RC, new_figure, save_figure

COUNTS = (500, 1000, 2000, 5000, 10_000)
HONEY = 2500
PUBLISHED = {"water": 0.91, "honey": 0.82}
ALEXNET = {"height": 128, "width": 128, "passes": 8, "learning_rate": 1e-4}
PARTS = ("curve", "alexnet", "honey")


def trained(folder: Path, name: str, request: NetworkRequest) -> Path:
    """The last network of a request; says how long it took."""
    begin = time.monotonic()
    with progress_bar() as report:
        made = train_networks(folder / name, request, data=folder / "data", report=report)
    print(f"{name}: {(time.monotonic() - begin) / 60:.1f} minutes", file=sys.stderr, flush=True)
    return made[-1]


def row(name: str, path: Path) -> str:
    card = read_card(path)
    assert card.held_out is not None
    alone = raw_r(path, card)
    return (
        f"| {name} | {card.scenes:,} | {card.held_out.r:.2f} | {card.held_out.rmse:.2f} | "
        f"{alone:.2f} | {card.held_out.mirror:.3f} | {len(card.epochs)} |"
    )


def raw_r(path: Path, card: Card) -> float:
    """Correlation with the truth of what a network says of the pictures alone."""
    network = read_network(path)
    data = path.parents[1] / "data"
    scenes = drawn_scenes(data, Draws(card.experiment, card.seed, stream="held-out"), HELD_OUT)
    assert card.held_out is not None
    return float(np.corrcoef([network.both(s)[0] for s in scenes], card.held_out.truth)[0, 1])


def curve(folder: Path) -> list[str]:
    paths = {
        n: trained(folder, f"small-{n}", NetworkRequest("exp1", n, 0)) for n in reversed(COUNTS)
    }
    paths = {n: paths[n] for n in COUNTS}
    draw({n: read_card(path) for n, path in paths.items()}, folder / "learning-curve")
    return [row("`convnet-small`, water", path) for path in paths.values()]


def draw(cards: dict[int, Card], path: Path) -> None:
    """The learning curve, with standard errors of r over so many held-out scenes."""
    counts, r = np.array(list(cards)), np.array([card.held_out.r for card in cards.values()])  # type: ignore[union-attr]
    error = 1.96 / np.sqrt(120 - 3)
    low, high = np.tanh(np.arctanh(r) - error), np.tanh(np.arctanh(r) + error)
    with mpl.rc_context(RC):
        figure = new_figure(COLUMN, 2.6)
        axes = figure.add_subplot()
        axes.axhline(PUBLISHED["water"], color=GREY, linewidth=0.7, linestyle=":")
        axes.text(
            counts[0], PUBLISHED["water"] + 0.01, "published: AlexNet, pre-trained", fontsize=6
        )
        axes.errorbar(
            counts, r, [r - low, high - r], marker="o", markersize=4, capsize=2, color=BLUE,
            label="convnet-small, from random weights",
        )  # fmt: skip
        axes.set(
            xscale="log", xlabel="training scenes", ylabel="r with truth, 120 held-out scenes",
            ylim=(0.6, 1.0), xticks=counts, xticklabels=[f"{n:,}" for n in counts],
        )  # fmt: skip
        axes.minorticks_off()
        axes.legend(frameon=False, loc="lower right")
    save_figure(figure, path, simulated=False)


def alexnet(folder: Path) -> list[str]:
    recipe = default_recipe("alexnet", **ALEXNET)
    path = trained(folder, "alexnet", NetworkRequest("exp1", COUNTS[-1], 0, recipe))
    return [row("`alexnet` 128 x 128, from random weights, water", path)]


def honey(folder: Path) -> list[str]:
    tuned = trained(folder, f"small-{COUNTS[-1]}", NetworkRequest("exp1", COUNTS[-1], HONEY))
    return [row("`convnet-small`, honey, fine-tuned from water's", tuned)]


def main() -> None:
    folder, *asked = sys.argv[1:] or sys.exit(__doc__)
    parts = {"curve": curve, "alexnet": alexnet, "honey": honey}
    lines = [line for part in asked or PARTS for line in parts[part](Path(folder))]
    print("| network | training scenes | r | RMSE | r, one picture | mirror | passes |")
    print("| --- | --- | --- | --- | --- | --- | --- |", *lines, sep="\n")


if __name__ == "__main__":
    main()
