"""Within-person reliability, liquid by liquid, where trials were repeated."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from pourcast.comparison.agreement import Settings
from pourcast.statistics.jackknife import FEWEST
from pourcast.statistics.retest import FEWEST_REPEATS, retest
from pourcast.study.trials import Trials


def retest_table(trials: Sequence[Trials], settings: Settings) -> pd.DataFrame:
    """How well people agree with themselves; intervals are over participants.

    Returns
    -------
    DataFrame
        A row for each liquid with repeated trials: `participants` and their `repeated` trials
        (first and second answer, of those with enough of them), `retest_r` (mean correlation of
        first with second answers) and `noise` (share of the variance of single answers), each with
        `_low` and `_high`, and `over`.
    """
    rows = []
    for one in trials:
        if one.occasions is None:
            continue
        found = retest(one.occasions[0], one.occasions[1], settings.level)
        row: dict[str, object] = {
            "liquid": one.liquid, "participants": found.participants, "repeated": found.trials,
        }  # fmt: skip
        for name, values in (("retest_r", found.r), ("noise", found.noise)):
            row |= dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))
        rows.append(row | {"over": "participants"})
    return pd.DataFrame(rows)


def unknown_retest(trials: Trials, table: pd.DataFrame) -> str:
    """Why there is no within-person reliability, or no interval of it; empty if there is.

    Parameters
    ----------
    trials
        Of one liquid.
    table
        From `retest_table`.
    """
    if trials.occasions is None:
        return ""
    row = table.set_index("liquid").loc[trials.liquid]
    if np.isnan(row["retest_r"]):
        return (
            f"{trials.liquid}: no within-person reliability: nobody answered {FEWEST_REPEATS} "
            "scenes twice with answers that vary"
        )
    if np.isnan(row["retest_r_low"]):
        return (
            f"{trials.liquid}: within-person reliability has no interval: it needs at least "
            f"{FEWEST} participants who answered {FEWEST_REPEATS} scenes twice"
        )
    return ""
