"""Within-person reliability: how well people agree with themselves, on scenes they saw twice."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pourcast.statistics.jackknife import POSITIVE, fisher_z, jackknife

Array = NDArray[np.float64]

FEWEST_REPEATS = 10
"""Scenes that somebody must have answered twice, to have a test-retest correlation."""

_NO_SPREAD = 1e-12
_NEARLY_1 = 0.999
"""With a handful of scenes a correlation can be 1 by chance: its z must not drown all others."""


@dataclass(frozen=True)
class Retest:
    """How well first and second answers agree, each with the limits of its interval.

    Limits are NaN with too few participants.

    Parameters
    ----------
    participants, trials
        Those with `FEWEST_REPEATS` or more scenes, and their pairs of answers.
    r
        Mean over participants of the correlation of first with second answers (in Fisher's z); NaN
        if nobody has one.
    noise
        Share of the variance of a participant's single answers that isn't there again: noise. Above
        1 by chance alone; NaN if no answers vary.
    """

    participants: int
    trials: int
    r: tuple[float, float, float]
    noise: tuple[float, float, float]


def retest(first: Array, second: Array, level: float) -> Retest:
    """Compare first with second answers of the same participants to the same scenes.

    Parameters
    ----------
    first, second
        Shape [participant_count, scene_count]; NaN where there is no answer.
    level
        Of the intervals, which are over participants.

    Notes
    -----
    Correlations: Fisher's z of each participant, less its bias with n scenes, r / (2 (n - 1))
    (Hotelling 1953, Journal of the Royal Statistical Society B 15).

    Noise: from a one-way analysis of variance within each participant, pooled; one minus the share
    is the intraclass correlation ICC(1) of Shrout & Fleiss (1979, Psychological Bulletin 86). A
    shift from first to second answers is noise in it, and not in the correlation.
    """
    there = np.isfinite(first) & np.isfinite(second)
    enough = there.sum(axis=1) >= FEWEST_REPEATS
    pairs = [
        (x[both], y[both])
        for x, y, both in zip(first[enough], second[enough], there[enough], strict=True)
    ]
    z = np.array([_unbiased_z(x, y) for x, y in pairs])
    parts = np.array([_noise_and_total(x, y) for x, y in pairs]).reshape(-1, 2)
    return Retest(
        len(pairs),
        int(there[enough].sum()),
        _mean_r(z[np.isfinite(z)], level),
        _ratio(parts, level),
    )


def _unbiased_z(x: Array, y: Array) -> float:
    """Fisher's z of a correlation, less its bias with few pairs; NaN without spread."""
    if min(x.var(), y.var()) < _NO_SPREAD:
        return float("nan")
    r = np.clip(np.corrcoef(x, y)[0, 1], -_NEARLY_1, _NEARLY_1)
    return float(fisher_z(r) - r / (2.0 * (len(x) - 1.0)))


def _noise_and_total(x: Array, y: Array) -> tuple[float, float]:
    """Variance of single answers to a scene, and of single answers to all scenes."""
    noise = float(((x - y) ** 2).mean() / 2.0)
    between = float(2.0 * ((x + y) / 2.0).var(ddof=1))
    return noise, (between + noise) / 2.0


def _mean_r(z: Array, level: float) -> tuple[float, float, float]:
    if not len(z):
        return np.nan, np.nan, np.nan
    found = jackknife(z[:, None], lambda means, _: means, "participants")
    low, high = found.interval(level)
    return float(np.tanh(z.mean())), float(np.tanh(low[0])), float(np.tanh(high[0]))


def _ratio(parts: Array, level: float) -> tuple[float, float, float]:
    if not parts[:, 1].sum() > _NO_SPREAD:
        return np.nan, np.nan, np.nan

    def log_ratio(means: Array, _: Array) -> Array:
        there: Array = POSITIVE.there(means)
        return there[:, :1] - there[:, 1:]

    low, high = (
        np.exp(end[0]) for end in jackknife(parts, log_ratio, "participants").interval(level)
    )
    return float(parts[:, 0].sum() / parts[:, 1].sum()), float(low), float(high)
