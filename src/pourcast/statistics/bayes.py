"""Likelihood of single answers: ordered beta regression with participant effects and lapses.

Kubinec (2023), "Ordered beta regression: a parsimonious, well-fitting model for continuous
data with lower and upper bounds", Political Analysis 31. With eta the linear predictor and
two cut points c1 < c2,

    P(y = 0) = 1 - logistic(eta - c1),    P(y = 1) = logistic(eta - c2),

and in between a beta density with mean logistic(eta) and precision phi. Here

    eta = intercept + u_p + (slope + v_p) x,    x = logit of the model's judgment,

with normal effects u_p, v_p of the participant; with the probability `lapse` the answer
is anywhere on the slider instead. Fitted by NUTS (NumPyro), compared by PSIS-LOO.

Needs the extra ``pourcast[bayes]``.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pandas as pd
from jax.nn import log_sigmoid, sigmoid
from jax.scipy.special import gammaln
from numpy.typing import NDArray
from numpyro.infer import MCMC, NUTS, init_to_median
from platformdirs import user_cache_dir
from scipy.special import logit

from pourcast.progress import Report, no_report
from pourcast.statistics.jackknife import LEVEL

with warnings.catch_warnings():
    # ArviZ tells of its next major version, which pyproject.toml keeps out.
    warnings.simplefilter("ignore", FutureWarning)
    import arviz as az

# Compiling takes ten seconds: the next process finds it done.
jax.config.update("jax_compilation_cache_dir", user_cache_dir("pourcast-jax"))

Array = NDArray[np.float64]

PARAMETERS = ("intercept", "slope", "spread_intercept", "spread_slope", "precision", "lapse",
              "cut_low", "cut_high")  # fmt: skip
"""What is estimated for the population; each participant's effects beside."""


SHRINKAGE = 100.0
"""Judgments of 0 and 1 have no logit: they count as if by so many particles and a half more."""

LAPSE_ENDS = 0.01
"""Share of lapses that are exactly 0 or 1: the slider's step."""

_COMPARED = ("elpd_diff", "dse", "weight")
_BAD_K = 0.7


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

    warmup: int = 1000
    draws: int = 1000
    chains: int = 2
    seed: int = 0


def predictor(judgments: Array) -> Array:
    """Logit of judgments, drawn in from 0 and 1 a little.

    Examples
    --------
    >>> predictor(np.array([0.5, 1.0])).round(2).tolist()
    [0.0, 5.3]
    """
    x: Array = logit((judgments * SHRINKAGE + 0.5) / (SHRINKAGE + 1.0))
    return x


def _log_density(answers: Any, eta: Any, precision: Any, low: Any, high: Any, lapse: Any) -> Any:
    """Log density of answers, or of their probability if they are 0 or 1, by JAX."""
    mean = sigmoid(eta)
    inner = jnp.clip(answers, 1e-6, 1.0 - 1e-6)
    gap = jnp.maximum(sigmoid(eta - low) - sigmoid(eta - high), 1e-30)
    a, b = mean * precision, (1.0 - mean) * precision
    # Written out: the first term is one number, and the logarithms don't change.
    between = jnp.log(gap) + gammaln(precision) - gammaln(a) - gammaln(b)
    between += (a - 1.0) * jnp.log(inner) + (b - 1.0) * jnp.log1p(-inner)
    ends = jnp.where(answers <= 0.0, log_sigmoid(low - eta), log_sigmoid(eta - high))
    at_end = (answers <= 0.0) | (answers >= 1.0)
    attentive = jnp.log1p(-lapse) + jnp.where(at_end, ends, between)
    lapsed = jnp.log(lapse) + jnp.where(at_end, np.log(LAPSE_ENDS / 2.0), np.log1p(-LAPSE_ENDS))
    return jnp.logaddexp(attentive, lapsed)


def _model(answers: Any, answered: Any, x: Any) -> None:
    """One liquid's answers, shape [participant_count, scene_count], and x, shape [scene_count]."""
    people = answers.shape[0]
    intercept = numpyro.sample("intercept", dist.Normal(0.0, 1.0))
    slope = numpyro.sample("slope", dist.Normal(0.5, 0.5))
    spread_intercept = numpyro.sample("spread_intercept", dist.HalfNormal(0.5))
    spread_slope = numpyro.sample("spread_slope", dist.HalfNormal(0.3))
    precision = numpyro.sample("precision", dist.LogNormal(2.0, 1.0))
    lapse = numpyro.sample("lapse", dist.Beta(1.0, 15.0))
    cut_low = numpyro.sample("cut_low", dist.Normal(-4.0, 1.5))
    cut_gap = numpyro.sample("cut_gap", dist.LogNormal(2.0, 0.5))
    cut_high = numpyro.deterministic("cut_high", cut_low + cut_gap)
    with numpyro.plate("participants", people):
        # Centred: with many trials each, participants' effects are known well.
        own_intercept = numpyro.sample("own_intercept", dist.Normal(intercept, spread_intercept))
        own_slope = numpyro.sample("own_slope", dist.Normal(slope, spread_slope))
    eta = own_intercept[:, None] + own_slope[:, None] * x[None, :]
    log_density = _log_density(answers, eta, precision, cut_low, cut_high, lapse)
    numpyro.factor("answers", jnp.where(answered, log_density, 0.0).sum())
    numpyro.deterministic("log_density", log_density)


class ResponseModel:
    """The response model for data of one shape: compiled once, fitted to any number of data sets.

    Parameters
    ----------
    sampling
        How posteriors are drawn.
    """

    def __init__(self, sampling: Sampling | None = None) -> None:
        self._sampling = sampling or Sampling()
        # One function for all chains and data sets: `MCMC.run` by itself compiles each time.
        self._chain = jax.jit(self._run_chain)

    def _run_chain(self, key: Any, answers: Any, answered: Any, x: Any) -> Any:
        mcmc = MCMC(
            NUTS(_model, init_strategy=init_to_median),
            num_warmup=self._sampling.warmup,
            num_samples=self._sampling.draws,
            progress_bar=False,
        )
        mcmc.run(key, answers, answered, x)
        return mcmc.get_samples()

    def fit(self, responses: Array, judgments: Array, seed: int | None = None) -> Any:
        """Posterior of one model.

        Parameters
        ----------
        responses
            Shape [participant_count, scene_count]; NaN where there is no answer.
        judgments
            The model's, shape [scene_count].
        seed
            In place of the sampling's.

        Returns
        -------
        arviz.InferenceData
            Posterior of `PARAMETERS`, and the log likelihood of each answer.
        """
        answered = np.isfinite(responses)
        key = jax.random.PRNGKey(self._sampling.seed if seed is None else seed)
        data = (
            jnp.asarray(np.where(answered, responses, 0.5)),
            jnp.asarray(answered),
            jnp.asarray(predictor(judgments)),
        )
        chains = [self._chain(one, *data) for one in jax.random.split(key, self._sampling.chains)]
        drawn = {name: np.stack([np.asarray(one[name]) for one in chains]) for name in chains[0]}
        log_likelihood = drawn["log_density"][:, :, answered]
        return az.from_dict(
            posterior={name: drawn[name] for name in PARAMETERS},
            log_likelihood={"answer": log_likelihood},
        )


@dataclass(frozen=True)
class BayesComparison:
    """Models compared by the likelihood of single answers.

    Parameters
    ----------
    loo
        A row a model, best first: `elpd_loo`, `se`, `elpd_diff` (to the best), `dse`, `p_loo`,
        `weight` (stacking), `pareto_k_bad` (answers whose k exceeds 0.7).
    parameters
        A row a model and a parameter: `mean`, `low`, `high`, `r_hat`, `ess`.
    """

    loo: pd.DataFrame
    parameters: pd.DataFrame


def compare_models(
    responses: Array,
    models: Mapping[str, Array],
    sampling: Sampling | None = None,
    report: Report = no_report,
    *,
    level: float = LEVEL,
) -> BayesComparison:
    """Fit the response model with each model's judgments, and compare them by PSIS-LOO.

    Vehtari, Gelman & Gabry (2017), Statistics and Computing 27.

    Parameters
    ----------
    responses
        Shape [participant_count, scene_count].
    models
        Name -> judgments, shape [scene_count].
    sampling
        How posteriors are drawn.
    report
        Told of the progress.
    level
        Of the parameters' intervals.
    """
    fitter, fitted = ResponseModel(sampling), {}
    for done, (name, judgments) in enumerate(models.items()):
        report(f"fitting {name}", done, len(models))
        fitted[name] = fitter.fit(responses, judgments)
    with warnings.catch_warnings():
        # Bad Pareto k are counted in the table; the others are about ArviZ's own code.
        warnings.simplefilter("ignore")
        loos = {name: az.loo(data, pointwise=True) for name, data in fitted.items()}
        table = az.compare(loos, method="stacking") if len(loos) > 1 else None
    rows = [_loo_row(name, loos[name], table) for name in (loos if table is None else table.index)]
    parameters = pd.concat([_summary(name, data, level) for name, data in fitted.items()])
    return BayesComparison(pd.DataFrame(rows), parameters.reset_index(drop=True))


def _loo_row(name: str, one: Any, table: Any) -> dict[str, Any]:
    row: dict[str, Any] = {"model": name, "elpd_loo": float(one.elpd_loo), "se": float(one.se)}
    if table is not None:
        row |= {column: float(table.loc[name, column]) for column in _COMPARED}
    bad = int((one.pareto_k.to_numpy() > _BAD_K).sum())
    return row | {"p_loo": float(one.p_loo), "pareto_k_bad": bad}


def _summary(name: str, data: Any, level: float) -> pd.DataFrame:
    summary = az.summary(data, var_names=list(PARAMETERS))
    draws = np.stack([data.posterior[parameter].to_numpy().ravel() for parameter in PARAMETERS])
    low, high = np.quantile(draws, (0.5 - level / 2.0, 0.5 + level / 2.0), axis=1)
    return pd.DataFrame(
        {
            "model": name,
            "parameter": PARAMETERS,
            "mean": draws.mean(axis=1),
            "low": low,
            "high": high,
            "r_hat": summary["r_hat"].to_numpy(),
            "ess": summary["ess_bulk"].to_numpy(),
        }
    )
