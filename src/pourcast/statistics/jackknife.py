"""Standard errors of any measure of agreement, by leaving out: other people, other scenes, or both.

Each participant, each scene and each single answer is left out in turn (Tukey's jackknife; Efron &
Stein 1981, Annals of Statistics 9). Nothing is drawn, so the same data give the same interval. A
bootstrap of people would put their noise into the means twice: its correlations lie below the one
that was observed, the more the nearer that is to its ceiling.

Measures are put on a scale on which their errors are normal (`SCALES`); intervals are those of
Student's t on that scale, and so are centred on what was observed.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from pourcast.statistics.correlation import MEASURES, Agreement, pearson

Array = NDArray[np.float64]

Over = Literal["participants", "scenes", "both"]
"""What a conclusion holds over: other participants with these scenes (the paper's intervals),
other scenes with these participants, or both."""


def over_words(over: str) -> str:
    """What a conclusion holds over, in words.

    Examples
    --------
    >>> over_words("both")
    'participants and scenes'
    >>> over_words("participants")
    'participants (these scenes)'
    """
    words = {"both": "participants and scenes", "participants": "participants (these scenes)"}
    return words.get(over, "scenes (these participants)")


LEVEL = 0.95
"""Of intervals, unless it is said; whatever makes one is told the level."""

FEWEST = 5
"""Participants, or scenes, without which there is no interval over them."""

Measure = Callable[[Array, Array], Array]
"""From people's mean judgments and how often each scene counts, both of shape
[case_count, scene_count], to measures of shape [case_count, measure_count]."""

_MOST_PAIRS = 20_000
"""Pairs of participants that are left out together, of more only some."""
_BLOCK = 256
"""Cases that are measured at once: as many as stay near the processor."""
_LEAST = 1e-12
"""What is positive and less is 0 but for rounding."""
_LARGEST_Z = 18.0
"""Fisher's z of a correlation that is 1 but for rounding."""


@dataclass(frozen=True)
class Scale:
    """A scale on which errors of a measure are normal.

    Parameters
    ----------
    there, back
        To the scale, and from it.
    """

    there: Callable[[Array], Array]
    back: Callable[[Array], Array]


def fisher_z(r: Array) -> Array:
    """Fisher's z of correlations.

    Examples
    --------
    >>> float(fisher_z(np.array(0.9)).round(3))
    1.472
    """
    with np.errstate(divide="ignore"):
        z: Array = np.clip(np.arctanh(r), -_LARGEST_Z, _LARGEST_Z)
    return z


def _log(values: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(np.maximum(values, _LEAST))


IDENTITY = Scale(np.asarray, np.asarray)
CORRELATION = Scale(fisher_z, np.tanh)
POSITIVE = Scale(_log, np.exp)
"""Of measures that are never negative."""
SCALES = {"r": CORRELATION, "rmse": POSITIVE, "bias": IDENTITY, "slope": IDENTITY}
"""Of the measures of agreement."""
SHARE = Scale(lambda share: -_log(1.0 - share), lambda x: 1.0 - np.exp(-x))
"""Of measures below 1, as a reliability."""


def scaled(measures: Agreement) -> Array:
    """All measures of agreement side by side, each on its scale.

    Shape [case_count, 4 x model_count], or [4 x model_count].
    """
    return np.hstack([SCALES[name].there(getattr(measures, name)) for name in MEASURES])


@dataclass(frozen=True)
class Estimate:
    """Values on their scale, and how well they are known.

    Parameters
    ----------
    value
        What was observed.
    variance
        Of its error; NaN where there are too few to tell.
    df
        Degrees of freedom of Student's t.
    """

    value: Array
    variance: Array
    df: Array

    def interval(self, level: float) -> tuple[Array, Array]:
        """Limits on the scale; NaN where there are too few to tell."""
        reach = stats.t.ppf(0.5 + level / 2.0, self.df) * np.sqrt(self.variance)
        return self.value - reach, self.value + reach

    @property
    def p(self) -> Array:
        """Two-sided p value of 0; 1 where nothing differs at all."""
        error = np.sqrt(self.variance)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.abs(self.value) / error
        t = np.where((self.value == 0.0) & (error == 0.0), 0.0, t)
        p: Array = np.asarray(2.0 * stats.t.sf(t, self.df))
        return p

    def __getitem__(self, which: slice | NDArray[np.int64]) -> "Estimate":
        return Estimate(self.value[which], self.variance[which], self.df[which])


def unknowable(over: Over, participants: int, scenes: int) -> str:
    """Why there is no interval over these; empty if there is one.

    Parameters
    ----------
    over
        What it would hold over.
    participants, scenes
        How many there are; no participants where only means are known.

    Examples
    --------
    >>> unknowable("both", 1, 30)
    'an interval over participants needs at least 5 of them, not 1'
    """
    if participants == 0 and over != "scenes":
        return "an interval over participants needs their answers, and only means are known"
    counts = {"participants": participants, "scenes": scenes}
    for what, count in counts.items():
        if over in (what, "both") and count < FEWEST:
            return f"an interval over {what} needs at least {FEWEST} of them, not {count}"
    return ""


def jackknife(responses: Array, measure: Measure, over: Over) -> Estimate:
    """Measures of people's mean judgments, with the variance of their errors.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    measure
        What is measured, on a scale on which errors are normal.
    over
        What varies from study to study.

    Returns
    -------
    Estimate
        Arrays of shape [measure_count].

    Notes
    -----
    *Participants.* Near its ceiling, r depends on noise in the second order, which a jackknife
    counts twice. Half of what Efron & Stein (1981, eq. 4.1) estimate of it, from pairs that are
    left out, is taken off: all of it is too much with ten participants.

    *Both.* Noise of single answers is in the variance over participants and in that over scenes;
    it is taken off once (as in two-way clustered standard errors, Cameron, Gelbach & Miller 2011).
    No less than either variance is left. Degrees of freedom: Satterthwaite (1946), from how much
    participants and scenes differ in what they contribute.
    """
    answers = _Answers(responses)
    value = measure(*answers.all())[0]
    people, scenes = responses.shape
    nothing = np.full(value.shape, np.nan)
    if unknowable(over, people, scenes):
        return Estimate(value, nothing, nothing)
    if over == "participants":
        return Estimate(value, *_over_people(answers, measure))
    of_scenes, df_scenes = _spread(_measured(answers.without_scenes(), measure))
    if over == "scenes":
        return Estimate(value, of_scenes, df_scenes)
    of_people, df_people = _over_people(answers, measure)
    sum_of_both = of_people + of_scenes
    least = np.maximum(of_people, of_scenes)
    variance = np.maximum(sum_of_both - _of_single_answers(answers, measure), least)
    squares = of_people**2 / df_people + of_scenes**2 / df_scenes
    with np.errstate(divide="ignore", invalid="ignore"):
        df = np.where(squares > 0.0, sum_of_both**2 / squares, 1.0)
    return Estimate(value, variance, np.clip(df, 1.0, max(people, scenes) - 1.0))


def over_units(each: Array) -> Estimate:
    """Sums over units, such as scenes, that others might have been in the place of.

    Parameters
    ----------
    each
        What each unit adds, shape [unit_count, sum_count].

    Returns
    -------
    Estimate
        Arrays of shape [sum_count].
    """
    n = len(each)
    return Estimate(each.sum(axis=0), *_spread(each * (n / (n - 1.0))))


def r_interval(responses: Array, models: Array, over: Over, level: float) -> tuple[Array, Array]:
    """Interval of each model's correlation with people's mean judgments.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count]; NaN where there is no answer.
    models
        Judgments, shape [model_count, scene_count].
    over
        What it holds over.
    level
        Its level.

    Returns
    -------
    ndarray, ndarray
        Limits, shape [model_count].
    """
    z = jackknife(responses, lambda m, w: fisher_z(pearson(m, models, w)), over)
    low, high = z.interval(level)
    return np.tanh(low), np.tanh(high)


class _Answers:
    """Sums and counts of answers, from which means are made with some of them left out."""

    def __init__(self, responses: Array) -> None:
        self.there = np.isfinite(responses)
        self.values = np.where(self.there, responses, 0.0)
        self.total, self.count = self.values.sum(axis=0), self.there.sum(axis=0)

    def all(self) -> tuple[Array, Array]:
        return self._means(self.total[None], self.count[None])

    def without_people(self, *left_out: NDArray[np.int64]) -> Iterator[tuple[Array, Array]]:
        """Means without one person, or without two, in each case."""
        cases = len(left_out[0])
        for first in range(0, cases, _BLOCK):
            block = slice(first, first + _BLOCK)
            total = self.total - sum(self.values[each[block]] for each in left_out)
            count = self.count - sum(self.there[each[block]].astype(int) for each in left_out)
            yield self._means(total, count)

    def without_scenes(self) -> Iterator[tuple[Array, Array]]:
        means, weights = self.all()
        left = weights * (1.0 - np.eye(means.shape[1]))
        yield np.broadcast_to(means, left.shape), left

    def without_answers(
        self, who: NDArray[np.int64], scenes: NDArray[np.int64]
    ) -> Iterator[tuple[Array, Array]]:
        """Means without one answer in each case."""
        for first in range(0, len(who), _BLOCK):
            person, scene = who[first : first + _BLOCK], scenes[first : first + _BLOCK]
            case = np.arange(len(scene))
            total, count = (np.tile(each, (len(scene), 1)) for each in (self.total, self.count))
            total[case, scene] -= self.values[person, scene]
            count[case, scene] -= 1
            yield self._means(total, count)

    @staticmethod
    def _means(total: Array, count: Array) -> tuple[Array, Array]:
        means = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
        return means, (count > 0).astype(float)


def _measured(cases: Iterator[tuple[Array, Array]], measure: Measure) -> Array:
    return np.concatenate([measure(means, weights) for means, weights in cases])


def _spread(values: Array) -> tuple[Array, Array]:
    """The jackknife's variance, from the values with each of n left out, and how well it is known.

    Degrees of freedom: twice the square of the variance over its own variance, which grows with
    the kurtosis. Where a few scenes decide (judgments near 0 and 1 do that), n - 1 is too many.
    """
    n = len(values)
    squares = (values - values.mean(axis=0)) ** 2
    variance: Array = (n - 1.0) / n * squares.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        kurtosis = (squares**2).mean(axis=0) / squares.mean(axis=0) ** 2
        df = np.where(kurtosis > 1.0, 2.0 * n / (kurtosis - 1.0), n - 1.0)
    return variance, np.clip(df, 2.0, n - 1.0)


def _over_people(answers: _Answers, measure: Measure) -> tuple[Array, Array]:
    """Variance over participants, less half of what noise of the second order adds to it."""
    n = len(answers.there)
    value = measure(*answers.all())[0]
    single = _measured(answers.without_people(np.arange(n)), measure)
    first, second = pairs(n)
    double = _measured(answers.without_people(first, second), measure)
    interaction = n * value - (n - 1.0) * (single[first] + single[second]) + (n - 2.0) * double
    noise = interaction.var(axis=0) / 2.0
    variance, df = _spread(single)
    return np.maximum(variance - 0.5 * noise, 0.5 * variance), df


def pairs(count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of different numbers below `count`: all, or as many of each as there is time for.

    Examples
    --------
    >>> [len(pairs(count)[0]) for count in (5, 300)]
    [10, 19800]
    """
    if count * (count - 1) // 2 <= _MOST_PAIRS:
        return np.triu_indices(count, 1)
    steps = np.arange(1, max(2, _MOST_PAIRS // count + 1))
    first = np.repeat(np.arange(count), len(steps))
    return first, (first + np.tile(steps, count)) % count


def _of_single_answers(answers: _Answers, measure: Measure) -> Array:
    """Variance as if each answer were independent of all others: the sum of scenes' jackknifes."""
    scenes, who = np.nonzero(answers.there.T & (answers.count > 1)[:, None])
    if not len(who):
        return np.zeros(1)
    values = _measured(answers.without_answers(who, scenes), measure)
    first = np.flatnonzero(np.diff(scenes, prepend=-1))
    n = np.diff(first, append=len(scenes))[:, None]
    means = np.add.reduceat(values, first) / n
    squares = np.add.reduceat((values - np.repeat(means, n[:, 0], axis=0)) ** 2, first)
    variance: Array = ((n - 1.0) / n * squares).sum(axis=0)
    return variance
