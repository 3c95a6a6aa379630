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

from pourcast.comparison.multiverse import FINDINGS, rules_in
from pourcast.pictures.style import BLUE, GREY, PAGE, RC, RED, new_figure
from pourcast.scenes.liquids.registry import called

_COLOURS = (BLUE, "#B3D4E8", "#EFA77C", RED, "#DDDDDD")
"""Of `FINDINGS`."""

_ROW = 0.15
"""Height of a row [inch]."""

_CHANCE = "chance"

_UNKNOWN = FINDINGS.index("unknown")

_LONGEST = 34
"""Characters of a name that have room."""

_LINED = 60
"""Analyses of which more have no room for lines between them."""


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
            above.set_title(f"{called(liquid)} trials: {_short(claim)}, beside", loc="left")
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
    grid = grid.reindex(columns=order)
    # What is unknown is neither hard to tell nor easy.
    rank = grid.where(grid != _UNKNOWN).mean(axis=1).fillna(-1.0)
    grid = grid.loc[rank.sort_values(ascending=False, kind="stable").index].fillna(_UNKNOWN)
    chance = tables.get("chance", pd.DataFrame({"liquid": [], "truth": []}))
    for truth, rows in chance[chance["liquid"] == liquid].groupby("truth", sort=False):
        cases = rows.set_index("exclusions")
        codes_of = {
            words: _beside_chance(row["mean_r"], row["permutation_p"], level)
            for words, row in cases.iterrows()
        }
        grid.loc[f"{_CHANCE} (r with {truth})"] = [
            codes_of.get(words, _UNKNOWN) for words in order.get_level_values("exclusions")
        ]
    return grid


def _beside_chance(mean_r: float, p: float, level: float) -> int:
    """Participants' mean r with a ground truth: told from chance, above it, or below."""
    if np.isnan(p):
        return _UNKNOWN
    if p < 1.0 - level:
        return 0
    return 1 if mean_r > 0.0 else 2


def _choices(findings: pd.DataFrame) -> pd.DataFrame:
    """Which options each analysis takes: a row an option or a rule, a column an analysis."""
    order = _in_order(findings)
    rows: dict[str, NDArray[np.bool_]] = {}
    for key, name in (("measure", ""), ("over", "over ")):
        for option in order[key].unique():
            rows[f"{name}{option}"] = (order[key] == option).to_numpy()
    applied = [rules_in(words) for words in order["exclusions"]]
    for rule in dict.fromkeys(rule for some in applied for rule in some):
        rows[f"excluded: {rule}"] = np.array([rule in some for some in applied])
    return pd.DataFrame(rows).T


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 9]}…{name[-8:]}"


def _draw_findings(axes: Axes, grid: pd.DataFrame) -> None:
    axes.imshow(
        grid.to_numpy(dtype=float), aspect="auto", cmap=ListedColormap(_COLOURS), vmin=-0.5,
        vmax=len(_COLOURS) - 0.5, interpolation="nearest",
    )  # fmt: skip
    axes.set_xticks([])
    axes.set_yticks(range(len(grid)), [_short(name) for name in grid.index])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    for edge in range(1, len(grid)):
        axes.axhline(edge - 0.5, color="white", linewidth=0.8)
    for edge in range(1, grid.shape[1]) if grid.shape[1] <= _LINED else ():
        axes.axvline(edge - 0.5, color="white", linewidth=0.8)


def _draw_choices(axes: Axes, chosen: pd.DataFrame) -> None:
    row, column = np.nonzero(chosen.to_numpy())
    axes.scatter(column, row, s=min(6.0, 360.0 / chosen.shape[1]), color=GREY, linewidths=0)
    axes.set_xlim(-0.5, chosen.shape[1] - 0.5)
    axes.set_ylim(len(chosen) - 0.5, -0.5)
    axes.set_xticks([])
    axes.set_yticks(range(len(chosen)), [_short(name) for name in chosen.index])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
