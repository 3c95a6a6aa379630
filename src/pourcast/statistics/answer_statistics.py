"""Statistics of single answers that a referee would ask of a model of them.

Each is of many data sets at once, as answers made anew by a model are: an array of shape
[replicate_count, participant_count, scene_count] in, one number for each replicate out; NaN where
the statistic is not known, as it is where there are fewer than five participants, or scenes, that
it is over.
"""

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pourcast.statistics.jackknife import FEWEST

Array = NDArray[np.float64]

TENTHS = np.linspace(0.0, 1.0, 11)
"""Edges of the histogram of answers."""

_ON_EDGE = 1e-6
"""How near an edge an answer is on it."""

_NO_SPREAD = 1e-12
"""Sum of squares below which there is no spread."""


class Design:
    """Who answered what, and what the model judges.

    Parameters
    ----------
    answered
        Where there are answers, shape [participant_count, scene_count].
    judgments
        The model's, shape [scene_count].
    """

    def __init__(self, answered: NDArray[np.bool_], judgments: Array) -> None:
        self.weights = answered.astype(float)
        self.of_participant, self.of_scene = (self.weights.sum(axis=k) for k in (1, 0))
        self.scenes, self.participants = self.of_scene > 0, self.of_participant > 0
        line = np.stack([np.ones(self.scenes.sum()), judgments[self.scenes]], axis=1)
        self.judgments = judgments
        self.off_line = np.eye(len(line)) - line @ np.linalg.pinv(line)


def tenths(answers: Array, design: Design) -> Array:
    """Share of answers in each tenth of the scale; who is on an edge counts half on either side.

    Returns
    -------
    ndarray
        Shape [replicate_count, 10].
    """
    inner = TENTHS[1:-1]
    under, up_to = (
        [_share(answers <= edge + off, design) for edge in inner] for off in (-_ON_EDGE, _ON_EDGE)
    )
    below = 0.5 * (np.array(under) + np.array(up_to))
    found: Array = np.diff(below, axis=0, prepend=0.0, append=1.0).T
    return found


def _share(values: NDArray[Any], design: Design) -> Array:
    found: Array = np.einsum("rps,ps->r", values, design.weights) / design.weights.sum()
    return found


def share_of_0(answers: Array, design: Design) -> Array:
    """Share of answers that are 0."""
    return _share(answers <= 0.0, design)


def share_of_1(answers: Array, design: Design) -> Array:
    """Share of answers that are 1."""
    return _share(answers >= 1.0, design)


def spread_of_answers(answers: Array, design: Design) -> Array:
    """Standard deviation of all answers."""
    centred = answers - _share(answers, design)[:, None, None]
    return np.sqrt(_share(centred**2, design))


def spread_of_means(answers: Array, design: Design) -> Array:
    """Standard deviation of participants' means."""
    kept = design.participants
    return _spread((answers * design.weights).sum(axis=2)[:, kept] / design.of_participant[kept])


def spread_of_noise(answers: Array, design: Design) -> Array:
    """Standard deviation of how far participants are, in root mean square, from what is theirs.

    That is their line on the means of the others' answers.
    """
    own, others, products, count = _with_others(answers, design)
    kept = count[0] > 0
    vary = others > _NO_SPREAD
    explained = np.where(vary, products, 0.0) ** 2 / np.where(vary, others, 1.0)
    squares = np.maximum(own - explained, 0.0)
    return _spread(np.sqrt(squares[:, kept] / count[:, kept]))


def correlation_between(answers: Array, design: Design) -> Array:
    """Mean correlation of a participant's answers with the means of the others'.

    It counts as 0 where either doesn't vary.
    """
    own, others, products, count = _with_others(answers, design)
    known = (squares := own * others) > _NO_SPREAD**2
    r: Array = np.where(known, products, 0.0) / np.sqrt(np.where(known, squares, 1.0))
    kept = r[:, count[0] > 0]
    return kept.mean(axis=1) if kept.shape[1] >= FEWEST else np.full(len(kept), np.nan)


def _with_others(answers: Array, design: Design) -> tuple[Array, Array, Array, Array]:
    """Each participant's answers with the means of the others', scenes that others answered.

    Returns
    -------
    ndarray, ndarray, ndarray, ndarray
        Sums of squares of the participant's answers and of the others' means, of their products,
        each about its mean, shape [replicate_count, participant_count], and how many scenes these
        are, [1, participant_count].
    """
    own, others = answers * design.weights, design.of_scene - design.weights
    means = (own.sum(axis=1, keepdims=True) - own) / np.maximum(others, 1.0)
    weights = design.weights * (others > 0)
    count = weights.sum(axis=1)
    x, y = (
        weights
        * (each - (weights * each).sum(axis=2, keepdims=True) / np.maximum(count, 1.0)[:, None])
        for each in (answers, means)
    )
    return (x**2).sum(axis=2), (y**2).sum(axis=2), (x * y).sum(axis=2), count[None]


def spread_of_slopes(answers: Array, design: Design) -> Array:
    """Standard deviation of the slopes of participants' answers on the judgments."""
    return _spread(_slopes(answers, design))


def kurtosis_of_slopes(answers: Array, design: Design) -> Array:
    """Kurtosis of these slopes: 3 if they are normal, 1 of two kinds, more if some are far off."""
    return _kurtosis(_slopes(answers, design))


def spread_of_residuals(answers: Array, design: Design) -> Array:
    """Standard deviation of scenes' means about their line on the judgments."""
    return _spread(_residuals(answers, design))


def kurtosis_of_residuals(answers: Array, design: Design) -> Array:
    """Kurtosis of these residuals."""
    return _kurtosis(_residuals(answers, design))


def curvature(answers: Array, design: Design) -> Array:
    """Correlation of these residuals with those of the squares of the judgments."""
    square = design.off_line @ design.judgments[design.scenes] ** 2
    return _correlation(_residuals(answers, design), square)


def r_with_judgments(answers: Array, design: Design) -> Array:
    """Correlation of scenes' means with the judgments."""
    return _correlation(_scene_means(answers, design), design.judgments[design.scenes])


def _slopes(answers: Array, design: Design) -> Array:
    """Of the participants who have one, shape [replicate_count, participant_count]."""
    means = design.weights @ design.judgments / np.maximum(design.of_participant, 1.0)
    z = design.weights * (design.judgments - means[:, None])
    squares = (z**2).sum(axis=1)
    kept = squares > _NO_SPREAD
    found: Array = np.einsum("rps,ps->rp", answers[:, kept], z[kept] / squares[kept, None])
    return found


def _scene_means(answers: Array, design: Design) -> Array:
    kept = design.scenes
    found: Array = (answers * design.weights).sum(axis=1)[:, kept] / design.of_scene[kept]
    return found


def _residuals(answers: Array, design: Design) -> Array:
    found: Array = _scene_means(answers, design) @ design.off_line
    return found


def _spread(values: Array) -> Array:
    """Of each row."""
    if values.shape[1] < FEWEST:
        return np.full(len(values), np.nan)
    found: Array = values.std(axis=1, ddof=1)
    return found


def _kurtosis(values: Array) -> Array:
    """Of each row."""
    if values.shape[1] < FEWEST:
        return np.full(len(values), np.nan)
    squares = (values - values.mean(axis=1, keepdims=True)) ** 2
    variance = squares.mean(axis=1)
    known = np.where(variance > _NO_SPREAD, variance, np.nan)
    found: Array = (squares**2).mean(axis=1) / known**2
    return found


def _correlation(rows: Array, values: Array) -> Array:
    """Of each row with the values."""
    x, y = rows - rows.mean(axis=1, keepdims=True), values - values.mean()
    squares = (x**2).sum(axis=1) * (y**2).sum()
    known = (len(values) >= FEWEST) & (squares > _NO_SPREAD**2)
    found: Array = x @ y / np.sqrt(np.where(known, squares, np.nan))
    return found


Replicated = Literal["same", "new"]
"""Whose answers are made anew: the same participants' to the same scenes, or new ones'."""

STATISTICS: dict[str, tuple[Replicated, Callable[[Array, Design], Array]]] = {
    "answers of 0": ("same", share_of_0),
    "answers of 1": ("same", share_of_1),
    "SD of answers": ("same", spread_of_answers),
    "SD of participants' noise": ("same", spread_of_noise),
    "r between participants": ("same", correlation_between),
    "SD of participants' means": ("new", spread_of_means),
    "SD of participants' slopes": ("new", spread_of_slopes),
    "kurtosis of participants' slopes": ("new", kurtosis_of_slopes),
    "SD of scenes' residuals": ("new", spread_of_residuals),
    "kurtosis of scenes' residuals": ("new", kurtosis_of_residuals),
    "curvature": ("new", curvature),
    "r with the model": ("new", r_with_judgments),
}
"""Name -> whose answers it is compared with, and the statistic. With the same participants' and
scenes', whose effects are fitted, what effects are like would be as in the data by construction."""
