"""Do people judge two liquids on the same scenes as differently as models do? With names.

Needs the extra ``pourcast[bayes]``, which is loaded when it is asked for.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.progress import Report
from pourcast.scenes.liquids.registry import called
from pourcast.statistics.jackknife import FEWEST
from pourcast.statistics.sampling import Sampling
from pourcast.study.experiments.base import Experiment, observer_model

Array = NDArray[np.float64]

_AND = " / "
"""Between the names of two models, one for each liquid."""


def liquid_effect_table(
    people: Sequence[PeopleAndModels],
    experiment: Experiment | None,
    settings: Settings,
    report: Report,
) -> pd.DataFrame:
    """People's sensitivity to what models say that the liquid changes.

    Of two liquids that participants judged on the same scenes, and models that judge them
    differently: one model for both, or one for each, such as the two ground truths.

    Parameters
    ----------
    people
        People and models, one for each liquid.
    experiment
        That says which models simulated observers have in their heads.
    settings
        How intervals are made.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        A row a pair of liquids and a model: `liquid`, `other`, `participants` (who judged scenes
        with both), `scenes`, then the columns of `statistics.liquid_effect.liquid_effects`.
    """
    # JAX is loaded only for this.
    from pourcast.statistics.liquid_effect import liquid_effects  # noqa: PLC0415

    tables = []
    for one, other in combinations(people, 2):
        responses = _responses(one, other)
        models = _models_of_both(one, other, experiment)
        if _judged_both(responses) < FEWEST or not models:
            continue
        found = liquid_effects(
            responses, models, Sampling(seed=settings.seed), report, level=settings.level
        )
        counts = {
            "liquid": one.trials.liquid, "other": other.trials.liquid,
            "participants": _judged_both(responses), "scenes": responses.shape[2],
        }  # fmt: skip
        tables.append(pd.concat([pd.DataFrame(counts, index=found.index), found], axis=1))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def unknown_liquid_effects(
    people: Sequence[PeopleAndModels], experiment: Experiment | None
) -> list[str]:
    """Why there is no effect of a liquid, or not by all models."""
    told = []
    for one, other in combinations(people, 2):
        pair = f"{called(one.trials.liquid)} and {called(other.trials.liquid)}"
        both = _judged_both(_responses(one, other))
        if both < FEWEST:
            told.append(
                f"{pair}: no effect of the liquid: {both} participants judged scenes with both, "
                f"and it needs at least {FEWEST}"
            )
            continue
        apart = [
            part for name in _models_of_both(one, other, experiment) for part in name.split(_AND)
        ]
        alike = [name for name in one.models if name in other.models and name not in apart]
        if alike:
            told.append(
                f"{pair}: no effect of the liquid by {', '.join(alike)}: they judge both alike"
            )
    return told


def _judged_both(responses: Array) -> int:
    """Participants who judged some scene with both liquids."""
    first, second = np.isfinite(responses)
    return int((first & second).any(axis=1).sum())


def _shared(one: PeopleAndModels, other: PeopleAndModels) -> tuple[list[int], list[int]]:
    """Numbers of the scenes that were shown with both liquids, among those of each."""
    places = {scene.id: k for k, scene in enumerate(other.trials.scenes)}
    pairs = [(k, places.get(scene.id)) for k, scene in enumerate(one.trials.scenes)]
    return [k for k, there in pairs if there is not None], [k for _, k in pairs if k is not None]


def _responses(one: PeopleAndModels, other: PeopleAndModels) -> Array:
    """To scenes that were shown with both, shape [2, participant_count, scene_count]."""
    who = list(dict.fromkeys((*one.trials.participants, *other.trials.participants)))
    scenes = _shared(one, other)
    found = np.full((2, len(who), len(scenes[0])), np.nan)
    for number, each in enumerate((one, other)):
        rows = [who.index(name) for name in each.trials.participants]
        found[number, rows] = each.trials.responses[:, scenes[number]]
    return found


def _models_of_both(
    one: PeopleAndModels, other: PeopleAndModels, experiment: Experiment | None
) -> Mapping[str, Array]:
    """Judgments that differ between the liquids, shape [2, scene_count], by the models' names."""
    liquids = called(one.trials.liquid), called(other.trials.liquid)
    pairs = [(name, name) for name in one.models]
    pairs += [(name, name.replace(*liquids)) for name in one.models]
    pairs += [(observer_model(experiment, liquids[0]), observer_model(experiment, liquids[1]))]
    scenes = _shared(one, other)
    found = {}
    for first, second in dict.fromkeys(pairs):
        if first not in one.models or second not in other.models:
            continue
        judgments = np.stack([one.models[first][scenes[0]], other.models[second][scenes[1]]])
        if np.ptp(judgments, axis=0).any():
            found[first if first == second else f"{first}{_AND}{second}"] = judgments
    return found
