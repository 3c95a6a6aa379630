"""How much is drawn of a posterior, and by it; known without what draws it."""

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
    replicates
        Data sets that are made by it anew, of the same participants and scenes, and of new ones.
    seed
        Source of all randomness.
    """

    warmup: int = 500
    draws: int = 500
    chains: int = 4
    replicates: int = 1000
    seed: int = 0
