"""The answer of a comparison in two sentences: which model is nearest, and how sure that is."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from pourcast.scenes.liquids.registry import called
from pourcast.statistics.jackknife import LEVEL, over_words

_NAMED = 4
"""Models that are named, of more the number."""


def answers(tables: Mapping[str, pd.DataFrame], level: float = LEVEL) -> list[str]:
    """Two sentences a liquid, from a comparison's tables.

    Parameters
    ----------
    tables
        `agreement`, `differences`, `reliability` of `comparison.compare.compare_study`; of the
        last two, what there is.
    level
        Of the intervals; two models are told from one another if Holm's p is below 1 - level.

    Examples
    --------
    >>> agreement = pd.DataFrame(
    ...     {"liquid": "water", "model": ["a", "b"], "r": [0.9, 0.6], "r_low": [0.8, 0.3],
    ...      "r_high": [0.95, 0.8], "over": "both"})
    >>> differences = pd.DataFrame(
    ...     {"liquid": "water", "model": ["a"], "rival": ["b"], "p_holm": [0.01]})
    >>> answers({"agreement": agreement, "differences": differences})[0]
    'water: a agrees best with people, r 0.90 [0.80, 0.95], and is told from all others. \
(Over participants and scenes; p < .05, Holm.)'
    """
    agreement = tables["agreement"]
    return [
        _answer(str(liquid), rows.set_index("model"), tables, level)
        for liquid, rows in agreement.groupby("liquid", sort=False)
        if rows["r"].notna().any()
    ]


def _answer(
    liquid: str, rows: pd.DataFrame, tables: Mapping[str, pd.DataFrame], level: float
) -> str:
    best = str(rows["r"].idxmax())
    nearest = f"{called(liquid)}: {best} agrees best with people, {_number(rows, best, 'r')}"
    told = _told(liquid, best, list(rows["r"].sort_values(ascending=False).index), tables, level)
    ceiling = _ceiling(liquid, tables)
    how = _how(liquid, over_words(str(rows["over"].iloc[0])), tables, level)
    return " ".join(part for part in (f"{nearest}{told}.", ceiling, how) if part)


def _how(liquid: str, over: str, tables: Mapping[str, pd.DataFrame], level: float) -> str:
    """What the answer holds over, and how models were tested; there may be nothing to test."""
    table = tables.get("differences", pd.DataFrame({"liquid": [], "p_holm": []}))
    p = table.loc[table["liquid"] == liquid, "p_holm"]
    if p.empty:
        return f"(Over {over}.)"
    if p.isna().all():
        return "(Nothing was tested: a note says why.)"
    return f"(Over {over}; p < {f'{1.0 - level:.2g}'.lstrip('0')}, Holm.)"


def _told(
    liquid: str,
    best: str,
    models: Sequence[str],
    tables: Mapping[str, pd.DataFrame],
    level: float,
) -> str:
    """From which other models the best one is told, or not."""
    others = [model for model in models if model != best]
    table = tables.get("differences", pd.DataFrame())
    if not others or table.empty:
        return ""
    rows = table[table["liquid"] == liquid]
    p = {
        frozenset((model, rival)): value
        for model, rival, value in zip(rows["model"], rows["rival"], rows["p_holm"], strict=True)
    }
    values = {model: p.get(frozenset((best, model)), np.nan) for model in others}
    if all(np.isnan(value) for value in values.values()):
        return ", which can't be told from the others with these data"
    alike = [model for model, value in values.items() if not value < 1.0 - level]
    if not alike:
        return ", and is told from all others"
    named = ", ".join(f"{model}{_region(rows, best, model)}" for model in alike[:_NAMED])
    more = f" and {len(alike) - _NAMED} more" if len(alike) > _NAMED else ""
    return f"; it is not told from {named}{more}"


def _region(differences: pd.DataFrame, best: str, model: str) -> str:
    """Within which region a model is equivalent to the best one, if that is known."""
    pair = differences["model"].isin([best, model]) & differences["rival"].isin([best, model])
    within = differences[pair].get("equivalent_within", pd.Series(dtype=float))
    known = within[np.isfinite(within)]
    return f" (r within {known.iloc[0]:.2f} of it)" if len(known) else ""


def _ceiling(liquid: str, tables: Mapping[str, pd.DataFrame]) -> str:
    table = tables.get("reliability", pd.DataFrame())
    if "ceiling" not in table:
        return ""
    rows = table.set_index("liquid")
    if not rows["ceiling"].to_dict()[liquid] > 0.0:
        return ""
    return f"A perfect model could expect {_number(rows, liquid, 'ceiling')}."


def _number(rows: pd.DataFrame, row: str, name: str) -> str:
    """An r, and its interval if there is one."""
    value, low, high = (
        float(rows[key].to_dict()[row]) for key in (name, f"{name}_low", f"{name}_high")
    )
    limits = f" [{low:.2f}, {high:.2f}]" if np.isfinite([low, high]).all() else ""
    return f"r {value:.2f}{limits}"
