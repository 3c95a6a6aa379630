"""How much is drawn of a posterior; known without what draws it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sampling:
    """How the posterior is drawn.

    Parameters
    ----------
    warmup, draws
        Steps of each chain before and after adaptation.
    chains
        Number of chains.
    seed
        Source of all randomness.
    """

    warmup: int = 500
    draws: int = 500
    chains: int = 4
    seed: int = 0
