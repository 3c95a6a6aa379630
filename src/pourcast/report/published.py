"""Published results (Bates et al. 2019, PLOS Computational Biology), for columns side by side.

Experiment 1: Pearson r over 120 scenes, with the 95 % interval where the paper gives
one. Experiment 2's values are not in here yet.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Published(NamedTuple):
    """A correlation, and its 95 % interval over participants."""

    r: float
    low: float
    high: float


EXP1_WATER: Mapping[str, Published] = MappingProxyType(
    {
        "water-ife": Published(0.92, 0.91, 0.93),
        "honey-ife-1": Published(0.76, 0.74, 0.78),
        "honey-ife-2": Published(0.81, 0.79, 0.82),
        "truth-water": Published(0.76, 0.74, 0.78),
        "truth-honey": Published(0.83, 0.81, 0.84),
        "water-convnet": Published(0.76, 0.74, 0.78),
        "honey-convnet": Published(0.85, 0.83, 0.86),
        "water-marble": Published(0.88, 0.86, 0.89),
        "honey-marble": Published(0.83, 0.81, 0.84),
        "water-simple": Published(0.75, 0.73, 0.77),
        "honey-simple": Published(0.68, 0.66, 0.70),
        "gravity": Published(0.58, 0.55, 0.60),
    }
)
"""Models with people's mean judgments, water trials (Experiment 1a)."""

EXP1_HONEY: Mapping[str, Published] = MappingProxyType(
    {
        "water-ife": Published(0.74, 0.71, 0.78),
        "honey-ife-1": Published(0.79, 0.76, 0.83),
        "honey-ife-2": Published(0.86, 0.83, 0.88),
        "truth-water": Published(0.48, 0.43, 0.53),
        "truth-honey": Published(0.73, 0.69, 0.76),
        "water-convnet": Published(0.52, 0.46, 0.56),
        "honey-convnet": Published(0.70, 0.65, 0.74),
        "water-marble": Published(0.76, 0.72, 0.79),
        "honey-marble": Published(0.84, 0.81, 0.87),
        "water-simple": Published(0.66, 0.62, 0.71),
        "honey-simple": Published(0.76, 0.73, 0.80),
        "gravity": Published(0.73, 0.70, 0.77),
    }
)
"""Models with people's mean judgments, honey trials (Experiment 1b)."""

EXP1_TRUTH_WATER: Mapping[str, float] = MappingProxyType(
    {
        "water-convnet": 0.91,
        "honey-convnet": 0.76,
        "water-simple": 0.56,
        "honey-simple": 0.38,
        "water-marble": 0.79,
        "honey-marble": 0.60,
        "gravity": 0.19,
    }
)
"""Models with the ground truth of water."""

EXP1_TRUTH_HONEY: Mapping[str, float] = MappingProxyType(
    {
        "water-convnet": 0.69,
        "honey-convnet": 0.82,
        "water-simple": 0.60,
        "honey-simple": 0.60,
        "water-marble": 0.78,
        "honey-marble": 0.78,
        "gravity": 0.53,
    }
)
"""Models with the ground truth of honey."""

EXP1_SPLIT_HALF: Mapping[str, Published] = MappingProxyType(
    {"water": Published(0.96, 0.94, 0.97), "honey": Published(0.81, 0.73, 0.86)}
)
"""Split-half correlation of participants."""


def with_people(experiment: str, liquid: str) -> Mapping[str, Published]:
    """Published correlations with people; none for what is not in here.

    Parameters
    ----------
    experiment
        ``exp1`` or ``exp2``.
    liquid
        ``water`` or ``honey``.
    """
    known = {("exp1", "water"): EXP1_WATER, ("exp1", "honey"): EXP1_HONEY}
    return known.get((experiment, liquid), MappingProxyType({}))
