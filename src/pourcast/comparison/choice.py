"""The paper's choice of parameters, stage by stage, and how much of its r is optimism.

Bates et al., "Parameter fitting": the number of particles first, from water and honey
trials together; then water's viscosity; then the damping. Honey's Model 1 inherits N and
zeta from water; Model 2 inherits N and alpha, and fits zeta on honey trials. MarbleSim
fits N and zeta, SimpleSim g and m, each for each liquid. Given N, stages one after
another end where a joint search would: at the best correlation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.errors import InputError
from pourcast.models.registry import make_model
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.correlation import mean_judgments, pearson
from pourcast.statistics.fit import flat, profile, tied
from pourcast.statistics.halves import random_halves
from pourcast.statistics.jackknife import Estimate, fisher_z, jackknife, r_interval
from pourcast.study.trials import Trials
from pourcast.sweep.judgments import OWN_ALPHA, Judgments
from pourcast.tables import numbers_in, read_table, require_columns

Array = NDArray[np.float64]

HALVINGS = 500
"""Random halvings of the scenes in cross-validation."""

FEWEST_SCENES = 8
"""A half needs at least four scenes for a correlation that means anything."""


class Fit(NamedTuple):
    """How one model is fitted.

    Parameters
    ----------
    liquid
        Of the trials.
    fixed
        What all its candidates have in common.
    axes
        Parameters in which they differ.
    free
        Those that are chosen on its own trials; the others are inherited.
    """

    liquid: str
    fixed: Mapping[str, Any]
    axes: tuple[str, ...]
    free: tuple[str, ...]


_IFE = ("n_particles", "viscosity_alpha", "damping_zeta")
_WATER_IN_HEAD = {"family": "ife", "imagined": "water", "zeta_sigma": 4}
_HONEY_IN_HEAD = {"family": "ife", "imagined": "honey", "zeta_sigma": 4}
_MARBLE, _MARBLE_AXES = {"family": "marble", "zeta_sigma": 4}, ("n_particles", "damping_zeta")
_SIMPLE, _SIMPLE_AXES = {"family": "simple", "m_sigma": 0.04}, ("g", "m")

FITTED: Mapping[str, Fit] = {
    "water-ife": Fit("water", _WATER_IN_HEAD, _IFE, _IFE),
    "honey-ife-1": Fit("honey", _HONEY_IN_HEAD, _IFE, ()),
    "honey-ife-2": Fit("honey", _WATER_IN_HEAD, _IFE, ("damping_zeta",)),
    "water-marble": Fit("water", _MARBLE, _MARBLE_AXES, _MARBLE_AXES),
    "honey-marble": Fit("honey", _MARBLE, _MARBLE_AXES, _MARBLE_AXES),
    "water-simple": Fit("water", _SIMPLE, _SIMPLE_AXES, _SIMPLE_AXES),
    "honey-simple": Fit("honey", _SIMPLE, _SIMPLE_AXES, _SIMPLE_AXES),
}
"""The models that are fitted."""


@dataclass(frozen=True)
class Candidates:
    """Models that a fit chooses from, and what people said on the same trials.

    Parameters
    ----------
    trials
        People's responses.
    axes
        Parameter -> its value in each candidate.
    judgments
        Shape [candidate_count, scene_count].
    """

    trials: Trials
    axes: Mapping[str, NDArray[Any]]
    judgments: Array

    def at(self, **values: Any) -> NDArray[np.bool_]:
        """Candidates with these values."""
        same = np.ones(len(self.judgments), dtype=np.bool_)
        for axis, value in values.items():
            same &= self.axes[axis] == value
        return same

    def values(self, number: int) -> dict[str, Any]:
        """Parameters of one candidate."""
        return {axis: column[number] for axis, column in self.axes.items()}


def candidates(judged: Judgments, trials: Sequence[Trials]) -> dict[str, Candidates]:
    """What there is to choose from, for each fitted model; models without any are left out.

    Parameters
    ----------
    judged
        Judgments on the study's scenes.
    trials
        People's responses.
    """
    by_liquid = {called(one.liquid): one for one in trials}
    sets = {}
    for name, (liquid, fixed, axes, _) in FITTED.items():
        if liquid not in by_liquid:
            continue
        one = by_liquid[liquid]
        there = judged.on(one.scenes)
        rows = there.on_trials(one.liquid, **fixed)
        if len(rows):
            columns = {axis: there.rows[axis].to_numpy()[rows] for axis in axes}
            sets[name] = Candidates(one, columns, there.judgments[rows])
    return sets


def choose(sets: Mapping[str, Candidates], scores: Mapping[str, Array]) -> dict[str, int]:
    """The paper's procedure.

    Parameters
    ----------
    sets
        From `candidates`.
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
        chosen[name] = int(np.where(usable, scores, -np.inf).argmax())


def count_without_alphas(sets: Mapping[str, Candidates]) -> int | None:
    """The chosen number of particles, if no other viscosity was swept at it.

    Parameters
    ----------
    sets
        From `candidates`.
    """
    chosen = choose(sets, _scores(sets))
    if "water-ife" not in chosen:
        return None
    water = sets["water-ife"]
    count = water.values(chosen["water-ife"])["n_particles"]
    alphas = set(water.axes["viscosity_alpha"][water.at(n_particles=count)])
    return int(count) if alphas == {OWN_ALPHA} else None


def _scores(sets: Mapping[str, Candidates]) -> dict[str, Array]:
    return {
        name: pearson(mean_judgments(one.trials.responses), one.judgments)
        for name, one in sets.items()
    }


def spec_of(name: str, values: Mapping[str, Any]) -> str:
    """Spec of a fitted model: its preset, with the chosen parameters."""
    parts = [
        f"{axis}={'none' if value == OWN_ALPHA else format(float(value), 'g')}"
        for axis, value in values.items()
    ]
    return f"{name}:{','.join(parts)}"


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
    scores, rows = _scores(sets), []
    for name, number in choose(sets, scores).items():
        one, values = sets[name], sets[name].values(number)
        low, high = _r_interval(one.trials, one.judgments[number], settings)
        inherited = {axis: values[axis] for axis in values if axis not in FITTED[name].free}
        rivals = one.at(**inherited)
        paper = make_model(name).parameters()
        paper_values = {
            axis: OWN_ALPHA if axis == "viscosity_alpha" else paper[axis] for axis in values
        }
        there = np.flatnonzero(one.at(**paper_values))
        rows.append(
            {
                "model": name,
                "liquid": one.trials.liquid,
                **values,
                "fitted": ", ".join(FITTED[name].free) or "none",
                "candidates": int(rivals.sum()),
                "r": float(scores[name][number]),
                "low": low,
                "high": high,
                "over": settings.over,
                "ties": len(tied(np.where(rivals, scores[name], np.nan))) - 1,
                "flat": _flat_ranges(name, one, number, settings),
                "paper": _in_words(paper_values),
                "r_paper": float(scores[name][there[0]]) if len(there) else np.nan,
                "spec": spec_of(name, values),
            }
        )
    return pd.DataFrame(rows)


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


def _in_words(values: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{axis}={value if isinstance(value, str) else format(float(value), 'g')}"
        for axis, value in values.items()
    )


def _flat_ranges(name: str, one: Candidates, number: int, settings: Settings) -> str:
    """Values of each fitted parameter, the others as chosen, that do as well as the best."""
    ranges = []
    values = one.values(number)
    for axis in FITTED[name].free:
        others = {key: value for key, value in values.items() if key != axis}
        along = np.flatnonzero(one.at(**others))
        if len(along) < 2:
            ranges.append(f"{axis}: no other value was swept")
            continue
        best = int(np.flatnonzero(along == number)[0])
        shortfall = _shortfall(one.trials, one.judgments[along], best, settings)
        as_good = along[flat(shortfall, settings.level)]
        levels = sorted({str(one.axes[axis][k]) for k in as_good}, key=_number)
        ranges.append(
            f"{axis}: {', '.join(f'{_number(v):g}' if v != OWN_ALPHA else v for v in levels)}"
        )
    return "; ".join(ranges)


def _number(text: str) -> float:
    return -1.0 if text == OWN_ALPHA else float(text)


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
    train, test, everywhere = {}, {}, _scores(sets)
    # Both liquids show the same scenes; where they don't, each is halved by itself.
    halves = {some: random_halves(len(some), halvings, settings.rng(8)) for some in scenes}
    for name, one in sets.items():
        people = mean_judgments(one.trials.responses)
        many = np.broadcast_to(people, (halvings, len(people)))
        half = halves[one.trials.scenes]
        train[name] = pearson(many, one.judgments, half)
        test[name] = pearson(many, one.judgments, 1.0 - half)
    overall = choose(sets, everywhere)
    picks = [choose(sets, {name: train[name][k] for name in sets}) for k in range(halvings)]
    rows = []
    for name, number in overall.items():
        made = [(k, pick[name]) for k, pick in enumerate(picks) if name in pick]
        trained = np.array([train[name][at] for at in made])
        tested = np.array([test[name][at] for at in made])
        known = np.isfinite(trained) & np.isfinite(tested)
        if not known.any():
            continue  # People's means don't differ enough for a correlation on halves.
        trained, tested = trained[known], tested[known]
        rows.append(
            {
                "model": name,
                "liquid": sets[name].trials.liquid,
                "in_sample": float(everywhere[name][number]),
                "train": float(trained.mean()),
                "test": float(tested.mean()),
                "optimism": float(trained.mean() - tested.mean()),
                "halvings": len(trained),
                "chosen": _most_chosen(name, sets[name], [at for _, at in made]),
            }
        )
    return pd.DataFrame(rows)


def _most_chosen(name: str, one: Candidates, numbers: Sequence[int], most: int = 3) -> str:
    """The parameters that were chosen most often, with their shares."""
    free = FITTED[name].free or tuple(one.axes)
    words = pd.Series(
        [_in_words({axis: one.axes[axis][number] for axis in free}) for number in numbers]
    )
    shares = words.value_counts(normalize=True).head(most)
    return "; ".join(f"{words} ({100 * share:.0f} %)" for words, share in shares.items())


def scores_table(sets: Mapping[str, Candidates]) -> pd.DataFrame:
    """Correlation of every candidate with people: what heat maps and profiles are drawn from."""
    tables, scores = [], _scores(sets)
    for name, one in sets.items():
        r = scores[name]
        tables.append(
            pd.DataFrame({"model": name, "liquid": one.trials.liquid, **one.axes, "r": r})
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
        for name, spec, r_there in zip(choice["model"], choice["spec"], choice["r"], strict=True):
            if spec not in one.models or FITTED[name].liquid != called(one.trials.liquid):
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
        table = read_table(path, text=("model", "spec"))
        require_columns(path, table, ("model", "spec", "r"))
        table["r"] = numbers_in(path, table, "r", table["r"].isna())
    except InputError as error:
        raise InputError(
            f"{error}; not a table of chosen parameters: expected the folder of a study with a "
            "report"
        ) from None
    return table
