"""What is in each head: a mixture of models over people, each person with parameters of their own.

Participant p judges by one model with one setting c_p of its parameters, among all whose judgments
are known, and answers by `ordered_beta` with

    eta = a_p + b_p x,    x = logit of the judgment of setting c_p, in standard units of its model,

and a precision of their own. (Units over all settings and scenes: a_p and b_p mean the same
whatever model it is, so that a chain can go from one to another.) Models have shares of the
population (Dirichlet prior). Settings of a model follow a normal distribution along each of its
numeric parameters, of which mean and spread are estimated; so do a_p, b_p, and the logarithm of the
precision. This is random-effects model selection (Stephan, Penny, Daunizeau, Moran & Friston 2009,
NeuroImage 46; Rigoux, Stephan, Friston & Daunizeau 2014, NeuroImage 84) with the models' parameters
estimated along with their shares.

Which setting is in a head is drawn from its exact conditional distribution over all of them
(Gibbs), everything else by NUTS; `numpyro.infer.HMCGibbs` joins the two.

Needs the extra ``pourcast[bayes]``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pandas as pd
from jax.scipy.special import logsumexp
from numpy.typing import NDArray
from numpyro import handlers
from numpyro.infer import NUTS, HMCGibbs, init_to_median

from pourcast.statistics.nuts import Posterior, Sampler
from pourcast.statistics.ordered_beta import (
    Answering,
    log_density,
    predictor,
    sample_coefficient,
    sample_effects,
)
from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]

SHARED = ("intercept", "spread_intercept", "slope", "spread_slope", "log_precision",
          "spread_log_precision", "lapse", "cut_low", "cut_high")  # fmt: skip
"""What is estimated of the population, whatever model is in the heads."""

LEAST_SPREAD = 0.05
"""Of a parameter over people, as a share of half of its range: narrower distributions lie within
one setting, and can't be told from one another."""

_TREE_DEPTH = 7
"""Longest trajectories of NUTS, as a power of two: settings change in between anyway."""

_LEAST_SHARE = 1e-9
"""Of a model in the population, while chains run: one that nobody has may come back."""


@dataclass(frozen=True)
class Head:
    """A model that may be in a head, with all settings of its parameters that are known.

    Parameters
    ----------
    judgments
        Shape [setting_count, scene_count].
    parameters
        Numeric parameters in which people may differ -> their value in each setting, shape
        [setting_count]. Settings that differ in nothing of these are as likely as one another.
    """

    judgments: Array
    parameters: Mapping[str, Array]


class _Settings:
    """Settings of all models, one after another, as arrays.

    `x`: predictors, shape [setting_count, scene_count]; `model`: number of the model, and
    `of_model` whether it is each one, [model_count, setting_count]; `places`: where settings lie
    along each model's parameters, whose ranges are -1 to 1, and `has` whether their model has
    them, [setting_count, parameter_count]; `keys`: (model, parameter), with `centre` and `half`
    of the range.
    """

    def __init__(self, heads: Mapping[str, Head]) -> None:
        names, every = list(heads), list(heads.values())
        self.keys = [(name, one) for name, head in heads.items() for one in head.parameters]
        self.model = np.repeat(np.arange(len(every)), [len(head.judgments) for head in every])
        self.of_model = np.arange(len(every))[:, None] == self.model
        self.x = np.concatenate([_standard(predictor(head.judgments)) for head in every])
        self.places = np.zeros((len(self.model), len(self.keys)))
        self.has = np.zeros(self.places.shape)
        ranges = [(np.min(v), np.max(v)) for head in every for v in head.parameters.values()]
        low, high = np.array(ranges).reshape(-1, 2).T
        self.centre, self.half = (low + high) / 2.0, np.maximum(high - low, 1e-12) / 2.0
        for column, (name, one) in enumerate(self.keys):
            rows = self.of_model[names.index(name)]
            values = np.asarray(heads[name].parameters[one])
            self.places[rows, column] = (values - self.centre[column]) / self.half[column]
            self.has[rows, column] = 1.0

    def log_prior(self, shares: Any, means: Any, spreads: Any) -> Any:
        """Log probability of each setting, given the population."""
        away = (self.places - means[: len(self.keys)]) / spreads[: len(self.keys)]
        within = -0.5 * (self.has * away**2).sum(axis=1)
        total = logsumexp(jnp.where(self.of_model, within, -jnp.inf), axis=1)
        return within + (jnp.log(shares) - total)[self.model]


def _standard(x: Array) -> Array:
    """In standard units; 0 where there is no spread."""
    spread = x.std()
    standard: Array = (x - x.mean()) / (spread if spread > 0.0 else 1.0)
    return standard


class MixtureModel(Sampler):
    """The mixture for some models: compiled once, fitted to any number of data sets.

    Parameters
    ----------
    heads
        Name -> model; at least one.
    sampling
        How posteriors are drawn.
    """

    diverging = "hmc_state.diverging"

    def __init__(self, heads: Mapping[str, Head], sampling: Sampling | None = None) -> None:
        super().__init__(self.population, sampling)
        self.heads, self._settings = dict(heads), _Settings(heads)

    def fit(self, responses: Array, seed: int | None = None) -> "Mixture":
        """Fit to the answers to one liquid's trials.

        Parameters
        ----------
        responses
            Shape [participant_count, scene_count]; NaN where there is no answer.
        seed
            In place of the sampling's.
        """
        answered = np.isfinite(responses)
        answers = np.where(answered, responses, 0.5)
        found = self.posterior(answers, answered, seed=seed)
        return Mixture(self.heads, Posterior(self.named(found.draws), found.divergences))

    def named(self, draws: Mapping[str, Array]) -> dict[str, Array]:
        """Draws, and models' shares and parameters by their names and on their own scales."""
        named, there = dict(draws), self._settings
        for number, key in enumerate(there.keys):
            mean, spread = draws["means"][..., number], draws["spreads"][..., number]
            named[mean_of(*key)] = there.centre[number] + there.half[number] * mean
            named[spread_of(*key)] = there.half[number] * (spread + LEAST_SPREAD)
        for number, name in enumerate(self.heads):
            named[share_of(name)] = draws["shares"][..., number]
        return named

    def kernel(self, answers: Any, answered: Any) -> Any:
        """NUTS, and in between settings and shares."""
        inner = NUTS(
            self._model,
            init_strategy=init_to_median,
            max_tree_depth=_TREE_DEPTH,
            target_accept_prob=0.9,
        )

        def gibbs(rng_key: Any, gibbs_sites: Any, hmc_sites: Any) -> Any:
            model = handlers.substitute(self.population, data={**gibbs_sites, **hmc_sites})
            sites = handlers.trace(handlers.seed(model, rng_key)).get_trace(answers, answered)
            there = {name: site["value"] for name, site in sites.items() if "value" in site}
            return self._conditional(rng_key, there, answers, answered)

        return HMCGibbs(inner, gibbs, ["setting", "shares"])

    def population(self, answers: Any, answered: Any) -> None:
        """The model, for NumPyro."""
        there, people = self._settings, answers.shape[0]
        each = answered.sum() / people
        a = _of_people("intercept", dist.Normal(0.0, 1.0), 0.5, people, each)
        b = _of_people("slope", dist.Normal(1.0, 1.0), 0.5, people, each)
        phi = _of_people("log_precision", dist.Normal(2.0, 1.0), 0.5, people, 0.5 * each)
        lapse = numpyro.sample("lapse", dist.Beta(1.0, 15.0))
        cut_low = numpyro.sample("cut_low", dist.Normal(-4.0, 1.5))
        cut_gap = numpyro.sample("cut_gap", dist.LogNormal(2.0, 0.5))
        cut_high = numpyro.deterministic("cut_high", cut_low + cut_gap)
        # Beside the parameters one that no model has: without any, there is something to draw.
        count = [len(there.keys) + 1]
        means = numpyro.sample("means", dist.Uniform(-1.0, 1.0).expand(count).to_event(1))
        spreads = numpyro.sample("spreads", dist.HalfNormal(0.5).expand(count).to_event(1))
        shares = numpyro.sample("shares", dist.Dirichlet(jnp.ones(len(self.heads))))
        prior = there.log_prior(shares, means, spreads + LEAST_SPREAD)
        with numpyro.plate("participants", people):
            setting = numpyro.sample("setting", dist.Categorical(logits=prior))
        answering = Answering(jnp.exp(phi)[:, None], lapse, cut_low, cut_high)
        eta = a[:, None] + b[:, None] * jnp.asarray(there.x)[setting]
        density = log_density(answers, eta, answering)
        numpyro.factor("answers", jnp.where(answered, density, 0.0).sum())

    def _conditional(self, rng_key: Any, sites: Any, answers: Any, answered: Any) -> Any:
        """Models' shares given the settings, and each head's setting given all else."""
        there, (for_shares, for_settings) = self._settings, jax.random.split(rng_key)
        counts = jnp.asarray(there.of_model)[:, sites["setting"]].sum(axis=1)
        drawn = jnp.maximum(dist.Dirichlet(1.0 + counts).sample(for_shares), _LEAST_SHARE)
        shares = drawn / drawn.sum()
        prior = there.log_prior(shares, sites["means"], sites["spreads"] + LEAST_SPREAD)
        x, shared = jnp.asarray(there.x), (sites["lapse"], sites["cut_low"], sites["cut_high"])

        def log_likelihood(one: Any) -> Any:
            own_answers, own_answered, a, b, phi = one
            density = log_density(own_answers, a + b * x, Answering(jnp.exp(phi), *shared))
            return jnp.where(own_answered, density, 0.0).sum(axis=1)

        own = [sites[f"own_{name}"] for name in ("intercept", "slope", "log_precision")]
        each = jax.lax.map(log_likelihood, (answers, answered, *own))
        return {"setting": jax.random.categorical(for_settings, each + prior), "shares": shares}


def _of_people(name: str, mean: dist.Normal, widest: float, people: int, known: Any) -> Any:
    """Draw a number of each person, from a normal distribution over people.

    Parameters
    ----------
    name
        Of the number, and of its mean; ``spread_`` before it is its spread.
    mean
        Prior of the mean.
    widest
        Scale of the spread's half-normal prior.
    people
        How many.
    known
        What answers say of one person's, in answers' worth; see `sample_effects`.
    """
    spread = numpyro.sample(f"spread_{name}", dist.HalfNormal(widest))
    everybody = jnp.ones((people, 1)), jnp.full((1, people), 1.0 / people)
    effects, common = sample_effects(f"participant_{name}", spread, known, *everybody)
    return numpyro.deterministic(f"own_{name}", sample_coefficient(name, mean, common[0]) + effects)


def names_of(heads: Mapping[str, Head]) -> list[str]:
    """Names of all that is estimated of the population."""
    models = [share_of(name) for name in heads]
    keys = [(name, one) for name, head in heads.items() for one in head.parameters]
    own = [name for key in keys for name in (mean_of(*key), spread_of(*key))]
    return [*models, *own, *SHARED]


def mean_of(model: str, parameter: str) -> str:
    """Name of the mean of a model's parameter over people."""
    return f"{model}: mean of {parameter}"


def spread_of(model: str, parameter: str) -> str:
    """Name of the standard deviation of a model's parameter over people."""
    return f"{model}: SD of {parameter}"


def share_of(model: str) -> str:
    """Name of a model's share of the population."""
    return f"{model}: share"


@dataclass(frozen=True)
class Mixture:
    """A fitted mixture.

    Parameters
    ----------
    heads
        The models.
    posterior
        `SHARED`, `share_of`, `mean_of`, `spread_of`; and of each participant `setting`, among
        those of all models one after another.
    """

    heads: Mapping[str, Head]
    posterior: Posterior

    @property
    def names(self) -> list[str]:
        """Of all that is estimated of the population."""
        return names_of(self.heads)

    def shares(self, level: float) -> pd.DataFrame:
        """A row a model: `share` of the population, `low`, `high`, and `exceedance`.

        Exceedance is the probability that the model is more frequent than any other.
        """
        drawn = self.posterior.flat("shares")
        low, high = np.quantile(drawn, (0.5 - level / 2.0, 0.5 + level / 2.0), axis=0)
        most = np.bincount(drawn.argmax(axis=1), minlength=len(self.heads)) / len(drawn)
        return pd.DataFrame(
            {"model": list(self.heads), "share": drawn.mean(axis=0), "low": low, "high": high}
            | {"exceedance": most}
        )

    def probabilities(self) -> Array:
        """Probability of each model to be in each head, shape [participant_count, model_count]."""
        drawn = self._own()
        each = [(where >= 0).mean(axis=0) for where in drawn.values()]
        return np.stack(each, axis=1)

    def values(self, model: str, parameter: str) -> list[Array]:
        """For each participant, draws of a parameter from those with this model in the head."""
        along = np.asarray(self.heads[model].parameters[parameter])
        return [along[own[own >= 0]] for own in self._own()[model].T]

    def _own(self) -> dict[str, NDArray[np.int64]]:
        """For each model, number of its setting in each draw and head; -1 where it is another's."""
        drawn, first, own = self.posterior.flat("setting").astype(int), 0, {}
        for name, head in self.heads.items():
            inside = (drawn >= first) & (drawn < first + len(head.judgments))
            own[name] = np.where(inside, drawn - first, -1)
            first += len(head.judgments)
        return own
