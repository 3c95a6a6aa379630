"""Which of many scenes make a set as it is asked for, and are judged steadily: by exchanges.

What is asked is asked of the whole set, so that no scene is right or wrong by itself. From a good
guess on, exchanges of one scene for another find such a set, as in the exchange algorithms of
optimal design (Fedorov 1972, Theory of Optimal Experiments; Cook & Nachtsheim 1980, Technometrics
22, 315-324).
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError

Array = NDArray[np.float64]

TRUTH_WATER, TRUTH_HONEY, MODEL_WATER, MODEL_HONEY = range(4)
"""Rows of the judgments that scenes are chosen by."""

_PAIRS = [(a, b) for a in range(4) for b in range(a, 4)]
_FEWEST = 4
"""Of fewer scenes, correlations mean nothing: none are asked for."""

_ALLOWED = 1e-9
"""What is missed by no more than this is only rounding."""

_WEIGHTS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Of what is missed of the targets, against unsteadiness, one after another."""

_LAST_WEIGHT = 1000.0
"""So large that no steadiness makes up for a target."""

_POWERS = (1.0, 1.5)
"""Of what is missed: with 1, a target that is met is held; above, a little is given for others."""

_STEADY_STARTS = (0.0, 5.0)
"""How much of its unsteadiness is taken from a scene's contrast, for a first set."""


@dataclass(frozen=True)
class ContrastTargets:
    """What the judgments of the chosen scenes must have.

    Parameters
    ----------
    truths
        Largest correlation of the two ground truths, -1..1.
    models
        Largest correlation of the two models, -1..1.
    followed
        Least correlation of water's model with water's ground truth, -1..1.
    told_apart
        Largest correlation of the same, -1..1: where model and truth say the same, no answer tells
        which of them is in people's heads.
    spread, most_spread
        Least and largest standard deviation of each of the four, 0..0.5. Evenly spread judgments
        have 0.29; the nearer to 0.5, the more are all or nothing.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    truths: float = -0.65
    models: float = -0.65
    followed: float = 0.45
    told_apart: float = 0.85
    spread: float = 0.27
    most_spread: float = 0.35

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            low, high = (0.0, 0.5) if "spread" in name else (-1.0, 1.0)
            if not low <= value <= high:
                raise InputError(
                    f"contrast targets: {name}: expected {low:g} to {high:g}, found {value}"
                )

    def missed(self, totals: Array, count: int) -> dict[str, Array]:
        """By how much sets of scenes miss each target; 0 where they have it.

        Parameters
        ----------
        totals
            Sums over a set of its scenes' features, shape [feature_count, ...].
        count
            Scenes in a set.
        """
        mean = totals[:4] / count
        product = dict(zip(_PAIRS, totals[4:] / count, strict=False))
        variance = [np.maximum(product[a, a] - mean[a] ** 2, 1e-12) for a in range(4)]

        def r(a: int, b: int) -> Array:
            covariance = product[a, b] - mean[a] * mean[b]
            return np.asarray(covariance / np.sqrt(variance[a] * variance[b]))

        water = r(TRUTH_WATER, MODEL_WATER)
        narrowest, widest = (
            np.sqrt(extreme.reduce(variance)) for extreme in (np.minimum, np.maximum)
        )
        return {
            "correlation of the truths": np.maximum(r(TRUTH_WATER, TRUTH_HONEY) - self.truths, 0.0),
            "correlation of the models": np.maximum(r(MODEL_WATER, MODEL_HONEY) - self.models, 0.0),
            "correlation of water's model with its truth": np.maximum(
                np.maximum(self.followed - water, water - self.told_apart), 0.0
            ),
            "smallest standard deviation": np.maximum(self.spread - narrowest, 0.0),
            "largest standard deviation": np.maximum(widest - self.most_spread, 0.0),
        }


def choose_steady(
    judgments: Array,
    unsteadiness: Array,
    count: int,
    targets: ContrastTargets,
    *,
    lenient: bool = False,
) -> NDArray[np.int64]:
    """The set of scenes that has what is asked and is judged most steadily, by exchanges.

    From the scenes of the largest contrast on, and from steadier ones, one is exchanged for another
    of its direction, the best such exchange each time: it brings the set nearer to the targets, or
    makes it steadier. That ends where no exchange betters the set.

    Parameters
    ----------
    judgments
        Water's truth, honey's, water's model, honey's; shape [4, scene_count].
    unsteadiness
        Variance of each scene's judgments over what they should not hang on, shape [scene_count].
    count
        How many are wanted; half of them (of an odd number one more) with more water in the
        goal, half with more honey, both by truths and by models.
    targets
        What the set must have, if it has four scenes or more.
    lenient
        Whether the nearest set is taken if none is found that has it; if too few scenes have a
        direction, the half of all that comes nearest to it stands for it.

    Returns
    -------
    ndarray
        Numbers of the scenes, in ascending order.

    Raises
    ------
    InputError
        If there are too few scenes, or too few of a direction, or no set is found that has what is
        asked; says which.
    """
    direction = _directions(judgments)
    if lenient and min(np.sum(direction == sign) for sign in (1, -1)) < (count + 1) // 2:
        direction = _halves(judgments)
    contrast = np.min(np.abs(judgments[::2] - judgments[1::2]), axis=0)
    starts = [_highest(contrast - k * unsteadiness, direction, count) for k in _STEADY_STARTS]
    features = np.stack([*_features(judgments), unsteadiness])
    if count < _FEWEST:
        return np.sort(starts[0])
    ways = [
        _Exchange(features, direction, targets, power).better(start)
        for power in _POWERS
        for start in starts
    ]
    last = _Exchange(features, direction, targets)
    found = min(ways, key=last.cost_of)
    short = [f"the {name} by {by:.2g}" for name, by in missed(judgments[:, found], targets).items()]
    if short and not lenient:
        raise InputError(f"found no {count} scenes as asked; the nearest miss {', '.join(short)}")
    return np.sort(found)


def missed(judgments: Array, targets: ContrastTargets) -> dict[str, float]:
    """What a set of scenes misses of the targets, and by how much.

    Parameters
    ----------
    judgments
        Water's truth, honey's, water's model, honey's; shape [4, scene_count].
    targets
        What was asked, of four scenes or more.
    """
    count = judgments.shape[1]
    if count < _FEWEST:
        return {}
    totals = np.stack(_features(judgments)).sum(axis=1)
    by_target = targets.missed(totals, count)
    return {name: float(by) for name, by in by_target.items() if by > _ALLOWED}


def _features(judgments: Array) -> list[Array]:
    """Judgments and their products, whose means decide what a set has."""
    return [*judgments, *(judgments[a] * judgments[b] for a, b in _PAIRS)]


def _directions(judgments: Array) -> NDArray[np.int64]:
    """1 for more water by truths and models, -1 for more honey by both, else 0; [scene_count]."""
    by_truth, by_model = np.sign(judgments[::2] - judgments[1::2]).astype(np.int64)
    return np.where(by_truth == by_model, by_truth, 0)


def _halves(judgments: Array) -> NDArray[np.int64]:
    """1 for the half of all scenes with more water or less honey than the others, -1 for these."""
    contrast = np.sum(judgments[::2] - judgments[1::2], axis=0)
    rank = np.argsort(np.argsort(-contrast, kind="stable"))
    return np.where(rank < (len(contrast) + 1) // 2, 1, -1)


def _highest(values: Array, direction: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Scenes of the highest values, half of them of either direction."""
    chosen = []
    for sign, words, wanted in ((1, "water", (count + 1) // 2), (-1, "honey", count // 2)):
        there = np.flatnonzero(direction == sign)
        if len(there) < wanted:
            raise InputError(
                f"expected {wanted} scenes with more {words} in the goal by truths and models, "
                f"found {len(there)}"
            )
        chosen.append(there[np.argsort(-values[there], kind="stable")][:wanted])
    return np.concatenate(chosen)


@dataclass(frozen=True)
class _Exchange:
    """Betters a set of scenes by exchanging one for another of its direction, again and again.

    Parameters
    ----------
    features
        What is summed over a set, shape [feature_count, scene_count]: four judgments, their ten
        products, unsteadiness.
    direction
        Of each scene, shape [scene_count].
    targets
        What the set must have.
    power
        Of what is missed of them, in the cost.
    """

    features: Array
    direction: NDArray[np.int64]
    targets: ContrastTargets
    power: float = 1.0

    def better(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """A set that no exchange betters.

        Targets count little at first and more and more then, as at once they would hold the set
        where it is.
        """
        for weight in _WEIGHTS:
            chosen = self._settled(chosen, partial(self._cost, weight, self.power))
        return self._settled(chosen, partial(self._cost, _LAST_WEIGHT, 1))

    def cost_of(self, chosen: NDArray[np.int64]) -> float:
        """What the last exchanges lower."""
        return float(self._cost(_LAST_WEIGHT, 1, self._totals(chosen), len(chosen)))

    def _settled(
        self, chosen: NDArray[np.int64], cost: Callable[[Array, int], Any]
    ) -> NDArray[np.int64]:
        """The best exchange made until none lowers the cost: as sets are finitely many, it ends."""
        count, chosen = len(chosen), chosen.copy()
        while True:
            totals = self._totals(chosen)
            best = float(cost(totals, count)) - _ALLOWED, -1, -1
            for sign in (1, -1):
                leaving = np.flatnonzero(self.direction[chosen] == sign)
                coming = np.setdiff1d(np.flatnonzero(self.direction == sign), chosen)
                if not len(coming):
                    continue
                old, new = self.features[:, chosen[leaving], None], self.features[:, None, coming]
                costs = cost(totals[:, None, None] + new - old, count)
                place = divmod(int(np.argmin(costs)), len(coming))
                best = min(
                    best, (float(costs[place]), int(leaving[place[0]]), int(coming[place[1]]))
                )
            _, leaves, comes = best
            if comes < 0:
                return chosen
            chosen[leaves] = comes

    def _totals(self, chosen: NDArray[np.int64]) -> Array:
        totals: Array = np.sum(self.features[:, chosen], axis=1)
        return totals

    def _cost(self, weight: float, power: float, totals: Array, count: int) -> Any:
        """Shape of `totals` but for the first axis."""
        missed = sum(by**power for by in self.targets.missed(totals, count).values())
        return weight * missed + totals[-1] / count
