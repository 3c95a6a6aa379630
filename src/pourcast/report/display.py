"""Tables as people read them: a number and its interval in one cell, headings in words."""

import pandas as pd

DECIMALS = 2

HEADINGS = {
    "r_truth_water": "r with truth-water",
    "r_truth_honey": "r with truth-honey",
    "r_truth_stimulus": "r with the stimuli",
    "rmse": "RMSE",
    "explained": "share of explainable variance (over scenes)",
    "permutation_p": "p (scenes permuted)",
    "split_half": "split-half r",
    "spearman_brown": "with Spearman-Brown",
    "ceiling": "noise ceiling (r)",
    "repeated": "repeated trials",
    "retest_r": "test-retest r",
    "noise": "share of noise",
    "p_holm": "p (Holm)",
    "equivalent_within": "equivalent within ±",
    "beta_a": "beta a",
    "beta_b": "beta b",
    "mean_r": "mean r",
    "beat_chance": "beat chance (p < .05)",
    "ks_D": "KS D",
    "ks_p": "KS p",
    "n_particles": "N",
    "viscosity_alpha": "alpha",
    "damping_zeta": "zeta",
    "r_paper": "r at the paper's",
    "paper": "the paper's parameters",
    "flat": "as good as the best",
    "in_sample": "r, all scenes",
    "train": "r, training half",
    "test": "r, other half",
    "chosen": "chosen most often",
    "r_where_fitted": "r where fitted",
    "within_one_step": "within one step",
    "unit": "left out",
    "elpd": "elpd (LOO)",
    "elpd_diff": "below the best",
    "dse": "se of that",
    "told": "told apart (Holm)",
    "nearest": "share in which it is nearest",
    "told_from": "share of others it is told from",
    "p_loo": "effective parameters",
    "largest_k": "largest Pareto k",
    "r_hat": "R-hat",
    "ess_bulk": "effective draws",
    "ess_tail": "effective draws, tails",
    "probability": "P(above 0)",
    "replicated": "participants and scenes",
    "relative": "over the slope between scenes",
}

_HIDDEN = ("spec",)
_P_VALUES = ("p", "p_holm", "ks_p", "permutation_p")


def readable(table: pd.DataFrame) -> pd.DataFrame:
    """The same table as text: intervals merged into their values' cells, missing values as a dash.

    Where there is no interval, the value stands alone; remarks say why there is none.

    Parameters
    ----------
    table
        Any table of `analysis`: a column ``x`` with ``x_low`` and ``x_high``, or any column
        followed by ``low`` and ``high``, is a value with an interval.
    """
    names = [str(name) for name in table.columns if name not in _HIDDEN]
    shown = pd.DataFrame(index=table.index)
    for place, name in enumerate(names):
        if name in ("low", "high") or name.endswith(("_low", "_high")):
            continue
        limits = _limits(names, place)
        words = [_word(name, value) for value in table[name]]
        if limits is not None:
            pairs = zip(words, table[limits[0]], table[limits[1]], strict=True)
            words = [
                f"{word} [{_word(name, low)}, {_word(name, high)}]"
                if word != "-" and low == low  # noqa: PLR0124 (NaN)
                else word
                for word, low, high in pairs
            ]
        shown[HEADINGS.get(name, name.replace("_", " "))] = words
    return shown


def _limits(names: list[str], place: int) -> tuple[str, str] | None:
    own = f"{names[place]}_low", f"{names[place]}_high"
    if own[0] in names:
        return own
    follows = names[place + 1 : place + 3] == ["low", "high"]
    return ("low", "high") if follows else None


def _word(name: str, value: object) -> str:
    if isinstance(value, str | bool):
        return str(value)
    number = float(value)  # type: ignore[arg-type]
    if number != number:  # noqa: PLR0124 (NaN)
        return "-"
    if name in _P_VALUES:
        return f"{number:.2g}" if number >= 0.001 else f"{number:.0e}"
    if name in ("n_particles", "damping_zeta", "g", "m"):
        return f"{number:g}"
    if isinstance(value, int) or (number.is_integer() and abs(number) >= 2):
        return f"{number:.0f}"
    return f"{number:.{4 if name == 'variance' else DECIMALS}f}"
