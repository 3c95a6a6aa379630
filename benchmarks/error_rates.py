"""How often intervals hold the truth, and tests reject it, in studies whose truth is known.

    python -m benchmarks.error_rates > docs/reference/error-rates.md

simulates studies of 10 participants x 30 scenes and of 33 x 120, with observers as the
package simulates them, analyses each as `pourcast compare` does by default, and makes the page.
`--studies` says how many of each kind; 400 take a quarter of an hour of a core.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from pourcast import demo_scenes
from pourcast.comparison.agreement import Settings
from pourcast.comparison.candidates import Candidates
from pourcast.comparison.choice import judgments_of_fitted
from pourcast.statistics.correlation import MEASURES, agreement, mean_judgments, pearson
from pourcast.statistics.differences import PairMeasure, compare_pairs, holm
from pourcast.statistics.jackknife import (
    LEVEL,
    SHARE,
    Over,
    fisher_z,
    jackknife,
    scaled,
)
from pourcast.statistics.null import against_null
from pourcast.statistics.observer import Population
from pourcast.statistics.reliability import (
    explained_interval,
    explained_share,
    reliability,
    split_half,
)
from pourcast.study.trials import Trials

Array = NDArray[np.float64]

SIZES = ((10, 30), (33, 120))
"""Participants and scenes of the studies."""

NEARNESS = (0.5, 0.9, 0.99, 1.0)
"""How a model's judgments correlate with what is in the heads; 1 is a perfect model."""

MODELS = 11

STEEP = 3.0
SPREAD = {1.0: "even", STEEP: "mostly near 0 or 1"}
"""Steepness of a world, in words."""

HEAD = """# Error rates: how often the statistics are right

Made by `python -m benchmarks.error_rates`: studies whose truth is known, [simulated
observers](../explanation/statistics.md#simulated-observers), analysed as `compare` does by
default. {studies} studies in each cell: a true 95 % shows as {low:.1f} to {high:.1f} %. The
truth is the mean of what is measured over studies of the same size: with other people (on the
same scenes), on other scenes (with the same people), or both.
"""


@dataclass(frozen=True)
class World:
    """Where studies come from.

    Parameters
    ----------
    participants, scenes
        Size of a study.
    nearness
        Of each model to what is in the heads.
    population
        Who answers.
    answered
        Share of the scenes that each participant answers.
    steepness
        With 1, judgments are spread evenly over 0..1; with more, most are near 0 or 1.
    """

    participants: int
    scenes: int
    nearness: tuple[float, ...] = (0.9,)
    population: Population = Population()  # noqa: RUF009 (frozen)
    answered: float = 1.0
    steepness: float = 1.0

    def draw_scenes(self, rng: np.random.Generator, scenes: int = 0) -> tuple[Array, Array]:
        """What is in the heads, and each model's judgments."""
        count = scenes or self.scenes
        depth = rng.standard_normal(count)
        near = np.array(self.nearness)[:, None]
        apart = np.sqrt(1.0 - near**2) * rng.standard_normal((len(near), count))
        steep = self.steepness
        return norm.cdf(steep * depth), norm.cdf(steep * (near * depth + apart))

    def people(self, rng: np.random.Generator) -> Array:
        """Some participants: how they answer."""
        return self.population.draw(self.participants, rng)

    def answers(
        self, judgments: Array, rng: np.random.Generator, people: Array | None = None
    ) -> Array:
        """A study's answers; NaN where none was given."""
        styles = self.people(rng) if people is None else people
        responses: Array = self.population.respond(judgments, styles, rng)
        if self.answered < 1.0:
            missing = rng.random(responses.shape).argsort(axis=1).argsort(axis=1)
            responses[missing >= round(self.answered * responses.shape[1])] = np.nan
        return responses


Studies = Iterator[tuple[Array, Array, Array]]
"""Answers, models' judgments, and true values on their scale."""


def studies_over(
    world: World, over: Over, value: Callable[[Array, Array], Array], count: int, seed: int
) -> Studies:
    """Studies, and the mean over studies that differ in what a conclusion is to hold over."""
    rng = np.random.default_rng(seed)
    if over == "both":
        many = [world.draw_scenes(rng) for _ in range(4000)]
        known = np.mean([value(world.answers(j, rng), m) for j, m in many], axis=0)
    for k in range(count):
        if over == "participants":
            if k % 20 == 0:
                judgments, models = world.draw_scenes(rng)
                again = [value(world.answers(judgments, rng), models) for _ in range(400)]
                known = np.mean(again, axis=0)
            yield world.answers(judgments, rng), models, known
            continue
        judgments, models = world.draw_scenes(rng)
        if over == "scenes":
            people = world.people(rng)
            all_judgments, all_models = world.draw_scenes(rng, 6000)
            known = value(world.answers(all_judgments, rng, people), all_models)
            yield world.answers(judgments, rng, people), models, known
        else:
            yield world.answers(judgments, rng), models, known


def measures_on_scales(responses: Array, models: Array) -> Array:
    """All measures of agreement, shape [4 x model_count]."""
    return scaled(agreement(mean_judgments(responses), models))


def coverage_of_agreement(world: World, over: Over, count: int, seed: int = 0) -> dict[str, float]:
    """Share of studies whose intervals hold the true value, for each measure."""
    held = []
    for responses, models, known in studies_over(world, over, measures_on_scales, count, seed):
        found = jackknife(
            responses,
            lambda m, w, models=models: scaled(agreement(m, models, w)),
            over,
        )
        low, high = found.interval(LEVEL)
        held.append((low <= known) & (known <= high))
    shares = np.mean(held, axis=0).reshape(len(MEASURES), -1).mean(axis=1)
    return dict(zip(MEASURES, shares.tolist(), strict=True))


def coverage_of_differences(
    world: World, over: Over, count: int, seed: int = 0, by: PairMeasure = "r"
) -> float:
    """Share of studies whose interval of the difference of two models, in r or RMSE, holds it."""

    def value(responses: Array, models: Array) -> Array:
        return np.asarray(getattr(agreement(mean_judgments(responses), models), by))

    held = []
    for responses, models, known in studies_over(world, over, value, count, seed):
        low, high = compare_pairs(responses, models, over, by).interval(LEVEL)
        held.append(bool(low[0] <= known[0] - known[1] <= high[0]))
    return float(np.mean(held))


def false_equivalence(world: World, over: Over, count: int, seed: int = 0) -> float:
    """Share of studies that show two models to be nearer to one another than they are."""

    def value(responses: Array, models: Array) -> Array:
        return np.asarray(agreement(mean_judgments(responses), models).r)

    shown = []
    for responses, models, known in studies_over(world, over, value, count, seed):
        within = compare_pairs(responses, models, over).equivalence(LEVEL)
        shown.append(bool(within[0] < abs(known[0] - known[1])))
    return float(np.mean(shown))


def false_stars(
    world: World, over: Over, count: int, seed: int = 0, by: PairMeasure = "r"
) -> tuple[float, float]:
    """Among equally good models: shares of studies with a starred pair, of pairs with p < .05."""
    rng, any_star, single = np.random.default_rng(seed), [], []
    for _ in range(count):
        judgments, models = world.draw_scenes(rng)
        p = compare_pairs(world.answers(judgments, rng), models, over, by).p
        any_star.append(bool((holm(p) < 1.0 - LEVEL).any()))
        single.append(float((p < 1.0 - LEVEL).mean()))
    return float(np.mean(any_star)), float(np.mean(single))


SETTINGS = 20
"""Of a model that is fitted."""


def smooth(share: Array, rng: np.random.Generator, scenes: int) -> Array:
    """What settings have apart from people, going over from one end's to the other's."""
    along = np.stack([np.cos(share * np.pi / 2), np.sin(share * np.pi / 2)], axis=1)
    ends: Array = rng.standard_normal((2, scenes))
    return np.asarray(along @ ends)


def unrelated(share: Array, rng: np.random.Generator, scenes: int) -> Array:
    """What settings have apart from people, each something else."""
    return rng.standard_normal((len(share), scenes))


@dataclass(frozen=True)
class Family:
    """A model with several settings.

    Parameters
    ----------
    apart
        What settings have apart from people; arguments are where they lie, 0 to 1, a source of
        randomness, and the number of scenes.
    others
        Nearness of all settings but the best, if it isn't the best one's.
    levels
        How much the settings' judgments differ in level, and by which factor in scale.
    """

    apart: Callable[[Array, np.random.Generator, int], Array]
    others: float | None = None
    levels: float = 0.0

    def judgments(self, depth: Array, near: float, rng: np.random.Generator) -> Array:
        """Of all settings, shape [SETTINGS, scene_count]."""
        share = np.linspace(0.0, 1.0, SETTINGS)
        nearness = np.full((SETTINGS, 1), near if self.others is None else self.others)
        nearness[SETTINGS // 2] = near
        own = self.apart(share, rng, len(depth))
        judged = norm.cdf(nearness * depth + np.sqrt(1.0 - nearness**2) * own)
        scale = 1.0 - self.levels * share[:, None]
        return np.asarray(scale * judged + (1.0 - scale) * share[:, None])


FAMILIES = {
    "a smooth parameter": Family(smooth),
    "unrelated": Family(unrelated),
    "unrelated, of other levels and scales": Family(unrelated, levels=0.5),
    "one good, all others .6": Family(unrelated, others=0.6),
}


def fitted_rival(world: World, family: str, count: int, seed: int = 0) -> dict[str, float]:
    """A fixed model against a fitted one, whose best setting is as good.

    Returns
    -------
    dict
        Share of studies in which one is told from the other, when the settings are judged on the
        scenes that they were chosen on; and on others, as `compare` does it, by which one wins.
    """
    rng, found = np.random.default_rng(seed), []
    near = world.nearness[0]
    some = demo_scenes()[0]
    scenes = tuple(some.model_copy(update={"id": f"scene-{k}"}) for k in range(world.scenes))
    share = np.linspace(0.0, 1.0, SETTINGS)
    for study in range(count):
        depth, own = rng.standard_normal((2, world.scenes))
        apart = np.sqrt(1.0 - near**2)
        settings = FAMILIES[family].judgments(depth, near, rng)
        fixed = near * depth + apart * own
        responses = world.answers(norm.cdf(depth), rng)
        trials = Trials("water", tuple(map(str, range(len(responses)))), scenes, responses)
        rival = Candidates("rival", "rival", trials, {"share": share}, ("share",), settings)
        best = pearson(mean_judgments(responses), settings).argmax()
        honest = judgments_of_fitted({"rival": rival}, Settings(seed=study))["rival"]
        row = []
        for judged in (settings[best], honest):
            pair = compare_pairs(responses, np.stack([judged, norm.cdf(fixed)]), "both")
            row.append(float(np.sign(pair.difference[0])) * float(pair.p[0] < 1.0 - LEVEL))
        found.append(row)
    told = np.array(found)
    return {
        "in_sample": float((told[:, 0] != 0).mean()),
        "fitted_wins": float((told[:, 1] > 0).mean()),
        "fitted_loses": float((told[:, 1] < 0).mean()),
    }


def perfect_share(world: World, count: int, seed: int = 0) -> float:
    """Mean share of the explainable variance that a perfect model explains."""
    rng = np.random.default_rng(seed)
    shares = []
    for _ in range(count):
        judgments, _ = world.draw_scenes(rng)
        shares.append(explained_share(world.answers(judgments, rng), judgments[None])[0])
    return float(np.nanmean(shares))


def coverage_of_reliability(world: World, count: int, seed: int = 0) -> dict[str, float]:
    """Share of studies whose intervals over scenes hold reliability, split half, and share."""
    rng = np.random.default_rng(seed)
    held: dict[str, list[bool]] = {"reliability": [], "split_half": [], "explained": []}
    for _ in range(count):
        people = world.people(rng)
        many = [world.draw_scenes(rng, 600) for _ in range(10)]
        known = np.mean(
            [_reliability_of(world.answers(j, rng, people), m) for j, m in many], axis=0
        )
        judgments, models = world.draw_scenes(rng)
        responses = world.answers(judgments, rng, people)
        halves = split_half(responses, rng, 200)
        measures: dict[str, Callable[[Array], Array]] = {
            "reliability": lambda w, r=responses: SHARE.there(reliability(r, w))[:, None],
            "split_half": lambda w, h=halves: fisher_z(h.mean_correlations(w))[:, None],
        }
        for k, (name, measure) in enumerate(measures.items()):
            found = jackknife(responses, lambda _, w, measure=measure: measure(w), "scenes")
            low, high = found.interval(LEVEL)
            held[name].append(bool(low[0] <= known[k] <= high[0]))
        low, high = explained_interval(responses, models, LEVEL)
        held["explained"].append(bool(low[0] <= known[2] <= high[0]))
    return {name: float(np.mean(each)) for name, each in held.items()}


def _reliability_of(responses: Array, models: Array) -> Array:
    halves = split_half(responses, np.random.default_rng(0), 100)
    once = np.ones((1, responses.shape[1]))
    return np.array(
        [
            SHARE.there(reliability(responses)),
            fisher_z(halves.mean_correlations(once)[0]),
            explained_share(responses, models)[0],
        ]
    )


def guessers(world: World, count: int, seed: int = 0, shared: float = 0.0) -> dict[str, float]:
    """People whose answers have nothing to do with the truth: who is said to beat chance.

    Parameters
    ----------
    world
        Where studies come from.
    count
        How many.
    seed
        Source of randomness.
    shared
        Correlation of people's answers with a heuristic that all share.
    """
    rng = np.random.default_rng(seed)
    beat, ks, permuted = [], [], []
    for _ in range(count):
        heuristic = norm.cdf(shared * rng.standard_normal(world.scenes))
        truth, _ = world.draw_scenes(rng)
        found = against_null(world.answers(heuristic, rng), truth, rng, draws=1000)
        beat.append(float((found.p < 1.0 - LEVEL).mean()))
        ks.append(found.ks_p < 1.0 - LEVEL)
        permuted.append(found.permutation_p < 1.0 - LEVEL)
    return {
        "beat": float(np.mean(beat)),
        "ks": float(np.mean(ks)),
        "permuted": float(np.mean(permuted)),
    }


POPULATIONS = {
    "as simulated": Population(),
    "all alike": Population(slope_sd=0.0, bias_sd=0.0),
    "levels differ much (0.15)": Population(bias_sd=0.15),
    "slopes differ much (0.25)": Population(slope_sd=0.25),
    "slopes differ very much (0.5)": Population(slope_sd=0.5),
    "noisy (precision 1.5)": Population(precision=1.5),
}


def percent(share: float) -> str:
    return f"{100 * share:.1f}"


def table(heads: list[str], rows: list[list[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


OVERS: tuple[Over, ...] = ("participants", "scenes", "both")
BY: tuple[PairMeasure, ...] = ("r", "rmse")


def sized() -> Iterator[tuple[str, int, int]]:
    """Sizes of studies, in words and numbers."""
    for people, scenes in SIZES:
        yield f"{people} x {scenes}", people, scenes


def table_of_r(count: int) -> str:
    rows = []
    for size, people, scenes in sized():
        cases = [(near, 1.0) for near in NEARNESS] + [(0.9, STEEP), (0.98, STEEP)]
        for near, steep in cases:
            world = World(people, scenes, 3 * (near,), steepness=steep)
            held = [coverage_of_agreement(world, over, count)["r"] for over in OVERS]
            rows.append([size, f"{near:g}", SPREAD[steep], *map(percent, held)])
    return table(["study", "nearness", "judgments", *(f"over {over}" for over in OVERS)], rows)


def table_of_other_measures(count: int) -> str:
    rows = []
    for size, people, scenes in sized():
        for over in OVERS:
            held = coverage_of_agreement(World(people, scenes, 3 * (0.9,)), over, count)
            two = World(people, scenes, (0.95, 0.9))
            pairs = [coverage_of_differences(two, over, count, by=by) for by in BY]
            nearer = false_equivalence(two, over, count)
            own = [percent(held[measure]) for measure in MEASURES[1:]]
            rows.append([size, over, *own, *map(percent, pairs), percent(nearer)])
    apart = [f"difference in {by}" for by in BY]
    heads = ["study", "over", *MEASURES[1:], *apart, "shown to be nearer (at most 5)"]
    return table(heads, rows)


def table_of_reliability(count: int) -> str:
    rows = []
    for size, people, scenes in sized():
        held = coverage_of_reliability(World(people, scenes), count)
        rows.append([size, *map(percent, held.values())])
    return table(["study", "reliability, ceiling", "split half", "explained share"], rows)


def table_of_stars(count: int) -> str:
    rows = []
    for size, people, scenes in sized():
        for over, near, steep in (
            ("both", 0.6, 1.0), ("both", 0.9, 1.0), ("both", 0.9, STEEP), ("both", 0.97, STEEP),
            ("participants", 0.6, 1.0), ("participants", 0.9, 1.0),
        ):  # fmt: skip
            world = World(people, scenes, MODELS * (near,), steepness=steep)
            stars = [share for by in BY for share in false_stars(world, over, count, by=by)]
            rows.append([size, over, f"{near:g}", SPREAD[steep], *map(percent, stars)])
    found = [f"{by}: {what}" for by in BY for what in ("any pair (Holm)", "one pair, p < .05")]
    heads = ["study", "over", "nearness", "judgments", *found]
    return table(heads, rows)


def table_of_fitted(count: int) -> str:
    rows = []
    for size, people, scenes in sized():
        for family in FAMILIES:
            found = fitted_rival(World(people, scenes), family, count)
            rows.append([size, family, *map(percent, found.values())])
    heads = [
        "study",
        f"{SETTINGS} settings",
        "on the same scenes",
        "on others: fitted wins",
        "loses",
    ]
    return table(heads, rows)


def table_of_perfect_models(count: int) -> str:
    rows = []
    for name, population in POPULATIONS.items():
        worlds = [
            World(people, scenes, population=population, answered=answered)
            for people, scenes in SIZES
            for answered in (1.0, 0.5)
        ]
        rows.append([name, *(f"{perfect_share(world, count):.3f}" for world in worlds)])
    heads = [f"{size}, {what}" for size, _, _ in sized() for what in ("all answered", "half")]
    return table(["people", *heads], rows)


def table_of_guessers(count: int) -> str:
    rows = []
    for size, people, scenes in sized():
        for shared, answered in ((0.0, 1.0), (0.0, 0.5), (0.0, 0.2), (0.7, 1.0)):
            found = guessers(World(people, scenes, answered=answered), count, shared=shared)
            what = "share a heuristic" if shared else f"{100 * answered:g} % of the scenes each"
            rows.append([size, what, *map(percent, found.values())])
    return table(["study", "who", "participants", "Kolmogorov-Smirnov", "scenes permuted"], rows)


SECTIONS: tuple[tuple[str, Callable[[int], str]], ...] = (
    ("## Intervals: how often they hold the truth (%)\n\nr, by how a model's judgments correlate "
     "with what is in the heads:", table_of_r),
    ("The other measures (of a model of 0.9), the difference of two models (0.95 and 0.9), and how "
     "often these are shown to be equivalent within less than they differ by:",
     table_of_other_measures),
    ("Over scenes, for the people who answered:", table_of_reliability),
    (f"## {MODELS} equally good models: how often some pair is starred (%)\n\n`--over "
     "participants` is about these scenes only, on which models that are equally good elsewhere "
     "do differ.",
     table_of_stars),
    ("## A fitted model and an equally good one: how often they are told apart (%)\n\nThe best "
     f"of {SETTINGS} settings of the fitted model is as good as the other. Where it is judged "
     "on the scenes on which its setting was chosen, and as `compare` does it, half by half (where "
     "all settings but one are worse, it pays for being fitted to half of the scenes):",
     table_of_fitted),
    ("## What a perfect model explains of the explainable variance", table_of_perfect_models),
    ("## Guessers: how often they are said to beat chance (%)\n\nOf single participants (5 % by "
     "chance), by the paper's test of all, and by permuting scenes:", table_of_guessers),
)  # fmt: skip


def main() -> None:
    """Print the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=400)
    count = parser.parse_args().studies
    margin = 196.0 * (LEVEL * (1.0 - LEVEL) / count) ** 0.5
    print(HEAD.format(studies=count, low=95.0 - margin, high=95.0 + margin))
    for words, make in SECTIONS:
        print(f"{words}\n\n{make(count)}\n")


if __name__ == "__main__":
    main()
