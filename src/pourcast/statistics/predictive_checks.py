"""Posterior predictive checks: whether a fitted response model makes answers like people's.

Answers are made anew from draws of the posterior (Gelman, Meng & Stern 1996, Statistica Sinica 6),
by the *same* participants of the same scenes, with the effects that they have in the draw, and by
*new* ones, with effects drawn from their normal distributions. Their statistics are compared with
those of the data. As the data are used twice, p is conservative.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit

from pourcast.statistics.answer_statistics import STATISTICS, TENTHS, Design, Replicated, tenths
from pourcast.statistics.jackknife import LEVEL
from pourcast.statistics.nuts import Posterior
from pourcast.statistics.ordered_beta import Answering, draw_answers
from pourcast.statistics.response_model import Answers, Predictor
from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]

OTHER_TENTHS = "answers in other tenths"
"""The share of answers that would have to be in another tenth of the scale."""

_BLOCK = 2_000_000
"""Answers made at a time."""


@dataclass(frozen=True)
class Checks:
    """Statistics of the data, beside those of answers that the fitted model makes.

    Parameters
    ----------
    statistics
        A row a statistic that the data have: `statistic` (see `answer_statistics.STATISTICS`;
        `answers in other tenths` than replicates have on average); `replicated`, whether answers
        are those of the `same` participants and scenes or of `new` ones; `observed`; `mean`, `low`,
        `high` of the replicates (quantiles); `p`, twice the share of replicates that are as low, or
        as high, whichever is less; of answers in other tenths, the share that is as high.
    tenths
        A row a tenth of the scale, from `above` to `below`, with the share of answers in it:
        `observed`, and `mean`, `low`, `high` of the replicates.
    """

    statistics: pd.DataFrame
    tenths: pd.DataFrame


def predictive_checks(
    posterior: Posterior,
    data: Answers,
    seed: int = 0,
    *,
    replicates: int = Sampling.replicates,
    level: float = LEVEL,
) -> Checks:
    """Compare answers that the fitted model makes with those that it was fitted to.

    Parameters
    ----------
    posterior
        Of the response model.
    data
        What it was fitted to.
    seed
        Of the answers that are made.
    replicates
        Data sets that are made by the same participants, and by new ones; as many as the posterior
        has draws, if these are fewer.
    level
        Of the replicates' range.
    """
    design = Design(data.answered, expit(data.x))
    made: dict[str, list[Array]] = {name: [] for name in (*STATISTICS, OTHER_TENTHS)}
    for kind, answers in _replicates(posterior, data, np.random.default_rng(seed), replicates):
        for name, (of, statistic) in STATISTICS.items():
            if of == kind:
                made[name].append(statistic(answers, design))
        if kind == "same":
            made[OTHER_TENTHS].append(tenths(answers, design))
    histograms = np.concatenate(made.pop(OTHER_TENTHS))
    observed = tenths(data.answers[None], design)[0]
    rows = [
        {"statistic": name, "replicated": of}
        | _row(float(statistic(data.answers[None], design)[0]), np.concatenate(made[name]), level)
        for name, (of, statistic) in STATISTICS.items()
    ]
    mean = histograms.mean(axis=0)
    row = _row(float(_moved(observed, mean)), _moved(histograms, mean), level, upward=True)
    table = pd.DataFrame([*rows, {"statistic": OTHER_TENTHS, "replicated": "same"} | row])
    known = table[["observed", "mean"]].notna().all(axis=1)
    return Checks(table[known].reset_index(drop=True), _tenths(observed, histograms, level))


def _replicates(
    posterior: Posterior, data: Answers, rng: np.random.Generator, most: int
) -> Iterator[tuple[Replicated, Array]]:
    """Answers made anew, shape [some, participant_count, scene_count], of both kinds in turn."""
    drawn = {name: posterior.flat(name, most).astype(float) for name in _DRAWN}
    count, each = len(drawn["slope"]), data.answers.size
    for block in np.array_split(np.arange(count), -(-count * each // _BLOCK)):
        draws = {name: values[block] for name, values in drawn.items()}
        yield "same", _answers(draws, data, rng)
        new = {
            name: draws[spread][:, None] * rng.standard_normal(draws[name].shape)
            for name, spread in _SPREADS.items()
        }
        yield "new", _answers(draws | new, data, rng)


_SPREADS = {
    "participant_intercept": "spread_intercept",
    "participant_slope": "spread_slope",
    "scene": "spread_scene",
}
"""Effects, and their standard deviations."""

_DRAWN = (*Predictor._fields, *_SPREADS.values(), *Answering._fields)


def _answers(draws: dict[str, Array], data: Answers, rng: np.random.Generator) -> Array:
    eta = Predictor(*(draws[name] for name in Predictor._fields)).eta(data.x)
    answering = Answering(*(draws[name][:, None, None] for name in Answering._fields))
    return draw_answers(eta, answering, rng)


def _moved(histograms: Array, mean: Array) -> Array:
    """Share that would have to be in another tenth for histograms to be the mean one."""
    found: Array = 0.5 * np.abs(histograms - mean).sum(axis=-1)
    return found


def _row(observed: float, made: Array, level: float, *, upward: bool = False) -> dict[str, Any]:
    """A statistic's numbers; NaN where the data, or replicates, don't have it."""
    known = made[np.isfinite(made)]
    if not (len(known) and np.isfinite(observed)):
        return dict.fromkeys(("observed", "mean", "low", "high", "p"), np.nan)
    low, high = np.quantile(known, [0.5 - level / 2.0, 0.5 + level / 2.0])
    # The data are one more of them: no p is 0.
    as_low, as_high = (
        (1 + np.count_nonzero(as_far)) / (1 + len(known))
        for as_far in (known <= observed, known >= observed)
    )
    p = as_high if upward else min(1.0, 2.0 * min(as_low, as_high))
    return {"observed": observed, "mean": known.mean(), "low": low, "high": high, "p": p}


def _tenths(observed: Array, histograms: Array, level: float) -> pd.DataFrame:
    low, high = np.quantile(histograms, [0.5 - level / 2.0, 0.5 + level / 2.0], axis=0)
    return pd.DataFrame(
        {
            "above": TENTHS[:-1],
            "below": TENTHS[1:],
            "observed": observed,
            "mean": histograms.mean(axis=0),
            "low": low,
            "high": high,
        }
    )
