"""What a reader should know of fitted response models: where they fail, and what priors decide."""

from collections.abc import Iterator

import pandas as pd

UNLIKE = 0.01
"""Posterior predictive p below which a statistic is told of: there are thirteen to a model."""


def unlike_people(checks: pd.DataFrame) -> Iterator[str]:
    """In which statistics fitted models make answers unlike people's, a line a liquid.

    Parameters
    ----------
    checks
        Table `predictive_checks` of a comparison.
    """
    for liquid, rows in checks.groupby("liquid", sort=False):
        failed = rows[rows["p"] < UNLIKE]
        if len(failed):
            yield (
                f"{liquid}: as fitted to single answers, models make answers that differ from "
                f"people's in {_by_model(failed, 'statistic', rows)}: what --bayes says of them "
                "rests on a response model that people don't quite follow (predictive_checks)"
            )


def sensitive_to_priors(posterior: pd.DataFrame) -> Iterator[str]:
    """Which parameters depend on their priors, a line a liquid.

    Parameters
    ----------
    posterior
        Table `posterior` of a comparison.
    """
    for liquid, rows in posterior.groupby("liquid", sort=False):
        sensitive = rows[rows["diagnosis"] != ""]
        if len(sensitive):
            yield (
                f"{liquid}: priors count in the posteriors of "
                f"{_by_model(sensitive, 'parameter', rows)}: with stronger or weaker ones these "
                "would be a little different (prior_sensitivity)"
            )


def _by_model(chosen: pd.DataFrame, column: str, rows: pd.DataFrame) -> str:
    """Each statistic or parameter, and by which models."""
    models = list(dict.fromkeys(rows["model"]))
    parts = []
    for what, some in chosen.groupby(column, sort=False):
        names = list(dict.fromkeys(some["model"]))
        parts.append(f"{what} ({'all models' if names == models else ', '.join(names)})")
    return ", ".join(parts)
