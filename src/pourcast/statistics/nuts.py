"""Posteriors drawn by NUTS (Hoffman & Gelman 2014), and whether their chains agree.

R-hat and effective sample sizes are the rank-normalised ones of Vehtari, Gelman, Simpson,
Carpenter & Bürkner (2021), Bayesian Analysis 16, by ArviZ; NUTS is NumPyro's.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
import pandas as pd
from arviz_stats.base import array_stats
from numpy.typing import NDArray
from numpyro.infer import MCMC, NUTS, init_to_median
from platformdirs import user_cache_dir

from pourcast.cores import available_cores
from pourcast.statistics.sampling import Sampling

# Compiling takes ten seconds: the next process finds it done.
jax.config.update("jax_compilation_cache_dir", user_cache_dir("pourcast-jax"))

Array = NDArray[np.float64]

_TAILS = (0.05, 0.95)
"""Quantiles whose effective sample size is that of the tails."""


@dataclass(frozen=True)
class Posterior:
    """What NUTS has drawn.

    Parameters
    ----------
    draws
        Name -> draws, shape [chain_count, draw_count, ...].
    divergences
        Draws whose trajectory broke; where there are any, some of the posterior may not have been
        reached.
    """

    draws: Mapping[str, Array]
    divergences: int

    def flat(self, name: str, most: int | None = None) -> Array:
        """Draws of all chains together; shape [draw_count, ...].

        Parameters
        ----------
        name
            What was drawn.
        most
            At most so many of them, evenly spaced.
        """
        drawn = self.draws[name]
        together = drawn.reshape(-1, *drawn.shape[2:])
        return together[:: max(1, -(-len(together) // (most or len(together))))]

    def summary(self, names: Sequence[str], level: float) -> pd.DataFrame:
        """Means, intervals and diagnostics.

        Parameters
        ----------
        names
            Of single numbers.
        level
            Of the intervals.

        Returns
        -------
        DataFrame
            A row each: `parameter`, `mean`, `low`, `high` (quantiles), `r_hat`, `ess_bulk`,
            `ess_tail`, `divergences` (of the whole posterior).
        """
        draws = np.stack([self.draws[name] for name in names])
        tails = (0.5 - level / 2.0, 0.5 + level / 2.0)
        low, high = np.quantile(draws, tails, axis=(1, 2))
        return pd.DataFrame(
            {
                "parameter": names,
                "mean": draws.mean(axis=(1, 2)),
                "low": low,
                "high": high,
                "r_hat": array_stats.rhat(draws),
                "ess_bulk": array_stats.ess(draws, method="bulk"),
                "ess_tail": array_stats.ess(draws, method="tail", prob=_TAILS),
                "divergences": self.divergences,
            }
        )


class Sampler:
    """NUTS for a model: compiled once for data of a shape, run on any number of data sets.

    Parameters
    ----------
    model
        A model of NumPyro's, a function of the data.
    sampling
        How posteriors are drawn.
    """

    diverging = "diverging"
    """Name by which the kernel tells of a broken trajectory."""

    def __init__(self, model: Callable[..., None], sampling: Sampling | None = None) -> None:
        self.sampling = sampling or Sampling()
        self._model = model
        self._compiled: dict[tuple[tuple[int, ...], ...], Any] = {}

    def kernel(self, *data: Any) -> Any:
        """What makes the steps of a chain."""
        return NUTS(self._model, init_strategy=init_to_median)

    def _chain(self, key: Any, *data: Any) -> Any:
        mcmc = MCMC(
            self.kernel(*data),
            num_warmup=self.sampling.warmup,
            num_samples=self.sampling.draws,
            progress_bar=False,
        )
        mcmc.run(key, *data, extra_fields=(self.diverging,))
        return mcmc.get_samples(), mcmc.get_extra_fields()[self.diverging].sum()

    def posteriors(
        self, data: Sequence[tuple[Any, ...]], seed: int | None = None
    ) -> Iterator[Posterior]:
        """Posteriors of data sets, in their order, as they get done.

        Chains run side by side on all cores; draws don't depend on how many those are.

        Parameters
        ----------
        data
            Of each data set, the arrays that the model takes; of the same shapes.
        seed
            In place of the sampling's; each data set has the same.
        """
        if not data:
            return
        key = jax.random.PRNGKey(self.sampling.seed if seed is None else seed)
        keys = jax.random.split(key, self.sampling.chains)
        shapes = tuple(np.shape(each) for each in data[0])
        if shapes not in self._compiled:
            # Here, as threads that meet a function which is not compiled all compile it.
            self._compiled[shapes] = jax.jit(self._chain).lower(keys[0], *data[0]).compile()
        run = self._compiled[shapes]
        with ThreadPoolExecutor(min(available_cores(), len(data) * len(keys))) as pool:
            chains = [[pool.submit(_arrays, run, key, one) for key in keys] for one in data]
            for each in chains:
                yield _joined([chain.result() for chain in each])

    def posterior(self, *data: Any, seed: int | None = None) -> Posterior:
        """Posterior of one data set."""
        [found] = self.posteriors([data], seed)
        return found


def _arrays(run: Callable[..., Any], key: Any, data: tuple[Any, ...]) -> Any:
    return jax.tree.map(np.asarray, run(key, *data))


def _joined(chains: Sequence[Any]) -> Posterior:
    names = chains[0][0]
    draws = {name: np.stack([drawn[name] for drawn, _ in chains]) for name in names}
    return Posterior(draws, int(sum(diverging for _, diverging in chains)))
