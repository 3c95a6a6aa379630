"""How a network learned, and how well it does, in one picture."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from pourcast.files import replacing
from pourcast.networks.network import Card, HeldOut
from pourcast.pictures.style import GREY, PAGE, RC, new_figure
from pourcast.scenes.liquids.registry import colour_of


def draw_card(path: Path, card: Card) -> None:
    """Draw what a card says.

    Parameters
    ----------
    path
        The picture (.png).
    card
        The card of a trained network.
    """
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 3.2)
        left, right = figure.subplots(1, 2, width_ratios=(3, 2))
        _draw_learning(left, card)
        if card.held_out is not None:
            _draw_held_out(right, card.held_out, colour_of(card.liquid))
        first = card.first_weights.partition(",")[0].partition(" (")[0]
        first += " weights" if first in ("random", "ImageNet's") else ""
        figure.suptitle(
            f"{card.experiment}, {card.liquid}: {card.recipe.backbone} from {first}, "
            f"{card.scenes} scenes",
            fontsize=9,
        )
        with replacing(path) as temporary:
            figure.savefig(temporary, dpi=150, metadata={"Software": None})


def _draw_learning(axes: Any, card: Card) -> None:
    passes = np.arange(1, len(card.epochs) + 1)
    colour = colour_of(card.liquid)
    rmse = np.sqrt([epoch.loss for epoch in card.epochs])
    axes.plot(passes, rmse, ".-", color=GREY, linewidth=1, label="training")
    axes.plot(
        passes, [epoch.validation_rmse for epoch in card.epochs], ".-", color=colour,
        linewidth=1, label="validation",
    )  # fmt: skip
    stages = [epoch.stage for epoch in card.epochs]
    for place in np.flatnonzero(np.diff(stages)):
        axes.axvline(place + 1.5, color=GREY, linewidth=0.5, linestyle=":")
    title = "dotted lines: more layers begin to learn" if len(set(stages)) > 1 else ""
    axes.set(xlabel="passes through the training scenes", ylabel="error (RMSE)", title=title)
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False)


def _draw_held_out(axes: Any, held_out: HeldOut, colour: str) -> None:
    axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.7, linestyle=":")
    axes.plot(held_out.judgments, held_out.truth, "o", markersize=3, alpha=0.7, color=colour)
    r = "-" if held_out.r is None else f"{held_out.r:.2f}"
    axes.set(
        xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), aspect="equal", xlabel="network",
        ylabel="ground truth", title=f"{held_out.scenes} held-out scenes: r = {r}",
    )  # fmt: skip
