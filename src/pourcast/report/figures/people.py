"""Figures of the participants."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from pourcast.comparison.agreement import Individuals
from pourcast.pictures.style import COLUMN, GREY, PAGE, RC, new_figure
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
