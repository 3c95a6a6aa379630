"""What the paper publishes about models alone, and how near a point must come to it.

Tolerances were written down before any point was measured:

- ten **correlations** of heuristics and marbles with both ground truths, as Fisher's z. The
  paper's own 120 scenes leave a standard deviation of 1 / sqrt(117) = 0.092; for what our engine
  never shares with theirs (kernel, packing, integrator) stands a discrepancy of 0.05.
- three **variances** over the window of zeta, as logarithms. Sampling of 120 scenes is measured
  (`Tolerances.variance_sampling`); a discrepancy of log(2) / 2 makes a factor of two two standard
  deviations.
- **bounds** from people's columns: a correlation matrix is positive semi-definite, so that two
  models which correlate a and b with the same people correlate a b +- sqrt((1 - a^2)(1 - b^2))
  with one another (Stanley and Wang 1969); both groups of people must agree. Only beyond them
  does a point lose, with the same deviations.
- one bound of our own: honey may not stay on the obstacles, of the undamped pour a tenth at most
  (discrepancy 0.05), for judgments of what hasn't come down say nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from pourcast.study.experiments.base import Published
from pourcast.study.experiments.exp1 import PUBLISHED

Kind = Literal["correlation", "variance", "bound", "stranded"]

RIVALS = ("gravity", "water-simple", "honey-simple", "water-marble", "honey-marble")
TRUTHS = ("truth-water", "truth-honey")
IFES = ("water-ife", "honey-ife-1", "honey-ife-2")
MODELS = (*TRUTHS, *IFES, *RIVALS)

VARIANCES = {"water-ife": 0.003, "honey-ife-1": 0.002, "honey-ife-2": 0.003}
"""Published variance over the window of zeta, mean over the scenes."""

PAPER_SCENES = 120

CORRELATION_DISCREPANCY = 0.05
VARIANCE_DISCREPANCY = float(np.log(2.0) / 2.0)
MOST_STRANDED = 0.1
STRANDED_DISCREPANCY = 0.05


@dataclass(frozen=True)
class Target:
    """One output, and what it should be.

    Parameters
    ----------
    name
        ``model / model`` for correlations and bounds, else the model.
    kind
        What it is.
    low, high
        What it should be, on its emulator's scale (Fisher's z; logarithm; share): an interval for
        bounds, twice the same value otherwise.
    variance
        Of the paper's value and of the discrepancy together, on that scale.
    """

    name: str
    kind: Kind
    low: float
    high: float
    variance: float

    @property
    def exact(self) -> bool:
        """Whether the paper gives the value itself."""
        return self.kind in ("correlation", "variance")


def people_bounds(
    first: str, second: str, people: Mapping[str, Mapping[str, Published]] | None = None
) -> tuple[float, float]:
    """Interval in which two models' correlation must lie, from their correlations with people.

    Parameters
    ----------
    first, second
        The models.
    people
        Group of people -> model -> correlation; the paper's by default.

    Examples
    --------
    >>> [round(r, 3) for r in people_bounds("water-ife", "truth-water")]
    [0.445, 0.945]
    """
    low, high = -1.0, 1.0
    for column in (people or PUBLISHED.with_people).values():
        a, b = column[first].r, column[second].r
        room = float(np.sqrt((1.0 - a * a) * (1.0 - b * b)))
        low, high = max(low, a * b - room), min(high, a * b + room)
    return low, high


def targets(variance_sampling: Mapping[str, float]) -> list[Target]:
    """All of them, the paper's own values first.

    Parameters
    ----------
    variance_sampling
        Model -> variance of the logarithm of the mean over one scene; a hundred and twenty have
        that over 120.
    """
    sampling = 1.0 / (PAPER_SCENES - 3) + CORRELATION_DISCREPANCY**2
    found = []
    for truth in TRUTHS:
        for rival in RIVALS:
            z = float(np.arctanh(PUBLISHED.with_truth[truth][rival]))
            found.append(Target(f"{rival} / {truth}", "correlation", z, z, sampling))
    for model, value in VARIANCES.items():
        spread = variance_sampling[model] / PAPER_SCENES + VARIANCE_DISCREPANCY**2
        found.append(Target(model, "variance", *2 * (float(np.log(value)),), spread))
    known = {target.name for target in found}
    for first, second in combinations(MODELS, 2):
        if not {f"{first} / {second}", f"{second} / {first}"} & known:
            low, high = np.arctanh(people_bounds(first, second))
            found.append(Target(f"{first} / {second}", "bound", float(low), float(high), sampling))
    found.append(Target("truth-honey", "stranded", 0.0, MOST_STRANDED, STRANDED_DISCREPANCY**2))
    return found
