"""A multiverse: what every analysis finds, in one figure."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pourcast.comparison.multiverse import FINDINGS, NO_RULE
from pourcast.pictures.style import BLUE, GREY, PAGE, RC, RED, new_figure
from pourcast.scenes.liquids.registry import called

_COLOURS = (BLUE, "#B3D4E8", "#F5CDB3", RED, "#DDDDDD")
"""Of `FINDINGS`."""

_ROW = 0.15
"""Height of a row [inch]."""

_CHANCE = "chance"


def multiverse(tables: Mapping[str, pd.DataFrame], level: float) -> Figure:
    """The claimed model beside each other one, in every analysis; below, what analysis that is.

    A column an analysis, a row a model, the hardest ones to tell from it on top; then participants
    beside chance, by ground truth.

    Parameters
    ----------
    tables
        Of `comparison.multiverse.study_multiverse`.
    level
        Participants are told from chance if p is below 1 - level.
    """
    findings = tables["findings"]
    liquids = list(findings["liquid"].unique())
    grids = [_grid(tables, liquid, level) for liquid in liquids]
    choices = [_choices(findings[findings["liquid"] == liquid]) for liquid in liquids]
    heights = [len(each) for pair in zip(grids, choices, strict=True) for each in pair]
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 0.9 + 0.45 * len(liquids) + _ROW * sum(heights))
        panels = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
        for liquid, grid, chosen, above, below in zip(
            liquids, grids, choices, panels[::2], panels[1::2], strict=True
        ):
            _draw_findings(above, grid)
            _draw_choices(below, chosen)
            claim = findings.loc[findings["liquid"] == liquid, "claim"].iloc[0]
            above.set_title(f"{called(liquid)} trials: {claim}, beside", loc="left")
            below.set_xlabel(f"{grid.shape[1]} analyses")
        shown = sorted({int(code) for grid in grids for code in grid.to_numpy().ravel()})
        figure.legend(
            [Patch(color=_COLOURS[code]) for code in shown],
            [_LEGEND[code] for code in shown],
            loc="outside upper center", ncols=len(shown), frameon=False,
        )  # fmt: skip
    return figure


_LEGEND = ("told to be nearer to people", "nearer", "farther", "told to be farther", "unknown")

_KEYS = ["measure", "over", "exclusions"]


def _in_order(findings: pd.DataFrame) -> pd.DataFrame:
    """Analyses, those that are most alike side by side."""
    columns = findings[_KEYS].drop_duplicates()
    ranks = {key: {option: k for k, option in enumerate(columns[key].unique())} for key in _KEYS}
    return columns.sort_values(_KEYS, key=lambda column: column.map(ranks[str(column.name)]))


def _grid(tables: Mapping[str, pd.DataFrame], liquid: str, level: float) -> pd.DataFrame:
    """Numbers in `FINDINGS`: a row a model, or a ground truth; a column an analysis."""
    findings = tables["findings"][tables["findings"]["liquid"] == liquid]
    order = pd.MultiIndex.from_frame(_in_order(findings))
    codes = findings.assign(code=findings["finding"].map(FINDINGS.index))
    grid = codes.pivot_table(index="rival", columns=_KEYS, values="code", sort=False)
    grid = grid.reindex(columns=order).fillna(FINDINGS.index("unknown"))
    grid = grid.loc[grid.mean(axis=1).sort_values(ascending=False, kind="stable").index]
    chance = tables.get("chance", pd.DataFrame({"liquid": [], "truth": []}))
    for truth, rows in chance[chance["liquid"] == liquid].groupby("truth", sort=False):
        told = set(rows["exclusions"][rows["permutation_p"] < 1.0 - level])
        known = set(rows["exclusions"])
        grid.loc[f"{_CHANCE} (r with {truth})"] = [
            0 if case in told else 1 if case in known else FINDINGS.index("unknown")
            for case in order.get_level_values("exclusions")
        ]
    return grid


def _choices(findings: pd.DataFrame) -> pd.DataFrame:
    """Which options each analysis takes: a row an option, a column an analysis."""
    order = _in_order(findings)
    rows: dict[str, NDArray[np.bool_]] = {}
    for key, name in (("measure", ""), ("over", "over "), ("exclusions", "excluded: ")):
        options = list(order[key].unique())
        if len(options) > 1:
            rows |= {f"{name}{option}": (order[key] == option).to_numpy() for option in options}
    if not rows:
        rows = {f"excluded: {NO_RULE}": np.ones(len(order), dtype=bool)}
    return pd.DataFrame(rows).T


def _draw_findings(axes: Axes, grid: pd.DataFrame) -> None:
    axes.imshow(
        grid.to_numpy(dtype=float), aspect="auto", cmap=ListedColormap(_COLOURS), vmin=-0.5,
        vmax=len(_COLOURS) - 0.5, interpolation="nearest",
    )  # fmt: skip
    axes.set_xticks([])
    axes.set_yticks(range(len(grid)), list(grid.index))
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    for edge in range(1, len(grid)):
        axes.axhline(edge - 0.5, color="white", linewidth=0.8)
    for edge in range(1, grid.shape[1]):
        axes.axvline(edge - 0.5, color="white", linewidth=0.8)


def _draw_choices(axes: Axes, chosen: pd.DataFrame) -> None:
    row, column = np.nonzero(chosen.to_numpy())
    axes.scatter(column, row, s=6, color=GREY)
    axes.set_xlim(-0.5, chosen.shape[1] - 0.5)
    axes.set_ylim(len(chosen) - 0.5, -0.5)
    axes.set_xticks([])
    axes.set_yticks(range(len(chosen)), list(chosen.index))
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
