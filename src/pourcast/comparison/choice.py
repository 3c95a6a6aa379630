"""Parameters chosen on people's responses, and what the choice is worth on other scenes.

Bates et al., "Parameter fitting": the number of particles first, from water and honey
trials together; then water's viscosity; then the damping. Honey's Model 1 inherits N and
zeta from water; Model 2 inherits N and alpha, and fits zeta on honey trials. MarbleSim
fits N and zeta, SimpleSim g and m, each for each liquid. Given N, stages one after
another end where a joint search would: at the best correlation. Any other model gets
those of its own swept parameters that correlate best.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import (
    PAPER,
    Candidates,
    as_columns,
    in_words,
    value_in_words,
    words_first,
)
from pourcast.errors import InputError
from pourcast.models.registry import make_model
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.correlation import mean_judgments, pearson
from pourcast.statistics.fit import flat, profile, tied
from pourcast.statistics.halves import random_halves
from pourcast.statistics.jackknife import Estimate, fisher_z, jackknife, r_interval
from pourcast.study.trials import Trials
from pourcast.sweep.judgments import OWN_ALPHA
from pourcast.tables import numbers_in, read_table, require_columns

Array = NDArray[np.float64]

HALVINGS = 500
"""Random halvings of the scenes in cross-validation."""

FITTED_HALVINGS = 25
"""Random halvings of the scenes of which fitted models are judged with one."""

FEWEST_SCENES = 8
"""A half needs at least four scenes for a correlation that means anything."""


def choose(sets: Mapping[str, Candidates], scores: Mapping[str, Array]) -> dict[str, int]:
    """The paper's procedure; and of any other model the candidate that correlates best.

    Parameters
    ----------
    sets
        From `candidates.candidates`.
    scores
        Correlation of each candidate, for each fitted model.

    Returns
    -------
    dict
        Number of the chosen candidate; a model whose inherited values are not among its
        candidates is left out.
    """
    chosen: dict[str, int] = {}
    for name in sets:
        if name not in ("honey-ife-1", "honey-ife-2", "water-ife"):
            _pick(chosen, name, sets[name], scores[name])
    counts = _best_counts(sets, scores)
    if not counts:
        return chosen
    inherited: dict[str, Any] = {"viscosity_alpha": OWN_ALPHA}
    if "water-ife" in sets:
        water = sets["water-ife"]
        common = _nearest(water.axes["n_particles"], float(np.mean(list(counts.values()))))
        _pick(chosen, "water-ife", water, scores["water-ife"], n_particles=common)
        if "water-ife" in chosen:
            inherited = water.values(chosen["water-ife"])
    else:
        inherited["n_particles"] = counts["honey-ife-1"]
    if "honey-ife-1" in sets and "damping_zeta" in inherited:
        own = inherited | {"viscosity_alpha": OWN_ALPHA}
        _pick(chosen, "honey-ife-1", sets["honey-ife-1"], scores["honey-ife-1"], **own)
    if "honey-ife-2" in sets:
        own = {axis: value for axis, value in inherited.items() if axis != "damping_zeta"}
        _pick(chosen, "honey-ife-2", sets["honey-ife-2"], scores["honey-ife-2"], **own)
    return {name: chosen[name] for name in sets if name in chosen}


def _best_counts(sets: Mapping[str, Candidates], scores: Mapping[str, Array]) -> dict[str, float]:
    """Best number of particles for water trials and for honey trials."""
    best = {}
    for name in ("water-ife", "honey-ife-1"):
        if name not in sets:
            continue
        own = sets[name].at(viscosity_alpha=OWN_ALPHA)
        if np.isfinite(scores[name][own]).any():
            values, levels = np.unique(sets[name].axes["n_particles"][own], return_inverse=True)
            best[name] = float(values[profile(scores[name][own], levels).argmax()])
    return best


def _nearest(values: NDArray[Any], wanted: float) -> Any:
    """The nearest value; of two as near, the larger."""
    levels = np.unique(values)[::-1]
    return levels[np.abs(levels - wanted).argmin()]


def _pick(
    chosen: dict[str, int], name: str, one: Candidates, scores: Array, **inherited: Any
) -> None:
    """Choose the best candidate with the inherited values, the first of equals."""
    usable = one.at(**inherited) & np.isfinite(scores)
    if usable.any():
        chosen[name] = tied(np.where(usable, scores, -np.inf))[0]


def count_without_alphas(sets: Mapping[str, Candidates]) -> int | None:
    """The chosen number of particles, if no other viscosity was swept at it.

    Parameters
    ----------
    sets
        From `candidates.candidates`.
    """
    chosen = choose(sets, scores_of(sets))
    if "water-ife" not in chosen:
        return None
    water = sets["water-ife"]
    count = water.values(chosen["water-ife"])["n_particles"]
    alphas = set(water.axes["viscosity_alpha"][water.at(n_particles=count)])
    return int(count) if alphas == {OWN_ALPHA} else None


def scores_of(sets: Mapping[str, Candidates]) -> dict[str, Array]:
    """Correlation of each candidate with people's mean judgments, for each fitted model."""
    return {
        name: pearson(mean_judgments(one.trials.responses), one.judgments)
        for name, one in sets.items()
    }


def _scores_on(half: Array, one: Candidates) -> Array:
    """Correlation of each candidate on a part of the scenes, many times.

    `half` is 1 where a scene is in it, shape [halvings, scene_count].
    """
    means = mean_judgments(one.trials.responses)
    return pearson(np.broadcast_to(means, half.shape), one.judgments, half)


def choice_table(sets: Mapping[str, Candidates], settings: Settings) -> pd.DataFrame:
    """Chosen parameters, with what can't be told from them.

    Returns
    -------
    DataFrame
        A row a fitted model: `model`, `liquid`, the parameters; `fitted` (which of them on its own
        trials), `candidates`, `r` with its interval, `ties` (other candidates with the
        same r), `flat` (for each fitted parameter the values whose r can't be told
        from the best one's), `paper` (the paper's parameters) and `r_paper` (their r
        here), `spec`.
    """
    scores, rows = scores_of(sets), []
    for name, number in choose(sets, scores).items():
        one, values = sets[name], sets[name].values(number)
        low, high = _r_interval(one.trials, one.judgments[number], settings)
        inherited = {axis: values[axis] for axis in values if axis not in one.free}
        rivals = one.at(**inherited)
        paper = _paper_values(one)
        there = np.flatnonzero(one.at(**paper))[: len(paper)]
        rows.append(
            {
                "model": one.model,
                "liquid": one.trials.liquid,
                **as_columns(values),
                "fitted": ", ".join(one.free) or "none",
                "candidates": int(rivals.sum()),
                "r": float(scores[name][number]),
                "low": low,
                "high": high,
                "over": settings.over,
                "ties": len(tied(np.where(rivals, scores[name], np.nan))) - 1,
                "flat": _flat_ranges(one, number, settings),
                "paper": in_words(paper),
                "r_paper": float(scores[name][there[0]]) if len(there) else np.nan,
                "spec": one.spec_of(number),
            }
        )
    # Parameters that only some models have stand with the others, before `fitted`.
    own = dict.fromkeys(name for row in rows for name in list(row)[: list(row).index("fitted")])
    return (
        pd.DataFrame(rows, columns=list(own | dict.fromkeys(rows[0]))) if rows else pd.DataFrame()
    )


def _paper_values(one: Candidates) -> dict[str, Any]:
    """The paper's values of the parameters, if the model is the paper's."""
    if one.model not in PAPER:
        return {}
    paper = make_model(one.model).parameters() | {"viscosity_alpha": OWN_ALPHA}
    return {axis: paper[axis] for axis in one.axes}


def _r_interval(trials: Trials, judgments: Array, settings: Settings) -> tuple[float, float]:
    """Interval of one model's correlation."""
    ends = r_interval(trials.responses, judgments[None], settings.over, settings.level)
    return float(ends[0][0]), float(ends[1][0])


def _shortfall(trials: Trials, judgments: Array, best: int, settings: Settings) -> Estimate:
    """How far each candidate is behind the best, in Fisher's z."""

    def measure(means: Array, weights: Array) -> Array:
        z = fisher_z(pearson(means, judgments, weights))
        return z[:, [best]] - z

    return jackknife(trials.responses, measure, settings.over)


def _flat_ranges(one: Candidates, number: int, settings: Settings) -> str:
    """Values of each fitted parameter, the others as chosen, that do as well as the best."""
    ranges = []
    values = one.values(number)
    for axis in one.free:
        others = {key: value for key, value in values.items() if key != axis}
        along = np.flatnonzero(one.at(**others))
        if len(along) < 2:
            ranges.append(f"{axis}: no other value was swept")
            continue
        best = int(np.flatnonzero(along == number)[0])
        shortfall = _shortfall(one.trials, one.judgments[along], best, settings)
        known = np.isfinite(shortfall.value)
        as_good = along[flat(shortfall, settings.level) & known]
        levels = sorted({one.axes[axis][k] for k in as_good}, key=words_first)
        ranges.append(f"{axis}: {', '.join(map(value_in_words, levels))}")
    return "; ".join(ranges)


def judgments_of_fitted(
    sets: Mapping[str, Candidates], settings: Settings, halvings: int = FITTED_HALVINGS
) -> dict[str, Array]:
    """Judgments of each fitted model on scenes that its parameters were not chosen on.

    Each half of the scenes is judged with the parameters that were chosen on the other one; if
    these differ, judgments of both get the same mean and spread over the scenes. So these judgments
    agree with people as those of any model do that is given beforehand, and can be tested against
    them: with in-sample parameters, one in six studies tells a model with twenty equally good
    settings from a rival that is as good (`benchmarks.error_rates`).

    Of several random halvings each model gets the one whose correlation with people is
    their median: what is found then hardly depends on which were drawn.

    Parameters
    ----------
    sets
        From `candidates.candidates`.
    settings
        The seed of the halvings.
    halvings
        How many.

    Returns
    -------
    dict
        Shape [scene_count] of the model's trials, by the keys of `sets`; models for which a half
        says nothing are left out, as are those with fewer than `FEWEST_SCENES` scenes.
    """
    sets = {name: one for name, one in sets.items() if len(one.trials.scenes) >= FEWEST_SCENES}
    halves = _halves(sets, halvings, settings.rng(9))
    on_first, on_other = (
        {name: _scores_on(half, sets[name]) for name, half in part.items()}
        for part in (halves, {name: 1.0 - half for name, half in halves.items()})
    )
    judged: dict[str, list[Array]] = {name: [] for name in sets}
    for k in range(halvings):
        first, other = (
            choose(sets, {name: each[k] for name, each in scores.items()})
            for scores in (on_first, on_other)
        )
        for name, one in sets.items():
            if len(one.judgments) > 1 and name in first and name in other:
                picks = first[name], other[name]
                by_first, by_other = (one.judgments[pick] for pick in picks)
                if picks[0] != picks[1]:
                    by_first, by_other = _alike(by_first, by_other)
                judged[name].append(np.where(halves[name][k] == 1.0, by_other, by_first))
    return {
        name: _of_median_r(sets[name].trials, np.stack(each))
        for name, each in judged.items()
        if each
    }


def _halves(
    sets: Mapping[str, Candidates], halvings: int, rng: np.random.Generator
) -> dict[str, Array]:
    """Random halves of each model's scenes, the same for all: 1 if in the first."""
    first: dict[str, Array] = {}
    for ids in _shown_together(sets):
        first |= dict(zip(ids, random_halves(len(ids), halvings, rng).T, strict=True))
    return {
        name: np.stack([first[scene.id] for scene in one.trials.scenes], axis=1)
        for name, one in sets.items()
    }


def _of_median_r(trials: Trials, judged: Array) -> Array:
    """Of several judgments of the same scenes those whose correlation with people is the median.

    The lower of two; those without a correlation are none of them, unless all are.
    """
    r = pearson(mean_judgments(trials.responses), judged)
    known = int(np.isfinite(r).sum())
    return np.asarray(judged[r.argsort(kind="stable")[max(0, known - 1) // 2]])


def _shown_together(sets: Mapping[str, Candidates]) -> list[list[str]]:
    """Scenes that the same liquids are shown with, to be halved together; so each is in halves."""
    seen: dict[str, set[str]] = {}
    for one in sets.values():
        for scene in one.trials.scenes:
            seen.setdefault(scene.id, set()).add(one.trials.liquid)
    groups: dict[frozenset[str], list[str]] = {}
    for scene_id, liquids in seen.items():
        groups.setdefault(frozenset(liquids), []).append(scene_id)
    return list(groups.values())


def _alike(one: Array, other: Array) -> tuple[Array, Array]:
    """Judgments of two settings, with the same mean and spread: that between theirs.

    A correlation, by which settings are chosen, sees neither; across halves it would see that they
    differ, and take it for disagreement with people.
    """
    means, spreads = np.array([[each.mean(), each.std()] for each in (one, other)]).T
    if not spreads.all():
        return one, other
    return tuple(
        np.clip(means.mean() + spreads.mean() * (each - mean) / spread, 0.0, 1.0)
        for each, mean, spread in zip((one, other), means, spreads, strict=True)
    )


def with_fitted(
    people: Sequence[PeopleAndModels], sets: Mapping[str, Candidates], settings: Settings
) -> tuple[PeopleAndModels, ...]:
    """People and models, and beside these the ones whose parameters are chosen on the responses.

    Their names end in `FITTED`; see `judgments_of_fitted`.
    """
    judged = judgments_of_fitted(sets, settings)
    fitted: dict[str, dict[str, Array]] = {one.trials.liquid: {} for one in people}
    for name, judgments in judged.items():
        fitted[sets[name].trials.liquid][sets[name].fitted_name] = judgments
    return tuple(replace(one, models={**one.models, **fitted[one.trials.liquid]}) for one in people)


def cross_validation_table(
    sets: Mapping[str, Candidates], settings: Settings, halvings: int = HALVINGS
) -> pd.DataFrame:
    """Parameters chosen on half of the scenes, scored on the other half, many times.

    The whole procedure runs within each halving: N, too, is chosen on the training half.

    Returns
    -------
    DataFrame
        A row a fitted model: `model`, `liquid`, `in_sample` (r of the parameters chosen on all
        scenes, on all scenes), `train` and `test` (mean r on the halves), `optimism` (train minus
        test), `halvings`, and `chosen` (how often which parameters).
    """
    scenes = {one.trials.scenes for one in sets.values()}
    if not sets or min(len(some) for some in scenes) < FEWEST_SCENES:
        return pd.DataFrame()
    train, test, everywhere = {}, {}, scores_of(sets)
    # Both liquids show the same scenes; where they don't, each is halved by itself.
    halves = {some: random_halves(len(some), halvings, settings.rng(8)) for some in scenes}
    for name, one in sets.items():
        half = halves[one.trials.scenes]
        train[name], test[name] = _scores_on(half, one), _scores_on(1.0 - half, one)
    overall = choose(sets, everywhere)
    picks = [choose(sets, {name: train[name][k] for name in sets}) for k in range(halvings)]
    rows = []
    for name, number in overall.items():
        one = sets[name]
        made = [(k, pick[name]) for k, pick in enumerate(picks) if name in pick]
        trained = np.array([train[name][at] for at in made])
        tested = np.array([test[name][at] for at in made])
        known = np.isfinite(trained) & np.isfinite(tested)
        if not known.any():
            continue  # People's means don't differ enough for a correlation on halves.
        trained, tested = trained[known], tested[known]
        rows.append(
            {
                "model": one.model,
                "liquid": one.trials.liquid,
                "in_sample": float(everywhere[name][number]),
                "train": float(trained.mean()),
                "test": float(tested.mean()),
                "optimism": float(trained.mean() - tested.mean()),
                "halvings": len(trained),
                "chosen": _most_chosen(one, [at for _, at in made]),
            }
        )
    return pd.DataFrame(rows)


def _most_chosen(one: Candidates, numbers: Sequence[int], most: int = 3) -> str:
    """The parameters that were chosen most often, with their shares."""
    free = one.free or tuple(one.axes)
    words = pd.Series(
        [in_words({axis: one.axes[axis][number] for axis in free}) for number in numbers]
    )
    shares = words.value_counts(normalize=True).head(most)
    return "; ".join(f"{words} ({100 * share:.0f} %)" for words, share in shares.items())


def scores_table(sets: Mapping[str, Candidates]) -> pd.DataFrame:
    """Correlation of every candidate with people: what heat maps and profiles are drawn from."""
    tables, scores = [], scores_of(sets)
    for name, one in sets.items():
        r = scores[name]
        tables.append(
            pd.DataFrame(
                {"model": one.model, "liquid": one.trials.liquid} | as_columns(one.axes) | {"r": r}
            )
        )
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def carried_table(
    compared: Sequence[PeopleAndModels], choice: pd.DataFrame, settings: Settings
) -> pd.DataFrame:
    """Parameters of another experiment, unchanged, against these people.

    Parameters
    ----------
    compared
        People and models; among them those that `choice` names in `spec`.
    choice
        A `choice_table` of the other experiment.
    settings
        How intervals are made.
    """
    rows = []
    for one in compared:
        names = (choice[name] for name in ("model", "liquid", "spec", "r"))
        for name, liquid, spec, r_there in zip(*names, strict=True):
            if spec not in one.models or called(liquid) != called(one.trials.liquid):
                continue
            low, high = _r_interval(one.trials, one.models[spec], settings)
            r = pearson(mean_judgments(one.trials.responses), one.models[spec][None])[0]
            rows.append(
                {
                    "model": name, "liquid": one.trials.liquid, "spec": spec,
                    "r": float(r), "low": low, "high": high, "over": settings.over,
                    "r_where_fitted": r_there,
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def read_choice(folder: Path) -> pd.DataFrame:
    """Parameters that were chosen in another study, from its report.

    Raises
    ------
    InputError
        If there is no such table; names file, row and column of what is wrong.
    """
    path = folder / "report" / "tables" / "choice.csv"
    try:
        table = read_table(path, text=("model", "liquid", "spec"))
        require_columns(path, table, ("model", "liquid", "spec", "r"))
        table["r"] = numbers_in(path, table, "r", table["r"].isna())
    except InputError as error:
        raise InputError(
            f"{error}; not a table of chosen parameters: expected the folder of a study with a "
            "report"
        ) from None
    return table
