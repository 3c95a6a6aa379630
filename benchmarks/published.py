"""Experiment 1's correlations as published (Bates et al. 2019), models against ground truth.

Over 120 scenes; the two columns of the paper's table that don't need people.
"""

from types import MappingProxyType

WITH_TRUTH_WATER = MappingProxyType(
    {
        "water-simple": 0.56,
        "honey-simple": 0.38,
        "gravity": 0.19,
        "water-marble": 0.79,
        "honey-marble": 0.60,
    }
)

WITH_TRUTH_HONEY = MappingProxyType(
    {
        "water-simple": 0.60,
        "honey-simple": 0.60,
        "gravity": 0.53,
        "water-marble": 0.78,
        "honey-marble": 0.78,
    }
)
