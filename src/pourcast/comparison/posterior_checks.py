"""What a reader should know of fitted response models: where they fail, and what priors decide."""

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from pourcast.comparison import liquid_effect
from pourcast.comparison.agreement import PeopleAndModels
from pourcast.statistics.jackknife import FEWEST
from pourcast.study.experiments.base import Experiment
from pourcast.study.trials import Trials

LARGEST_R_HAT = 1.01
"""Chains of a posterior that differ by more are told of (rank-normalised R-hat)."""

LEAST_ESS = 400.0
"""Effective draws, of the bulk and of the tails, fewer than which are told of."""

UNLIKE = 0.01
"""Posterior predictive p below which a statistic is told of: there are thirteen to a model."""


def doubts_of_posteriors(
    tables: Mapping[str, pd.DataFrame],
    people: Sequence[PeopleAndModels],
    experiment: Experiment | None,
) -> list[str]:
    """What of the likelihood of single answers is not to be relied on, or is not there, and why.

    Parameters
    ----------
    tables
        Of a comparison.
    people
        People and models, one for each liquid.
    experiment
        What the study was made from, if it was.
    """
    if "posterior" not in tables:
        return []
    doubts = list(not_converged(tables["posterior"], ""))
    if len(effects := tables["liquid_effect"]):
        doubts += not_converged(effects, " of the liquid's effect")
    doubts += unlike_people(tables["predictive_checks"])
    doubts += sensitive_to_priors(tables["posterior"])
    doubts += [_unknown_loo(one.trials) for one in people]
    doubts += liquid_effect.unknown_liquid_effects(people, experiment)
    return [doubt for doubt in doubts if doubt]


def not_converged(table: pd.DataFrame, what: str) -> Iterator[str]:
    """Which posteriors are not to be relied on, and why."""
    for (liquid, model), rows in table.groupby(["liquid", "model"], sort=False):
        why = []
        if (r_hat := rows["r_hat"].max()) > LARGEST_R_HAT:
            why.append(f"its chains disagree (R-hat {r_hat:.3f}, above {LARGEST_R_HAT})")
        if (ess := rows[["ess_bulk", "ess_tail"]].to_numpy().min()) < LEAST_ESS:
            why.append(f"it is worth {ess:.0f} draws (fewer than {LEAST_ESS:.0f})")
        if divergences := rows["divergences"].max():
            why.append(f"{divergences} of its trajectories diverged")
        if why:
            yield f"{liquid}: trust the posterior{what} by {model} less: {', '.join(why)}"


def _unknown_loo(trials: Trials) -> str:
    """What can't be left out one at a time, as there is too little of it; empty if all can."""
    counts = dict(zip(("participants", "scenes"), trials.responses.shape, strict=True))
    few = [f"{what} ({count})" for what, count in counts.items() if count < FEWEST]
    if not few:
        return ""
    return f"{trials.liquid}: no leaving out of {' or '.join(few)}: it needs at least {FEWEST}"


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
