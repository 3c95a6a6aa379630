"""Random halves of participants or scenes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def random_halves(count: int, halvings: int, rng: np.random.Generator) -> Array:
    """Half of `count` things, chosen at random many times: 1 if chosen, shape [halvings, count].

    Of an odd number, the chosen half is the smaller.
    """
    ranks = rng.random((halvings, count)).argsort(axis=1).argsort(axis=1)
    chosen: Array = (ranks < count // 2).astype(float)
    return chosen
