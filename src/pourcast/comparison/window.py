"""How much deterministic judgments vary over the window of dampings, condition by condition."""

import itertools
from collections.abc import Mapping

import pandas as pd

from pourcast.comparison.agreement import Settings
from pourcast.models.base import zeta_window
from pourcast.models.registry import family_of, make_model
from pourcast.statistics.variance import WindowVariance, unpaired_t, window_variance
from pourcast.sweep.judgments import Judgments, columns_of

CONDITIONS = ("water-ife", "honey-ife-1", "honey-ife-2")
"""Models whose windows are looked at: the paper's three IFEs."""


def window_variances(
    judged: Judgments, liquid: str, settings: Settings
) -> dict[str, WindowVariance]:
    """Variance over the window of each of `CONDITIONS`, from its deterministic judgments.

    Parameters
    ----------
    judged
        Judgments; a model whose deterministic ones (sigma = 0) are not all known is left out.
    liquid
        Liquid of the trials under which to look (any will do, as the liquid is in the head).
    settings
        How intervals are made.
    """
    variances = {}
    for name in CONDITIONS:
        parameters = make_model(name).parameters()
        window = zeta_window(parameters["damping_zeta"], parameters["zeta_sigma"])
        fixed = columns_of(parameters) | {"family": family_of(name), "zeta_sigma": 0}
        rows = [judged.on_trials(liquid, **fixed | {"damping_zeta": zeta}) for zeta in window]
        if all(len(row) for row in rows):
            judgments = judged.judgments[[int(row[0]) for row in rows]]
            variances[name] = window_variance(judgments, settings.level)
    return variances


def variance_table(variances: Mapping[str, WindowVariance]) -> pd.DataFrame:
    """A row a condition: `mean` variance over the scenes, and its interval over scenes."""
    return pd.DataFrame(
        [
            {"model": name, "variance": v.mean, "low": v.low, "high": v.high, "over": "scenes"}
            for name, v in variances.items()
        ]
    )


def variance_tests(variances: Mapping[str, WindowVariance]) -> pd.DataFrame:
    """Unpaired t-tests between the conditions, as in the paper."""
    rows = []
    for first, second in itertools.combinations(variances, 2):
        t, df, p = unpaired_t(variances[first].per_scene, variances[second].per_scene)
        rows.append({"model": first, "rival": second, "t": t, "df": df, "p": p})
    return pd.DataFrame(rows)
