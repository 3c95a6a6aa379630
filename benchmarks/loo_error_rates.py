"""How often the likelihood of single answers tells equally good models apart.

    python -m benchmarks.loo_error_rates --studies 400 --workers 16

simulates studies of 10 participants x 30 scenes and of 33 x 120 with simulated observers, as
`benchmarks.error_rates` does, compares models as `pourcast compare --bayes` does, and prints a
table for `docs/reference/error-rates.md`. `--size 10x30` does one size only. A study of 33 x 120
takes a core about a minute for each of its models.
"""

import argparse
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import combinations
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray

from benchmarks.error_rates import SIZES, SPREAD, STEEP, World, percent, table
from pourcast.statistics.leave_out import Unit, leave_out
from pourcast.statistics.loo import TOLD
from pourcast.statistics.nuts import Sampler, Sampling
from pourcast.statistics.response_model import Answers, response_model

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
    """Differences of elpd between all pairs of models in one study, in standard errors.

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
        Shape [pair_count].
    """
    rng = np.random.default_rng(seed)
    judgments, models = world.draw_scenes(rng)
    responses = world.answers(judgments, rng)
    data = [Answers.of(responses, model) for model in models]
    elpd = [
        leave_out(unit, sampler(), posterior, one).elpd
        for posterior, one in zip(sampler().posteriors(data, seed), data, strict=True)
    ]
    each = np.array([first - second for first, second in combinations(elpd, 2)])
    return each.sum(axis=1) / (np.sqrt(each.shape[1]) * each.std(axis=1, ddof=1))


def told(world: World, unit: Unit, studies: int, workers: int = 1) -> tuple[float, float]:
    """Of equally good models: share of pairs that are told apart, and of studies with such a pair.

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
    """
    cases = ([world] * studies, [unit] * studies, range(studies))
    if workers == 1:
        found = np.array([differences(*case) for case in zip(*cases, strict=True)])
    else:
        with ProcessPoolExecutor(workers, get_context("spawn"), _alone) as pool:
            found = np.array(list(pool.map(differences, *cases)))
    apart = np.abs(found) > TOLD
    return float(apart.mean()), float(apart.any(axis=1).mean())


def _alone() -> None:
    """One core for each worker: chains of a study run one after the other."""
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[os.getpid() % len(cores)]})


def table_of_loo(sizes: Sequence[tuple[int, int]], studies: int, workers: int) -> str:
    """A row a size of study and kind of world."""
    rows = []
    for people, scenes in sizes:
        for near, steep in CASES:
            world = World(people, scenes, MODELS * (near,), steepness=steep)
            found = told(world, "scenes", studies, workers)
            rows.append([f"{people} x {scenes}", f"{near:g}", SPREAD[steep], *map(percent, found)])
    heads = ["study", "nearness", "judgments", "one pair, > 2 SE", f"any pair of {MODELS} models"]
    return table(heads, rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=400)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--size", help="such as 10x30 [both]")
    asked = parser.parse_args()
    own = [tuple(map(int, asked.size.split("x")))] if asked.size else SIZES
    print(table_of_loo(own, asked.studies, asked.workers))


if __name__ == "__main__":
    main()
