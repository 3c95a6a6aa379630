"""Whether `pourcast mixture` knows what it doesn't know, and finds what was planted.

    python -m benchmarks.mixture --workers 2 > docs/reference/mixture.md

*Calibration* (Talts, Betancourt, Simpson, Vehtari & Gelman 2018): studies are drawn from the
mixture's own prior; ranks of what was drawn among draws of the posterior must be uniform, for
everything that is estimated. *Recovery*: studies of 33 participants and 120 scenes whose observers
answer as `statistics.observer` has it, not as the mixture does, 70 % with one model in the head.
"""

import argparse
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import chisquare, norm

from benchmarks.error_rates import table
from pourcast.cores import available_cores
from pourcast.statistics.mixture import (
    LEAST_SPREAD,
    Head,
    MixtureModel,
    mean_of,
    names_of,
    share_of,
    spread_of,
)
from pourcast.statistics.observer import Population
from pourcast.statistics.ordered_beta import LAPSE_ENDS, predictor
from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]
Drawn = dict[str, Any]

RANKS = 20
"""Bins of ranks."""

SMALL = Sampling(warmup=400, draws=800, chains=1)
"""Of a study of the calibration; `KEPT` draws are ranked among, far enough from one another."""
KEPT = 99

USUAL = Sampling(warmup=400, draws=800)
"""As the command has it."""

HEAD = """# Mixtures of models over people: are they right?

Made by `python -m benchmarks.mixture --studies {studies}`.

## Calibration

{studies} studies of {people} participants x {scenes} scenes from the mixture's own prior. Of
everything that is estimated: where what was drawn ranks among draws of the posterior, in {ranks}
bins, by a chi-square test of uniformity; and how often the 95 % interval held it. Of {count} p
values the smallest is expected at about {expected:.3f}.
"""

RECOVERY = """## Recovery

Studies of 33 participants x 120 scenes: about 70 % have one model in the head ({settings} settings
of two parameters, zeta of their own), the others another; answers as [simulated
observers](../explanation/statistics.md#simulated-observers) give them, four chains of 400 + 800,
on {cores} cores.
"""


def smooth_heads(scenes: int, steps: int, counts: int, seed: int) -> dict[str, Head]:
    """A model with two parameters, one with one parameter, and no model."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, steps)[:, None]
    start, end, other, last = rng.standard_normal((4, scenes))
    shifts = 0.2 * rng.standard_normal((counts, scenes))
    along = (1.0 - share) * start + share * end
    judgments = norm.cdf((along[None] + shifts[:, None]).reshape(-1, scenes))
    zeta, count = np.tile(16.0 * share[:, 0], counts), np.repeat(np.arange(counts), steps) * 25.0
    return {
        "simulation": Head(judgments, {"zeta": zeta, "N": count}),
        "heuristic": Head(norm.cdf((1.0 - share) * other + share * last), {"m": share[:, 0]}),
        "no-model": Head(np.full((1, scenes), 0.5), {}),
    }


# Calibration -------------------------------------------------------------------------


def from_prior(heads: Mapping[str, Head], people: int, seed: int) -> tuple[Drawn, Array]:
    """Everything that is estimated, drawn from the prior, and answers that go with it.

    Written down anew, as the mixture's description has it, not as its code does.
    """
    rng = np.random.default_rng(seed)
    drawn: Drawn = {
        "lapse": rng.beta(1.0, 15.0), "cut_low": rng.normal(-4.0, 1.5),
        "shares": rng.dirichlet(np.ones(len(heads))),
    }  # fmt: skip
    drawn["cut_high"] = drawn["cut_low"] + rng.lognormal(2.0, 0.5)
    for name, mean in (("intercept", 0.0), ("slope", 1.0), ("log_precision", 2.0)):
        drawn[name], drawn[f"spread_{name}"] = rng.normal(mean, 1.0), abs(rng.normal(0.0, 0.5))
        drawn[f"own_{name}"] = rng.normal(drawn[name], drawn[f"spread_{name}"], people)
    weights = {}
    for name, head in heads.items():
        weights[name] = np.ones(len(head.judgments))
        for parameter, values in head.parameters.items():
            low, high = values.min(), values.max()
            half = (high - low) / 2.0
            mean = drawn[mean_of(name, parameter)] = rng.uniform(low, high)
            spread = half * (LEAST_SPREAD + abs(rng.normal(0.0, 0.5)))
            drawn[spread_of(name, parameter)] = spread
            weights[name] *= np.exp(-0.5 * ((values - mean) / spread) ** 2)
    x = []
    for number in rng.choice(len(heads), people, p=drawn["shares"]):
        head = list(heads.values())[number]
        own = weights[list(heads)[number]]
        logits = predictor(head.judgments)
        spread = logits.std() or 1.0
        x.append((logits[rng.choice(len(own), p=own / own.sum())] - logits.mean()) / spread)
    drawn |= {share_of(name): share for name, share in zip(heads, drawn["shares"], strict=True)}
    shape = (people, len(x[0]))
    eta = drawn["own_intercept"][:, None] + drawn["own_slope"][:, None] * np.array(x)
    precision, mean = np.exp(drawn["own_log_precision"])[:, None], expit(eta)
    inner = rng.beta(np.maximum(mean * precision, 1e-3), np.maximum((1 - mean) * precision, 1e-3))
    # Only an end that was meant is 0 or 1; the density, too, takes what is as near as inside.
    inner = np.clip(inner, 1e-6, 1.0 - 1e-6)
    place, lapsing, anywhere = rng.random((3, *shape))
    answers = np.where(place < 1.0 - expit(eta - drawn["cut_low"]), 0.0, inner)
    answers = np.where(place > 1.0 - expit(eta - drawn["cut_high"]), 1.0, answers)
    ends = LAPSE_ENDS / 2.0
    anywhere = np.where(anywhere < ends, 0.0, np.where(anywhere > 1.0 - ends, 1.0, anywhere))
    return drawn, np.where(lapsing < drawn["lapse"], anywhere, np.clip(answers, 0.0, 1.0))


def ranks(seed: int, people: int, scenes: int) -> dict[str, tuple[float, bool]]:
    """Rank of each drawn number among draws of the posterior, 0 to 1, and whether it was held."""
    model = _small_model(scenes)
    planted, answers = from_prior(model.heads, people, seed)
    posterior = model.fit(answers, seed=seed).posterior
    rng = np.random.default_rng([seed, 1])
    # A head's own parameters, of the first participant; and which of the models it is.
    of_person = {f"own_{name}": 0 for name in ("intercept", "slope", "log_precision")}
    found = {}
    for name in [*names_of(model.heads), *of_person]:
        values, true = posterior.flat(name), planted[name]
        if name in of_person:
            values, true = values[:, 0], true[0]
        kept = values[:: max(1, len(values) // KEPT)][:KEPT]
        below, equal = (kept < true).sum(), (kept == true).sum()
        low, high = np.quantile(values, (0.025, 0.975))
        rank = (below + rng.integers(equal + 1) + rng.random()) / (len(kept) + 1)
        found[name] = (float(rank), bool(low <= true <= high))
    return found


_MODELS: dict[int, MixtureModel] = {}


def _small_model(scenes: int) -> MixtureModel:
    """Compiled once in each process."""
    if scenes not in _MODELS:
        _MODELS[scenes] = MixtureModel(smooth_heads(scenes, 9, 3, 0), SMALL)
    return _MODELS[scenes]


def calibration(studies: int, people: int, scenes: int, over: Callable[..., Any]) -> pd.DataFrame:
    """A row each: what is estimated, p of uniform ranks, share of intervals that held it."""
    found = list(over(partial(ranks, people=people, scenes=scenes), range(studies)))
    rows = []
    for name in found[0]:
        each = np.array([one[name][0] for one in found])
        counts = np.histogram(each, RANKS, (0.0, 1.0))[0]
        held = float(np.mean([one[name][1] for one in found]))
        rows.append({"estimated": name, "p": float(chisquare(counts).pvalue), "held": held})
    return pd.DataFrame(rows)


# Recovery ----------------------------------------------------------------------------


def recovery(seed: int) -> dict[str, float]:
    """One study of the paper's size, and what was found of it."""
    rng, people, scenes = np.random.default_rng([seed, 2]), 33, 120
    heads = smooth_heads(scenes, 17, 12, seed)
    simulation, heuristic = heads["simulation"], heads["heuristic"]
    first = rng.random(people) < 0.7
    zeta = np.clip(np.rint(8.0 + 3.0 * rng.standard_normal(people)), 0.0, 16.0)
    at = (simulation.parameters["N"] == 50.0).argmax() + zeta.astype(int)
    judged = np.where(
        first[:, None], simulation.judgments[at], heuristic.judgments[rng.integers(17, size=people)]
    )
    population = Population()
    answers = population.respond(judged, population.draw(people, rng), rng)
    started = time.perf_counter()
    found = MixtureModel(heads, USUAL).fit(answers, seed=seed)
    seconds = time.perf_counter() - started
    own = found.probabilities()
    values = [v.mean() if len(v) else np.nan for v in found.values("simulation", "zeta")]
    known = first & np.isfinite(values)
    summary = found.posterior.summary(found.names, 0.95)
    return {
        "planted": float(first.mean()),
        "share": float(found.shares(0.95)["share"].iloc[0]),
        "right": float(((own.argmax(axis=1) == 0) == first).mean()),
        "zeta_r": float(np.corrcoef(np.array(values)[known], zeta[known])[0, 1]),
        "r_hat": float(summary["r_hat"].max()),
        "divergences": float(found.posterior.divergences),
        "seconds": seconds,
    }


# The page ------------------------------------------------------------------------------


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=400)
    parser.add_argument("--recovered", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers, mp_context=get_context("spawn")) as pool:
        print(calibration_page(asked.studies, 12, 30, pool.map), flush=True)
    # One after another: chains of a study run on all cores.
    print(recovery_page(asked.recovered))


def calibration_page(studies: int, people: int, scenes: int, over: Callable[..., Any]) -> str:
    found = calibration(studies, people, scenes, over)
    head = HEAD.format(
        studies=studies, people=people, scenes=scenes, ranks=RANKS, count=len(found),
        expected=1.0 / (len(found) + 1),
    )  # fmt: skip
    rows = [[row.estimated, f"{row.p:.3f}", f"{100 * row.held:.1f}"] for row in found.itertuples()]
    heads = ["estimated", "p (uniform ranks)", "held by 95 % intervals (%)"]
    return f"{head}\n{table(heads, rows)}\n"


def recovery_page(studies: int) -> str:
    rows = [
        [f"{100 * one['planted']:.0f}", f"{100 * one['share']:.0f}", f"{100 * one['right']:.0f}",
         f"{one['zeta_r']:.2f}", f"{one['r_hat']:.3f}", f"{one['divergences']:.0f}",
         f"{one['seconds']:.0f}"]
        for one in map(recovery, range(studies))
    ]  # fmt: skip
    heads = ["planted (%)", "found (%)", "heads told rightly (%)", "r of their zeta",
             "largest R-hat", "divergent draws of 3,200", "seconds"]  # fmt: skip
    return f"{RECOVERY.format(settings=17 * 12, cores=available_cores())}\n{table(heads, rows)}\n"


if __name__ == "__main__":
    main()
