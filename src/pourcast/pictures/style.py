"""What all figures share: size, fonts, colours, the stamp on what is simulated."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

COLUMN = 3.5
"""Width of a journal's column [inch]."""

PAGE = 7.0
"""Width of two columns [inch]."""

BLUE, ORANGE, GREEN, PURPLE, RED, GREY = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#666666",
)  # fmt: skip
"""The palette of Okabe and Ito (2008), which colour-blind readers can tell apart."""

RC: Any = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "pourcast",
    "svg.fonttype": "none",
}

SIMULATED = "simulated observers"

_STAMP_HEIGHT = 0.17
"""Room for the stamp [inch]."""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    return Figure(figsize=(width, height), layout="constrained")


def save_figure(figure: Figure, path: Path, *, simulated: bool) -> list[Path]:
    """Save as SVG and PNG, stamped if observers were simulated; the same figure, the same bytes.

    Parameters
    ----------
    figure
        The figure.
    path
        Where to, without extension.
    simulated
        Whether any data in it are of simulated observers.

    Returns
    -------
    list of Path
        The files written.
    """
    if simulated:
        figure.text(
            0.995, 0.002, SIMULATED, ha="right", va="bottom", fontsize=7, color=RED, gid="stamp"
        )
        figure.set_figheight(figure.get_figheight() + _STAMP_HEIGHT)
        room = _STAMP_HEIGHT / figure.get_figheight()
        engine: Any = figure.get_layout_engine()
        engine.set(rect=(0.0, room, 1.0, 1.0 - room))
    path.parent.mkdir(parents=True, exist_ok=True)
    made = []
    with mpl.rc_context(RC):
        for suffix, metadata in ((".svg", {"Date": None}), (".png", {"Software": None})):
            made.append(path.with_name(path.name + suffix))
            figure.savefig(made[-1], dpi=200, metadata=metadata)
    return made
