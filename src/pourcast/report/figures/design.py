"""Figures of what a design could tell apart: recovery and power."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pourcast.pictures.style import BLUE, COLUMN, GREEN, ORANGE, PURPLE, RC, RED, new_figure


def recovery(table: pd.DataFrame, title: str) -> Figure:
    """Confusion matrix: what was planted, and what was recovered.

    Parameters
    ----------
    table
        From `comparison.recovery`: planted in rows, recovered in columns.
    title
        What was planted.
    """
    shares = table.drop(columns=["within_one_step", "told"], errors="ignore")
    numeric = all(isinstance(name, int | float | np.number) for name in shares.columns)
    with mpl.rc_context(RC):
        size = max(COLUMN, 1.4 + (0.2 if numeric else 0.28) * len(shares))
        figure = new_figure(size, size * 0.92)
        axes = figure.add_subplot()
        picture = axes.imshow(shares.to_numpy(), cmap="viridis", vmin=0.0, vmax=1.0)
        places = range(len(shares))
        axes.set_xticks(places, [_word(name) for name in shares.columns])
        axes.set_yticks(places, _planted(table))
        if not numeric:
            axes.set_xticklabels(axes.get_xticklabels(), rotation=60, ha="right")
        for (i, j), share in np.ndenumerate(shares.to_numpy()):
            if share >= 0.05 and len(shares) <= 14:
                colour = "black" if share > 0.6 else "white"
                axes.text(
                    j, i, f"{100 * share:.0f}", ha="center", va="center", color=colour, fontsize=6
                )
        axes.set(xlabel="recovered", ylabel="planted")
        figure.suptitle(title, fontsize=RC["axes.titlesize"])
        figure.colorbar(picture, ax=axes, shrink=0.8, label="share of simulated studies")
    return figure


def _planted(table: pd.DataFrame) -> list[str]:
    """What was planted; with how often it was told from all others, if that is known."""
    words = [_word(name) for name in table.index]
    if "told" not in table:
        return words
    return [
        f"{word} (told {100 * share:.0f} %)"
        for word, share in zip(words, table["told"], strict=True)
    ]


def _word(name: object) -> str:
    return f"{name:g}" if isinstance(name, int | float | np.number) else str(name)


def power(table: pd.DataFrame, title: str) -> Figure:
    """Power against the number of participants, a line for each number of scenes.

    Parameters
    ----------
    table
        From `comparison.recovery.power_table`.
    title
        What is told apart.
    """
    with mpl.rc_context(RC):
        figure = new_figure(COLUMN, 2.6)
        axes = figure.add_subplot()
        colours = (BLUE, ORANGE, GREEN, PURPLE, RED)
        for number, (scenes, rows) in enumerate(table.groupby("scenes")):
            error = [rows["power"] - rows["low"], rows["high"] - rows["power"]]
            axes.errorbar(
                rows["observers"], rows["power"], np.abs(np.array(error)), marker="o",
                markersize=3, capsize=2, linewidth=1, color=colours[number % len(colours)],
                label=f"{scenes} scenes",
            )  # fmt: skip
        axes.axhline(0.8, color="black", linewidth=0.5, linestyle=":")
        axes.set(xlabel="participants", ylabel="power", ylim=(-0.02, 1.02), title=title)
        axes.legend(frameon=False)
    return figure
