"""Models against people: agreement, differences between models, reliability, chance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from statsmodels.stats.multitest import multipletests

from pourcast.comparison import stimulus
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.bootstrap import (
    LEVEL,
    RESAMPLES,
    Resampled,
    draw_counts,
    interval,
    resample,
    tails,
    two_sided_p,
)
from pourcast.statistics.correlation import MEASURES, agreement, mean_judgments
from pourcast.statistics.null import AgainstNull, against_null
from pourcast.statistics.reliability import (
    FEWEST_PARTICIPANTS,
    explained_share,
    reliability,
    spearman_brown,
    split_half,
)
from pourcast.study.responses import Trials

Array = NDArray[np.float64]

FEWEST_SCENES = 3
"""With fewer scenes a correlation says nothing."""

_RELIABILITY_SCENE_RESAMPLES = 2000


@dataclass(frozen=True)
class Settings:
    """How intervals are made.

    Parameters
    ----------
    resampled
        What is drawn again.
    resamples
        How many times.
    level
        Of the intervals.
    seed
        Source of all randomness.
    """

    resampled: Resampled = "participants"
    resamples: int = RESAMPLES
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


_STREAMS: dict[Resampled, int] = {"participants": 0, "scenes": 1, "both": 2}


def _drawn(
    compared: PeopleAndModels, settings: Settings, resampled: Resampled
) -> tuple[Array, Array]:
    """Resamples of the people's means; the same for every table, so that all are paired."""
    drawn = resample(
        compared.trials.responses, resampled, settings.rng(1, _STREAMS[resampled]),
        settings.resamples,
    )  # fmt: skip
    return drawn.means, drawn.weights


def agreement_table(compared: PeopleAndModels, settings: Settings) -> pd.DataFrame:
    """Agreement of each model with people's mean judgments.

    Returns
    -------
    DataFrame
        A row a model: `liquid`, `model`, then `r`, `rmse`, `bias`, `slope`, each with `_low` and
        `_high`; `resampled`; `explained` (share of the explainable variance), whose interval
        is always over scenes; and `r_truth_water`, `r_truth_honey`, `r_truth_stimulus`,
        correlations with the ground truths, if they are among the models.
    """
    judgments, names = compared.judgments, compared.names
    people = mean_judgments(compared.trials.responses)
    observed = agreement(people, judgments)
    means, weights = _drawn(compared, settings, settings.resampled)
    drawn = agreement(means, judgments, weights)
    table = pd.DataFrame({"liquid": compared.trials.liquid, "model": names})
    for measure in MEASURES:
        table[measure] = getattr(observed, measure)
        low, high = interval(getattr(drawn, measure), settings.level)
        table[f"{measure}_low"], table[f"{measure}_high"] = low, high
    table["resampled"] = settings.resampled
    counts = draw_counts(judgments.shape[1], _RELIABILITY_SCENE_RESAMPLES, settings.rng(2))
    responses = compared.trials.responses
    table["explained"] = explained_share(responses, judgments)
    low, high = _nan_interval(explained_share(responses, judgments, counts), settings.level)
    table["explained_low"], table["explained_high"] = low, high
    for truth in ("truth-water", "truth-honey", stimulus.NAME):
        if truth in compared.models:
            column = f"r_{truth.replace('-', '_')}"
            table[column] = agreement(compared.models[truth], judgments).r
    return table


def _nan_interval(values: Array, level: float) -> tuple[Array, Array]:
    """Interval over the resamples that gave a number; NaN if less than nine in ten did."""
    enough = np.isfinite(values).mean(axis=0) >= 0.9
    usable = np.where(enough, values, 0.0)
    low, high = np.nanpercentile(usable, tails(level), axis=0)
    return np.where(enough, low, np.nan), np.where(enough, high, np.nan)


def intervals_table(compared: PeopleAndModels, settings: Settings) -> pd.DataFrame:
    """Each model's r with its interval over participants, over scenes, and over both.

    Returns
    -------
    DataFrame
        A row a model and a way of resampling: `liquid`, `model`, `resampled`, `r`, `low`,
        `high`.
    """
    r = agreement(mean_judgments(compared.trials.responses), compared.judgments).r
    tables = []
    for resampled in _STREAMS:
        means, weights = _drawn(compared, settings, resampled)
        low, high = interval(agreement(means, compared.judgments, weights).r, settings.level)
        tables.append(
            pd.DataFrame(
                {"liquid": compared.trials.liquid, "model": compared.names}
                | {"resampled": resampled, "r": r, "low": low, "high": high}
            )
        )
    return pd.concat(tables, ignore_index=True)


def differences_table(compared: PeopleAndModels, settings: Settings) -> pd.DataFrame:
    """Differences in r between all pairs of models, on the same resamples.

    Returns
    -------
    DataFrame
        A row a pair: `liquid`, `model`, `rival`, `difference` (the model's r minus the
        rival's), `low`, `high`, `p` (two-sided, from the resamples), `p_holm` (for all pairs
        of the liquid), `resampled`.
    """
    means, weights = _drawn(compared, settings, settings.resampled)
    drawn = agreement(means, compared.judgments, weights).r
    r = agreement(mean_judgments(compared.trials.responses), compared.judgments).r
    first, second = np.triu_indices(len(r), k=1)
    differences = drawn[:, first] - drawn[:, second]
    low, high = interval(differences, settings.level)
    p = two_sided_p(differences)
    names = np.array(compared.names, dtype=object)
    usable = np.isfinite(differences).all(axis=0)
    holm = np.full(len(p), np.nan)
    if usable.any():
        holm[usable] = multipletests(p[usable], method="holm")[1]
    return pd.DataFrame(
        {
            "liquid": compared.trials.liquid,
            "model": names[first],
            "rival": names[second],
            "difference": r[first] - r[second],
            "low": low,
            "high": high,
            "p": np.where(usable, p, np.nan),
            "p_holm": holm,
            "resampled": settings.resampled,
        }
    )


def reliability_table(trials: Sequence[Trials], settings: Settings) -> pd.DataFrame:
    """How reliable people's means are; intervals are over scenes.

    Returns
    -------
    DataFrame
        A row a liquid: `participants`, `scenes`, `split_half` (mean correlation of
        random halves) and `spearman_brown`, `reliability` (from the variances) and
        `ceiling` (its root: the r that a perfect model can expect), each with `_low` and
        `_high`. NaN where there are too few participants.
    """
    rows = []
    for one in trials:
        people, scenes = one.responses.shape
        row: dict[str, object] = {
            "liquid": one.liquid, "participants": people, "scenes": scenes,
            "resampled": "scenes",
        }  # fmt: skip
        if people >= FEWEST_PARTICIPANTS and scenes >= FEWEST_SCENES:
            row |= _reliability(one.responses, settings)
        rows.append(row)
    return pd.DataFrame(rows)


def _reliability(responses: Array, settings: Settings) -> dict[str, float]:
    halves = split_half(responses, settings.rng(3))
    counts = draw_counts(responses.shape[1], _RELIABILITY_SCENE_RESAMPLES, settings.rng(4))
    r = np.array(np.nanmean(halves.correlations()))
    drawn = halves.mean_correlations(counts)
    share, shares = reliability(responses), reliability(responses, counts)
    row: dict[str, float] = {}
    for name, value, values in (
        ("split_half", r, drawn),
        ("spearman_brown", spearman_brown(r), spearman_brown(drawn)),
        ("reliability", share, shares),
        ("ceiling", np.sqrt(share), np.sqrt(shares)),
    ):
        low, high = _nan_interval(values, settings.level)
        row |= {name: float(value), f"{name}_low": float(low), f"{name}_high": float(high)}
    return row


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
    """

    table: pd.DataFrame
    against: Mapping[str, AgainstNull]
    level: float

    def summary(self) -> pd.DataFrame:
        """A row a liquid: the fitted beta, the Kolmogorov-Smirnov test, how many beat chance."""
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
                    "ks_D": result.ks_statistic,
                    "ks_p": result.ks_p,
                }
            )
        return pd.DataFrame(rows)


def individuals(compared: Sequence[PeopleAndModels], settings: Settings) -> Individuals:
    """Each participant's correlation with the ground truth of the liquid, against chance.

    Liquids whose truth isn't among the models, or whose answers are all the same, are left out.
    """
    tables, against = [], {}
    for number, one in enumerate(compared):
        if one.truth is None:
            continue
        responses = one.trials.responses
        try:
            result = against_null(responses, one.truth, settings.rng(5, number))
        except ValueError:
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
    return Individuals(table, against, settings.level)


def people_table(compared: Sequence[PeopleAndModels]) -> pd.DataFrame:
    """A row a scene and liquid: people's `mean`, `sd`, `answers`, and every model's judgment."""
    tables = []
    for one in compared:
        responses = one.trials.responses
        tables.append(
            pd.DataFrame(
                {
                    "scene": [scene.id for scene in one.trials.scenes],
                    "liquid": one.trials.liquid,
                    "answers": np.isfinite(responses).sum(axis=0),
                    "mean": mean_judgments(responses),
                    "sd": np.nanstd(responses, axis=0),
                    **one.models,
                }
            )
        )
    return pd.concat(tables, ignore_index=True)
