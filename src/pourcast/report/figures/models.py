"""Figures of models against people."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pourcast.comparison.agreement import PeopleAndModels
from pourcast.models.registry import family_of, name_of
from pourcast.pictures.style import BLUE, COLUMN, GREY, PAGE, RC, new_figure
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import called, colour_of
from pourcast.statistics.correlation import mean_judgments, pearson
from pourcast.statistics.jackknife import over_words
from pourcast.study.experiments.base import Experiment, published_with_people


def _panels(figure: Figure, count: int, **options: Any) -> list[Any]:
    return list(figure.subplots(1, count, squeeze=False, **options)[0])


def correlations(
    agreement: pd.DataFrame,
    experiment: Experiment | None = None,
    own: Sequence[Liquid] = (),
) -> Figure:
    """Correlation of each model with people, water and honey side by side, published values too.

    Parameters
    ----------
    agreement
        Table of `comparison.agreement.agreement_table`, of one or more liquids.
    experiment
        What it is of; its published correlations are shown as diamonds.
    own
        The study's own liquids.
    """
    liquids = list(dict.fromkeys(agreement["liquid"]))
    models = list(dict.fromkeys(agreement["model"]))
    with mpl.rc_context(RC):
        figure = new_figure(PAGE if len(liquids) > 1 else COLUMN, 0.9 + 0.2 * len(models))
        for axes, liquid in zip(_panels(figure, len(liquids), sharey=True), liquids, strict=True):
            rows = agreement[agreement["liquid"] == liquid].set_index("model").reindex(models)
            short, places = called(liquid), np.arange(len(models))
            axes.barh(places, rows["r"], color=colour_of(short, own), height=0.7, alpha=0.85)
            axes.hlines(places, rows["r_low"], rows["r_high"], color="black", linewidth=1)
            known = published_with_people(experiment, short)
            marked = [(known[m].r, k) for k, m in enumerate(models) if m in known]
            if marked:
                axes.plot(
                    *zip(*marked, strict=True), "D", markersize=4, markerfacecolor="white",
                    markeredgecolor=GREY,
                )  # fmt: skip
            axes.set(title=f"{short} trials", xlabel="r with people's means", yticks=places)
            axes.set_yticklabels(models)
            axes.set_xlim(min(0.0, float(rows[["r", "r_low"]].min(axis=None))), 1.0)
        figure.axes[0].invert_yaxis()
        over = over_words(agreement["over"].iloc[0])
        has_lines = bool(agreement["r_low"].notna().any())
        said = [f"Lines: 95 % intervals over {over}"] if has_lines else []
        said += ["Diamonds: published"] if experiment and experiment.published else []
        # In one column there is no room for a line of both.
        figure.suptitle(("\n" if len(figure.axes) == 1 else ". ").join(said), fontsize=7)
    return figure


def scatter(compared: PeopleAndModels, models: Sequence[str], own: Sequence[Liquid] = ()) -> Figure:
    """People's mean judgments against some models', a panel a model.

    Parameters
    ----------
    compared
        People and models.
    models
        Which models, best first.
    own
        The study's own liquids.
    """
    people = mean_judgments(compared.trials.responses)
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 0.55 + PAGE / len(models) * 0.95)
        short = called(compared.trials.liquid)
        for axes, model in zip(_panels(figure, len(models), sharey=True), models, strict=True):
            judgments = compared.models[model]
            axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.7, linestyle=":")
            axes.plot(
                judgments, people, "o", markersize=3, alpha=0.7, color=colour_of(short, own),
                markeredgewidth=0,
            )  # fmt: skip
            r = float(pearson(people, judgments[None])[0])
            axes.set(title=f"{model}\nr = {r:.2f}", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
            axes.set(aspect="equal", xlabel="model")
        figure.axes[0].set_ylabel(f"people, {short} trials")
    return figure


def answers_by_tenths(tenths: pd.DataFrame) -> Figure:
    """Answers in each tenth of the scale, beside those of fitted models, a panel a model.

    Parameters
    ----------
    tenths
        A row a model and a tenth, of one liquid; see `statistics.predictive_checks.Checks`.
    """
    names = list(dict.fromkeys(tenths["model"]))
    with mpl.rc_context(RC):
        width = PAGE if len(names) > 2 else COLUMN
        figure = new_figure(width, 2.1)
        for axes, name in zip(_panels(figure, len(names), sharey=True), names, strict=True):
            rows = tenths[tenths["model"] == name]
            edges = [*rows["above"], rows["below"].iloc[-1]]
            axes.stairs(rows["observed"], edges, fill=True, color=GREY, alpha=0.35, label="people")
            axes.stairs(
                rows["high"], edges, baseline=rows["low"], fill=True, color=BLUE, alpha=0.4,
                label="95 % of replicates",
            )  # fmt: skip
            axes.stairs(rows["mean"], edges, baseline=None, color=BLUE, label="their mean")
            axes.set(title=name.replace(":", ":\n").replace(",", ",\n"), xlabel="answer")
            axes.set(xlim=(0.0, 1.0), xticks=(0.0, 0.5, 1.0))
        highest = float(tenths[["observed", "high"]].to_numpy().max())
        figure.axes[0].set(ylabel="share of answers", ylim=(0.0, 1.05 * highest))
        figure.legend(
            *figure.axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3,
            frameon=False,
        )  # fmt: skip
    return figure


def best_of_each_family(compared: PeopleAndModels, most: int = 4) -> list[str]:
    """The best-correlated model of each family, best first."""
    people = mean_judgments(compared.trials.responses)
    r = pd.Series(pearson(people, compared.judgments), index=compared.names)
    found: dict[str, str] = {}
    for name in r.sort_values(ascending=False).index:
        found.setdefault(_family(str(name)), str(name))
    return list(found.values())[:most]


def _family(name: str) -> str:
    base = name_of(name)
    return "truth" if base.startswith("truth") else family_of(base)


_FEW_MODELS = 9


def _tests(rows: pd.DataFrame) -> str:
    """What a star means; without tests, that there are none."""
    over = over_words(rows["over"].iloc[0])
    known = rows["p_holm"].notna().any()
    return f"* p < .05 for all pairs (Holm), over {over}" if known else f"(no tests over {over})"


def differences(table: pd.DataFrame, liquid: str) -> Figure:
    """Who beats whom: differences in r, and which hold for all pairs together.

    Parameters
    ----------
    table
        Table of `comparison.agreement.differences_table`.
    liquid
        The liquid to show.
    """
    rows = table[table["liquid"] == liquid]
    models = list(dict.fromkeys([*rows["model"], *rows["rival"]]))
    place = {model: k for k, model in enumerate(models)}
    matrix = np.full((len(models), len(models)), np.nan)
    holds = np.zeros(matrix.shape, dtype=bool)
    i, j = rows["model"].map(place).to_numpy(int), rows["rival"].map(place).to_numpy(int)
    matrix[i, j], matrix[j, i] = rows["difference"], -rows["difference"]
    holds[i, j] = holds[j, i] = rows["p_holm"] < 0.05
    with mpl.rc_context(RC):
        # Numbers and stars of many models need the whole page.
        size = PAGE * (0.75 if len(models) <= _FEW_MODELS else 1.0)
        figure = new_figure(size, size * 0.9)
        axes = figure.add_subplot()
        limit = float(np.nanmax(np.abs(matrix), initial=0.01))
        picture = axes.imshow(matrix, cmap="PuOr", vmin=-limit, vmax=limit)
        for i, j in zip(*np.nonzero(np.isfinite(matrix)), strict=True):
            dark = abs(matrix[i, j]) > 0.55 * limit
            axes.text(
                j, i, f"{matrix[i, j]:+.2f}{'*' if holds[i, j] else ''}".replace("0.", "."),
                ha="center", va="center", fontsize=5.5, color="white" if dark else "black",
                fontweight="bold" if holds[i, j] else "normal",
            )  # fmt: skip
        axes.set(xticks=range(len(models)), yticks=range(len(models)))
        axes.set_xticklabels(models, rotation=60, ha="right", rotation_mode="anchor")
        axes.set_yticklabels(models)
        axes.set_title(
            f"{called(liquid)} trials: r of the row's model minus r of the column's\n{_tests(rows)}"
        )
        figure.colorbar(picture, ax=axes, shrink=0.8, label="difference in r")
    return figure
