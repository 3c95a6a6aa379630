"""Figures of fitted parameters: heat map of viscosity and damping, profiles over one parameter."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pourcast.comparison.candidates import PAPER, as_columns
from pourcast.pictures.style import (
    BLUE,
    COLUMN,
    GREEN,
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

WATER_IN_HEAD = ("water-ife", "honey-ife-2")
DAMPED = {
    "water-ife": BLUE, "honey-ife-1": ORANGE, "honey-ife-2": GREEN, "water-marble": PURPLE,
    "honey-marble": RED,
}  # fmt: skip
"""The paper's fitted models that have a damping, and their colours."""


def alpha_zeta(scores: pd.DataFrame) -> Figure:
    """Correlation of the uncertain IFE (water in the head) with people, alpha by zeta.

    At the number of particles with the most values of alpha, of those the nearest to the
    paper's 50.

    Parameters
    ----------
    scores
        Table of `comparison.choice.scores_table`.
    """
    ife = scores[scores["model"].isin(WATER_IN_HEAD)]
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
    shown = choice[choice["model"].isin(DAMPED)]
    liquids = list(dict.fromkeys(shown["liquid"]))
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
                colour = DAMPED[str(row.model)]
                axes.plot(along["damping_zeta"], along["r"], color=colour, label=row.model)
                axes.plot(row.damping_zeta, row.r, "o", color=colour, markersize=4)
            axes.set(xlabel="damping zeta [1/s]", title=f"{called(liquid)} trials")
            axes.legend(frameon=False)
        panels[0].set_ylabel("r with people's means")
    return figure


def profiles(scores: pd.DataFrame, choice: pd.DataFrame) -> Figure:
    """Correlation of the models that aren't the paper's along each of their parameters.

    Parameters
    ----------
    scores
        Table of `comparison.choice.scores_table`.
    choice
        Table of `comparison.choice.choice_table`.
    """
    shown = [
        (row, parameter)
        for _, row in choice[~choice["model"].isin(PAPER)].iterrows()
        for parameter in as_columns(dict.fromkeys(row["fitted"].split(", ")))
    ]
    across = min(3, len(shown))
    down = -(-len(shown) // across)
    with mpl.rc_context(RC):
        figure = new_figure(PAGE if across > 1 else COLUMN, 2.2 * down)
        panels = figure.subplots(down, across, squeeze=False).ravel()
        for axes, (row, parameter) in zip(panels, shown, strict=False):
            own = scores[(scores["model"] == row["model"]) & (scores["liquid"] == row["liquid"])]
            best = own.groupby(parameter)["r"].max()
            words = best.index.dtype == object
            places = np.arange(len(best)) if words else best.index.to_numpy()
            chosen = places[list(best.index).index(row[parameter])]
            axes.plot(places, best, "o-" if words else "-", color=BLUE, markersize=2)
            axes.plot(chosen, best[row[parameter]], "o", color=ORANGE, markersize=4)
            if words:
                axes.set_xticks(places, list(best.index))
            axes.set(xlabel=parameter, title=f"{row['model']}, {called(row['liquid'])} trials")
        for axes in panels[len(shown) :]:
            axes.remove()
        panels[0].set_ylabel("r with people's means")
    return figure
