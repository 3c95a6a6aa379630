"""Figures of the participants."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pourcast.comparison.agreement import Individuals
from pourcast.pictures.style import (
    BLUE,
    COLUMN,
    GREEN,
    GREY,
    ORANGE,
    PAGE,
    PURPLE,
    RC,
    RED,
    new_figure,
)
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import called, colour_of


def against_null(individuals: Individuals, own: Sequence[Liquid] = ()) -> Figure:
    """Participants' correlations with the truth, beside those of chance.

    Parameters
    ----------
    individuals
        From `comparison.agreement.individuals`; at least one liquid.
    own
        The study's own liquids.
    """
    liquids = list(individuals.against)
    with mpl.rc_context(RC):
        figure = new_figure(COLUMN if len(liquids) == 1 else PAGE, 2.4)
        panels = figure.subplots(1, len(liquids), squeeze=False, sharey=True)[0]
        edges = np.linspace(-1.0, 1.0, 41)
        for axes, liquid in zip(panels, liquids, strict=True):
            found, short = individuals.against[liquid], called(liquid)
            observed = found.observed[np.isfinite(found.observed)]
            for values, colour, label in (
                (found.null[np.isfinite(found.null)], GREY, "chance (beta)"),
                (observed, colour_of(short, own), f"{len(observed)} participants"),
            ):
                weights = np.full(len(values), 1.0 / max(1, len(values)))
                axes.hist(values, edges, weights=weights, alpha=0.65, color=colour, label=label)
            axes.set(xlabel=f"r with the {short} ground truth")
            axes.set_title(
                f"{short}: D = {found.ks_statistic:.2f}, p = {found.ks_p:.2g}\n"
                f"scenes permuted: p = {found.permutation_p:.2g}"
            )
            axes.legend(frameon=False, loc="upper left")
        panels[0].set_ylabel("share")
    return figure


def heads(people: pd.DataFrame) -> Figure:
    """Probability of each model to be in each participant's head, alike participants together.

    Parameters
    ----------
    people
        Table of `comparison.mixture.study_mixture`, of one or more liquids.
    """
    models = [name for name in people.columns if name.startswith("p_")]
    liquids = list(people["liquid"].unique())
    colours = (BLUE, ORANGE, GREEN, PURPLE, RED, GREY)
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 0.6 + 1.7 * len(liquids))
        panels = figure.subplots(len(liquids), 1, squeeze=False)[:, 0]
        for axes, liquid in zip(panels, liquids, strict=True):
            rows = people[people["liquid"] == liquid].fillna(dict.fromkeys(models, 0.0))
            order = rows.sort_values(["model", "probability"], ascending=[True, False])
            below = np.zeros(len(order))
            for number, model in enumerate(models):
                share = order[model].to_numpy()
                hatch = "///" * (number // len(colours))
                axes.bar(
                    np.arange(len(order)), share, 0.9, below, hatch=hatch,
                    color=colours[number % len(colours)], label=model.removeprefix("p_"),
                )  # fmt: skip
                below += share
            axes.set(ylabel="probability", ylim=(0.0, 1.0), title=f"{called(liquid)} trials")
            axes.set_xticks([])
        panels[-1].set_xlabel("participants")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right upper", frameon=False)
    return figure
