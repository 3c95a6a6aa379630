"""Models against people: agreement, differences between models, reliability, chance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import get_args

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.comparison import stimulus
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.correlation import MEASURES, agreement, mean_judgments
from pourcast.statistics.differences import compare_pairs, holm
from pourcast.statistics.jackknife import (
    LEVEL,
    SCALES,
    SHARE,
    Estimate,
    Over,
    fisher_z,
    jackknife,
    r_interval,
    scaled,
    unknowable,
)
from pourcast.statistics.null import AgainstNull, against_null
from pourcast.statistics.reliability import (
    FEWEST_PARTICIPANTS,
    ceiling,
    explained_interval,
    explained_share,
    reliability,
    spearman_brown,
    split_half,
)
from pourcast.study.trials import Trials

Array = NDArray[np.float64]

FEWEST_SCENES = 3
"""With fewer scenes a correlation says nothing."""


@dataclass(frozen=True)
class Settings:
    """How intervals are made.

    Parameters
    ----------
    over
        What conclusions hold over.
    level
        Of the intervals.
    seed
        Source of all randomness: random halves, and chance participants.
    """

    over: Over = "both"
    level: float = LEVEL
    seed: int = 0

    def rng(self, *stream: int) -> np.random.Generator:
        """A stream of randomness of its own for each number or numbers."""
        return np.random.default_rng([self.seed, *stream])


@dataclass(frozen=True)
class PeopleAndModels:
    """People and models on the same scenes, with one liquid.

    Parameters
    ----------
    trials
        People's responses.
    models
        Model's name -> judgments, shape [scene_count].
    truth_name
        Name of the ground truth of these trials, by default the paper's for the liquid.
    """

    trials: Trials
    models: Mapping[str, Array]
    truth_name: str = ""

    @property
    def truth(self) -> Array | None:
        """Judgments of the ground truth, if it is among the models; shape [scene_count]."""
        return self.models.get(self.truth_name or f"truth-{called(self.trials.liquid)}")

    @property
    def names(self) -> list[str]:
        """Names of the models."""
        return list(self.models)

    @property
    def judgments(self) -> Array:
        """Shape [model_count, scene_count]."""
        return np.stack(list(self.models.values()))


def agreement_table(compared: PeopleAndModels, settings: Settings) -> pd.DataFrame:
    """Agreement of each model with people's mean judgments.

    Returns
    -------
    DataFrame
        A row a model: `liquid`, `model`, then `r`, `rmse`, `bias`, `slope`, each with `_low` and
        `_high`; `over` (what these hold over); `explained` (share of the explainable variance),
        whose interval is always over scenes, NaN where people's means aren't `is_reliable`; and
        `r_truth_water`, `r_truth_honey`, `r_truth_stimulus`, correlations with the ground truths,
        if they are among the models.
    """
    judgments, responses = compared.judgments, compared.trials.responses
    observed = agreement(mean_judgments(responses), judgments)
    found = jackknife(responses, lambda m, w: scaled(agreement(m, judgments, w)), settings.over)
    table = pd.DataFrame({"liquid": compared.trials.liquid, "model": compared.names})
    for number, measure in enumerate(MEASURES):
        own = found[number * len(judgments) : (number + 1) * len(judgments)]
        table[measure] = getattr(observed, measure)
        low, high = own.interval(settings.level)
        table[f"{measure}_low"] = SCALES[measure].back(low)
        table[f"{measure}_high"] = SCALES[measure].back(high)
    table["over"] = settings.over
    if is_reliable(responses, settings.level):
        table["explained"] = explained_share(responses, judgments)
        ends = explained_interval(responses, judgments, settings.level)
        table["explained_low"], table["explained_high"] = ends
    else:
        table[["explained", "explained_low", "explained_high"]] = np.nan
    for truth in ("truth-water", "truth-honey", stimulus.NAME):
        if truth in compared.models:
            column = f"r_{truth.replace('-', '_')}"
            table[column] = agreement(compared.models[truth], judgments).r
    return table


def is_reliable(responses: Array, level: float) -> bool:
    """Whether there is more in people's means than noise: the reliability's interval is above 0.

    Without, nothing can be explained, and a share of it would be any number.
    """
    low, _ = _share_of_signal(responses).interval(level)
    return bool(low[0] > 0.0)


def _share_of_signal(responses: Array) -> Estimate:
    """The reliability, over scenes, on its scale."""
    return _over_scenes(responses, lambda w: SHARE.there(reliability(responses, w))[:, None])


def _over_scenes(responses: Array, measure: Callable[[Array], Array]) -> Estimate:
    """What depends on single answers, from how often each scene counts."""
    return jackknife(responses, lambda _, weights: measure(weights), "scenes")


def intervals_table(compared: PeopleAndModels, settings: Settings) -> pd.DataFrame:
    """Each model's r with its interval over participants, over scenes, and over both.

    Returns
    -------
    DataFrame
        A row a model and what its interval is over: `liquid`, `model`, `over`, `r`, `low`, `high`.
    """
    judgments, responses = compared.judgments, compared.trials.responses
    r = agreement(mean_judgments(responses), judgments).r
    tables = []
    for over in get_args(Over):
        low, high = r_interval(responses, judgments, over, settings.level)
        tables.append(
            pd.DataFrame(
                {"liquid": compared.trials.liquid, "model": compared.names}
                | {"over": over, "r": r, "low": low, "high": high}
            )
        )
    return pd.concat(tables, ignore_index=True)


def differences_table(compared: PeopleAndModels, settings: Settings) -> pd.DataFrame:
    """Differences in r between all pairs of models, on the same people and scenes.

    Returns
    -------
    DataFrame
        A row a pair: `liquid`, `model`, `rival`, `difference` (the model's r minus the
        rival's), `low`, `high`, `p` (two-sided), `p_holm` (for all pairs of the liquid),
        `equivalent_within` (the smallest region in which the difference is shown to lie, by two
        one-sided tests), `over`.
    """
    pairs = compare_pairs(compared.trials.responses, compared.judgments, settings.over)
    names, (low, high) = np.array(compared.names, dtype=object), pairs.interval(settings.level)
    return pd.DataFrame(
        {
            "liquid": compared.trials.liquid,
            "model": names[pairs.first],
            "rival": names[pairs.second],
            "difference": pairs.difference,
            "low": low,
            "high": high,
            "p": pairs.p,
            "p_holm": holm(pairs.p),
            "equivalent_within": pairs.equivalence(settings.level),
            "over": settings.over,
        }
    )


def unknown_intervals(trials: Trials, settings: Settings, table: pd.DataFrame) -> str:
    """Why there are no intervals and no tests, or not for all models; empty if there are.

    Parameters
    ----------
    trials
        Of one liquid.
    settings
        How intervals are made.
    table
        From `agreement_table`.
    """
    people, scenes = trials.participant_count, len(trials.scenes)
    why = unknowable(settings.over, people, scenes)
    if not why:
        rows = table[(table["liquid"] == trials.liquid) & table["r"].notna()]
        lost = list(rows["model"][rows["r_low"].isna()])
        if not lost:
            return ""
        return (
            f"{trials.liquid}: no interval of r of {', '.join(lost)}: without one of the scenes, "
            "or of the participants, there is no correlation left"
        )
    others = [over for over in get_args(Over) if not unknowable(over, people, scenes)]
    hint = f" (--over {others[0]} has them)" if others else ""
    return f"{trials.liquid}: no intervals, and no model is told from another: {why}{hint}"


def unknown_reliability(trials: Trials, table: pd.DataFrame) -> str:
    """Why there is no reliability, or not all of it; empty if there is.

    Parameters
    ----------
    trials
        Of one liquid.
    table
        From `reliability_table`.
    """
    people, scenes = trials.participant_count, len(trials.scenes)
    if trials.means_of is not None:
        why = "only means are known"
    elif people < FEWEST_PARTICIPANTS:
        why = f"it needs at least {FEWEST_PARTICIPANTS} participants, not {people}"
    elif scenes < FEWEST_SCENES:
        why = f"it needs at least {FEWEST_SCENES} scenes, not {scenes}"
    else:
        row = table.set_index("liquid").loc[trials.liquid]
        if np.isnan(row["reliability"]):
            why = "too few scenes have two answers, or people's means don't differ"
        elif row["reliability"] <= 0.0:
            why = "people agree with one another no better than by chance: nothing can be explained"
        elif np.isnan(row["split_half"]):
            why = (
                "halves of the participants have too few scenes in common, or give the same answer "
                "to all"
            )
        elif row["split_half"] <= 0.0:
            why = "halves of the participants don't agree: Spearman-Brown has nothing to go by"
        elif np.isnan(row["reliability_low"]):
            why = unknowable("scenes", people, scenes) or "the reliability has no interval"
            return f"{trials.liquid}: no share of explainable variance: {why}"
        elif row["reliability_low"] <= 0.0:
            return (
                f"{trials.liquid}: no share of explainable variance: people's means may be nothing "
                "but noise (the reliability's interval holds 0)"
            )
        else:
            return ""
    return f"{trials.liquid}: no reliability of all participants: {why}"


def reliability_table(trials: Sequence[Trials], settings: Settings) -> pd.DataFrame:
    """How reliable people's means are; intervals are over scenes.

    Returns
    -------
    DataFrame
        A row a liquid: `participants` (0 where only means are known), `scenes`, `split_half`
        (mean correlation of random halves) and `spearman_brown`, `reliability` (from the
        variances) and `ceiling` (its root: the r that a perfect model can expect), each with
        `_low` and `_high`. NaN where there are too few participants.
    """
    rows = []
    for one in trials:
        people, scenes = one.participant_count, len(one.scenes)
        row: dict[str, object] = {
            "liquid": one.liquid, "participants": people, "scenes": scenes,
            "over": "scenes",
        }  # fmt: skip
        if people >= FEWEST_PARTICIPANTS and scenes >= FEWEST_SCENES:
            row |= _reliability(one.responses, settings)
        rows.append(row)
    return pd.DataFrame(rows)


def _reliability(responses: Array, settings: Settings) -> dict[str, float]:
    halves = split_half(responses, settings.rng(3))
    once = np.ones((1, responses.shape[1]))
    half = _over_scenes(responses, lambda w: fisher_z(halves.mean_correlations(w))[:, None])
    share = _share_of_signal(responses)
    r, r_ends = halves.mean_correlations(once), _ends(half, np.tanh, settings.level)
    own, own_ends = reliability(responses, once), _ends(share, SHARE.back, settings.level)
    row: dict[str, float] = {}
    for name, values in (
        ("split_half", (r, *r_ends)),
        ("spearman_brown", (spearman_brown(r), *map(_doubled_limit, r_ends))),
        ("reliability", (own, *own_ends)),
        ("ceiling", ceiling(np.array([own, *own_ends]))),
    ):
        keys = (name, f"{name}_low", f"{name}_high")
        row |= {key: float(value[0]) for key, value in zip(keys, values, strict=True)}
    return row


def _doubled_limit(r: Array) -> Array:
    """Spearman-Brown of a limit of an interval; 0 where halves may not agree at all."""
    return np.where(r > 0.0, spearman_brown(r), np.where(np.isnan(r), np.nan, 0.0))


def _ends(found: Estimate, back: Callable[[Array], Array], level: float) -> tuple[Array, Array]:
    low, high = found.interval(level)
    return back(low), back(high)


@dataclass(frozen=True)
class Individuals:
    """Single participants against chance.

    Parameters
    ----------
    table
        A row a participant: `liquid`, `participant`, `trials`, `mean`, `sd`, `r` (with the
        truth of the liquid), `p` (share of chance participants who do as well).
    against
        Liquid -> the comparison that this is from.
    level
        A participant beats chance if a share of chance participants below 1 - level does as well.
    left_out
        Liquids that are not among these, and why.
    """

    table: pd.DataFrame
    against: Mapping[str, AgainstNull]
    level: float
    left_out: Mapping[str, str] = field(default_factory=dict)

    def summary(self) -> pd.DataFrame:
        """A row a liquid: the fitted beta, both tests against chance, how many beat it."""
        rows = []
        for liquid, result in self.against.items():
            usable = np.isfinite(result.observed)
            rows.append(
                {
                    "liquid": liquid,
                    "beta_a": result.beta[0],
                    "beta_b": result.beta[1],
                    "mean_r": float(result.observed[usable].mean()) if usable.any() else np.nan,
                    "beat_chance": int((result.p[usable] < 1.0 - self.level).sum()),
                    "participants": int(usable.sum()),
                    "permutation_p": result.permutation_p,
                    "ks_D": result.ks_statistic,
                    "ks_p": result.ks_p,
                }
            )
        return pd.DataFrame(rows)


def individuals(compared: Sequence[PeopleAndModels], settings: Settings) -> Individuals:
    """Each participant's correlation with the ground truth of the liquid, against chance.

    Liquids whose truth isn't among the models, or whose answers are all the same, are left out.
    """
    tables, against, left_out = [], {}, {}
    for number, one in enumerate(compared):
        if one.trials.means_of is not None:
            left_out[one.trials.liquid] = "only means are known"
            continue
        if one.truth is None:
            left_out[one.trials.liquid] = "its ground truth was not compared"
            continue
        responses = one.trials.responses
        try:
            result = against_null(responses, one.truth, settings.rng(5, number))
        except ValueError as error:
            left_out[one.trials.liquid] = str(error)
            continue
        against[one.trials.liquid] = result
        tables.append(
            pd.DataFrame(
                {
                    "liquid": one.trials.liquid,
                    "participant": one.trials.participants,
                    "trials": np.isfinite(responses).sum(axis=1),
                    "mean": np.nanmean(responses, axis=1),
                    "sd": np.nanstd(responses, axis=1),
                    "r": result.observed,
                    "p": result.p,
                }
            )
        )
    table = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    return Individuals(table, against, settings.level, left_out)


def people_table(compared: Sequence[PeopleAndModels]) -> pd.DataFrame:
    """A row a scene and liquid: people's `mean`, `sd`, `answers`, and every model's judgment."""
    tables = []
    for one in compared:
        responses, means_of = one.trials.responses, one.trials.means_of
        tables.append(
            pd.DataFrame(
                {
                    "scene": [scene.id for scene in one.trials.scenes],
                    "liquid": one.trials.liquid,
                    "answers": np.isfinite(responses).sum(axis=0) if means_of is None else means_of,
                    "mean": mean_judgments(responses),
                    "sd": np.nanstd(responses, axis=0) if means_of is None else np.nan,
                    **one.models,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)
