"""How often the likelihood of single answers tells equally good models apart, and holds the truth.

    python -m benchmarks.bayes_error_rates --studies 400 --workers 16

simulates studies of 10 participants x 30 scenes and of 33 x 120 with simulated observers, as
`benchmarks.error_rates` does, compares models as `pourcast compare --bayes` does, and prints
tables for `docs/reference/error-rates.md`. `--size 10x30` does one size only. A study of 33 x 120
takes a core about a minute for each of its models.
"""

import argparse
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from benchmarks.error_rates import SIZES, SPREAD, STEEP, World, percent, table
from pourcast.statistics.differences import holm
from pourcast.statistics.jackknife import LEVEL
from pourcast.statistics.leave_out import Unit, leave_out
from pourcast.statistics.liquid_effect import HALVES, BothLiquids, liquid_model
from pourcast.statistics.loo import compare_pairs
from pourcast.statistics.nuts import Sampler
from pourcast.statistics.ordered_beta import predictor
from pourcast.statistics.response_model import Answers, response_model
from pourcast.statistics.sampling import Sampling

Array = NDArray[np.float64]

MODELS = 4
"""Equally good models in a study: six pairs."""

CASES = ((0.6, 1.0), (0.9, 1.0), (0.97, STEEP))
"""How near all models are to what is in the heads, and how steep judgments are."""

SAMPLING = Sampling(warmup=300, draws=800, chains=1)
"""Less than `compare` draws: an elpd's error by that is far below that over scenes."""


@cache
def sampler() -> Sampler:
    """One for all studies that a process does: compiled once for each size."""
    return Sampler(response_model, SAMPLING)


def differences(world: World, unit: Unit, seed: int) -> Array:
    """Differences of elpd between all pairs of models in one study.

    Parameters
    ----------
    world
        Where the study comes from; its models.
    unit
        What is left out.
    seed
        Of the study.

    Returns
    -------
    ndarray
        Differences in standard errors, and p, shape [2, pair_count].
    """
    rng = np.random.default_rng(seed)
    judgments, models = world.draw_scenes(rng)
    responses = world.answers(judgments, rng)
    data = [Answers.of(responses, model) for model in models]
    elpd = [
        leave_out(unit, sampler(), posterior, one).elpd
        for posterior, one in zip(sampler().posteriors(data, seed), data, strict=True)
    ]
    _, _, found = compare_pairs(np.stack(elpd))
    return np.stack([found.value / np.sqrt(found.variance), found.p])


def told(world: World, unit: Unit, studies: int, workers: int = 1) -> tuple[float, float, float]:
    """How often equally good models are told apart.

    Parameters
    ----------
    world
        Where studies come from.
    unit
        What is left out.
    studies
        How many.
    workers
        Processes, each on a core.

    Returns
    -------
    float, float, float
        Shares of pairs that differ by more than two standard errors, of pairs with p < .05, and of
        studies with a pair that is told (Holm).
    """
    cases = [(world, unit, seed) for seed in range(studies)]
    errors, p = over_studies(differences, cases, workers).transpose(1, 0, 2)
    any_told = [bool((holm(one) < 1.0 - LEVEL).any()) for one in p]
    return (
        float((np.abs(errors) > 2.0).mean()),
        float((p < 1.0 - LEVEL).mean()),
        float(np.mean(any_told)),
    )


SENSITIVITIES = (0.0, 0.3, 0.6)
"""True slopes of people on what a model says that the liquid changes."""


def both_liquids(
    participants: int, scenes: int, sensitivity: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """A study whose participants judge all scenes with both liquids, as the model of it says.

    Parameters
    ----------
    participants, scenes
        Its size.
    sensitivity
        People's.
    rng
        Source of randomness.

    Returns
    -------
    ndarray, ndarray
        Answers, shape [2, participant_count, scene_count], and a model's judgments, [2,
        scene_count].
    """
    judgments = np.clip(rng.random(scenes) + [[0.0], [1.0]] * rng.normal(0.0, 0.3, scenes), 0, 1)
    x = predictor(judgments)
    u, v, b, c = np.array([0.3, 0.15, 0.2, 0.15])[:, None, None] * rng.standard_normal(
        (4, participants, 1)
    )
    w, t = np.array([0.4, 0.4])[:, None] * rng.standard_normal((2, scenes))
    apart = 0.1 + b + t + (sensitivity + c) * (x[1] - x[0])
    eta = 0.1 + u + w + (0.6 + v) * x.mean(axis=0) + HALVES * apart
    mean, precision = expit(eta), 8.0
    answers = rng.beta(mean * precision, (1.0 - mean) * precision)
    place = rng.random(answers.shape)
    answers = np.where(place < expit(-4.0 - eta), 0.0, answers)
    answers = np.where(place > expit(4.0 - eta), 1.0, answers)
    return np.where(rng.random(answers.shape) < 0.04, rng.random(answers.shape), answers), judgments


@cache
def liquid_sampler() -> Sampler:
    """One for all studies that a process does."""
    return Sampler(liquid_model, SAMPLING)


def sensed(size: tuple[int, int], sensitivity: float, seed: int) -> tuple[bool, bool]:
    """Whether the interval of the sensitivity holds it, and is above 0."""
    data = both_liquids(*size, sensitivity, np.random.default_rng(seed))
    posterior = liquid_sampler().posterior(*BothLiquids.of(*data), seed=seed)
    low, high = np.quantile(posterior.flat("sensitivity"), [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])
    return bool(low <= sensitivity <= high), bool(low > 0.0)


def over_studies(
    one: Callable[..., Any], cases: Sequence[tuple[Any, ...]], workers: int
) -> NDArray[Any]:
    """What is found in each study, in one process or several, each on a core."""
    if workers == 1:
        return np.array([one(*case) for case in cases])
    with ProcessPoolExecutor(workers, get_context("spawn"), _alone) as pool:
        return np.array(list(pool.map(one, *zip(*cases, strict=True))))


def _alone() -> None:
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[os.getpid() % len(cores)]})


def table_of_sensitivity(sizes: Sequence[tuple[int, int]], studies: int, workers: int) -> str:
    """A row a size of study and true sensitivity."""
    rows = []
    for size in sizes:
        for true in SENSITIVITIES:
            cases = [(size, true, seed) for seed in range(studies)]
            shares = over_studies(sensed, cases, workers).mean(axis=0)
            rows.append([f"{size[0]} x {size[1]}", f"{true:g}", *map(percent, shares)])
    return table(["study", "sensitivity", "interval holds it", "interval above 0"], rows)


def table_of_loo(sizes: Sequence[tuple[int, int]], studies: int, workers: int) -> str:
    """A row a size of study and kind of world."""
    rows = []
    for people, scenes in sizes:
        for near, steep in CASES:
            world = World(people, scenes, MODELS * (near,), steepness=steep)
            found = told(world, "scenes", studies, workers)
            rows.append([f"{people} x {scenes}", f"{near:g}", SPREAD[steep], *map(percent, found)])
    heads = ["study", "nearness", "judgments", "one pair, > 2 SE", "one pair, p < .05",
             f"any pair of {MODELS} models (Holm)"]  # fmt: skip
    return table(heads, rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=400)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--size", help="such as 10x30 [both]")
    asked = parser.parse_args()
    own = [tuple(map(int, asked.size.split("x")))] if asked.size else SIZES
    for make in (table_of_loo, table_of_sensitivity):
        print(make(own, asked.studies, asked.workers), end="\n\n")


if __name__ == "__main__":
    main()
