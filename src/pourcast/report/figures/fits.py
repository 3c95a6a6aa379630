"""Figures of fitted parameters: heat map of viscosity and damping, profiles over one parameter."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

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
from pourcast.scenes.liquids.registry import WATER, called
from pourcast.sweep.judgments import OWN_ALPHA

PAPER_COUNT = 50


def alpha_zeta(scores: pd.DataFrame) -> Figure:
    """Correlation of the uncertain IFE (water in the head) with people, alpha by zeta.

    At the number of particles with the most values of alpha, of those the nearest to the
    paper's 50.

    Parameters
    ----------
    scores
        Table of `comparison.choice.scores_table`.
    """
    ife = scores[scores["model"].isin(["water-ife", "honey-ife-2"])]
    alphas = ife.groupby("n_particles")["viscosity_alpha"].nunique()
    n_particles = min(alphas.index, key=lambda n: (-alphas[n], abs(n - PAPER_COUNT)))
    ife = ife[ife["n_particles"] == n_particles]
    alpha = ife["viscosity_alpha"].map(
        lambda value: WATER.viscosity_alpha if value == OWN_ALPHA else float(value)
    )
    ife = ife.assign(alpha=alpha)
    liquids = list(dict.fromkeys(ife["liquid"]))
    with mpl.rc_context(RC):
        figure = new_figure(PAGE if len(liquids) > 1 else COLUMN, 2.0)
        panels = figure.subplots(1, len(liquids), squeeze=False)[0]
        for axes, liquid in zip(panels, liquids, strict=True):
            wide = ife[ife["liquid"] == liquid].pivot(
                index="alpha", columns="damping_zeta", values="r"
            )
            picture = axes.imshow(wide.to_numpy(), cmap="viridis", aspect="auto", origin="lower")
            row, column = np.unravel_index(np.nanargmax(wide.to_numpy()), wide.shape)
            axes.plot(column, row, "o", markerfacecolor="none", markeredgecolor="white")
            axes.set(title=f"{called(liquid)} trials, N = {n_particles:g}")
            axes.set(xlabel="damping zeta [1/s]", ylabel="viscosity alpha")
            axes.set_yticks(range(len(wide)), [f"{value:g}" for value in wide.index])
            shown = range(0, wide.shape[1], 4)
            axes.set_xticks(shown, [f"{wide.columns[k]:g}" for k in shown])
            figure.colorbar(picture, ax=axes, label="r")
    return figure


def zeta_profiles(scores: pd.DataFrame, choice: pd.DataFrame) -> Figure:
    """Correlation along the damping, the other parameters as chosen; a dot at the choice.

    Parameters
    ----------
    scores
        Table of `comparison.choice.scores_table`.
    choice
        Table of `comparison.choice.choice_table`.
    """
    shown = choice[choice["damping_zeta"].notna()]
    liquids = list(dict.fromkeys(shown["liquid"]))
    colours = dict(
        zip(
            ("water-ife", "honey-ife-1", "honey-ife-2", "water-marble", "honey-marble"),
            (BLUE, ORANGE, GREEN, PURPLE, RED),
            strict=True,
        )
    )
    with mpl.rc_context(RC):
        figure = new_figure(PAGE if len(liquids) > 1 else COLUMN, 2.3)
        panels = figure.subplots(1, len(liquids), squeeze=False, sharey=True)[0]
        for axes, liquid in zip(panels, liquids, strict=True):
            for row in shown[shown["liquid"] == liquid].itertuples():
                along = scores[scores["model"] == row.model]
                along = along[along["n_particles"] == row.n_particles]
                if isinstance(row.viscosity_alpha, str | float) and row.model in (
                    "water-ife", "honey-ife-1", "honey-ife-2",
                ):  # fmt: skip
                    along = along[along["viscosity_alpha"] == row.viscosity_alpha]
                along = along.sort_values("damping_zeta")
                colour = colours.get(str(row.model), GREY)
                axes.plot(along["damping_zeta"], along["r"], color=colour, label=row.model)
                axes.plot(row.damping_zeta, row.r, "o", color=colour, markersize=4)
            axes.set(xlabel="damping zeta [1/s]", title=f"{called(liquid)} trials")
            axes.legend(frameon=False)
        panels[0].set_ylabel("r with people's means")
    return figure
