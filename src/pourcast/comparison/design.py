"""What a design could tell apart: models planted in simulated studies, analysed as real ones."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import binomtest

from pourcast.comparison.agreement import PeopleAndModels, Settings
from pourcast.comparison.candidates import Candidates, is_fitted
from pourcast.comparison.choice import choose, scores_of, with_fitted
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.statistics.correlation import mean_judgments, pearson
from pourcast.statistics.differences import Differences, compare_pairs, holm
from pourcast.statistics.observer import Population
from pourcast.study.trials import Trials

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Design:
    """What a study with one liquid compares: scenes, and models as `compare` has them.

    Parameters
    ----------
    liquid
        Of the trials.
    scenes
        The study's scenes.
    models
        Model's name -> judgments, shape [scene_count]; only those that are given beforehand.
    sets
        Models that are fitted to each study anew, with all their candidates; see `candidates`.
        What they inherit from the trials of another liquid stays as it was chosen there; those
        that inherit everything are none of these.
    """

    liquid: str
    scenes: tuple[Scene, ...]
    models: Mapping[str, Array]
    sets: Mapping[str, Candidates]

    @classmethod
    def of(cls, one: PeopleAndModels, sets: Mapping[str, Candidates]) -> "Design":
        """The design of a study that has people's responses; `sets` are those of all liquids."""
        given = {name: j for name, j in one.models.items() if not is_fitted(name)}
        chosen = choose(sets, scores_of(sets))
        own = dict(
            _with_inherited(name, rival, chosen[name])
            for name, rival in sets.items()
            if rival.trials.liquid == one.trials.liquid
            and rival.free
            and name in chosen
            and rival.fitted_name in one.models
        )
        return cls(one.trials.liquid, one.trials.scenes, given, own)

    @property
    def names(self) -> list[str]:
        """Names of all models; some of those that are fitted may turn out not to be."""
        return [*self.models, *(one.fitted_name for one in self.sets.values())]

    def only_different(self) -> "Design":
        """Without the models that are candidates of one that is fitted: it stands for them."""
        among = [one.judgments for one in self.sets.values()]
        models = {
            name: judgments
            for name, judgments in self.models.items()
            if not any((candidates == judgments).all(axis=1).any() for candidates in among)
        }
        return replace(self, models=models)

    def planted(self, name: str, rng: np.random.Generator) -> Array:
        """Judgments of a model; of one that is fitted, with any of its candidates' parameters."""
        if name in self.models:
            return self.models[name]
        one = next(one for one in self.sets.values() if one.fitted_name == name)
        candidate: Array = one.judgments[rng.integers(len(one.judgments))]
        return candidate

    def analysed(
        self, responses: Array, shown: NDArray[np.int64], settings: Settings
    ) -> PeopleAndModels:
        """A study of this design, as `compare` has it: all that is fitted is fitted to it.

        Parameters
        ----------
        responses
            Shape [participant_count, shown_count].
        shown
            Numbers of the scenes that were shown.
        settings
            How it is analysed.
        """
        scenes = tuple(self.scenes[k] for k in shown)
        people = tuple(map(str, range(len(responses))))
        trials = Trials(self.liquid, people, scenes, responses)
        models = {name: judgments[shown] for name, judgments in self.models.items()}
        sets = {
            name: replace(one, trials=trials, judgments=one.judgments[:, shown])
            for name, one in self.sets.items()
        }
        return with_fitted([PeopleAndModels(trials, models)], sets, settings)[0]


def _with_inherited(name: str, one: Candidates, chosen: int) -> tuple[str, Candidates]:
    """A model with inherited values as they were chosen, by a name under which it inherits none."""
    inherited = {key: value for key, value in one.values(chosen).items() if key not in one.free}
    if not inherited:
        return name, one
    kept = one.at(**inherited)
    axes = {key: values[kept] for key, values in one.axes.items()}
    return one.fitted_name, replace(one, axes=axes, judgments=one.judgments[kept])


def model_recovery_table(
    design: Design,
    *,
    observers: int,
    studies: int,
    population: Population,
    settings: Settings,
    report: Report = no_report,
) -> pd.DataFrame:
    """Each model planted in turn, and which model agrees best with its studies.

    Every study is analysed as `compare` does it: what is fitted is fitted to each anew, and a
    fitted model is planted with parameters drawn from all that were swept. Models that are
    candidates of a fitted one are left to it.

    Parameters
    ----------
    design
        What is compared.
    observers, studies
        Observers in a study, and studies for each planted model.
    population
        How the observers answer.
    settings
        How studies are analysed.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        A row a planted model (the index), a column a recovered one, shares of the studies; and
        `told`, the share in which the planted model came out best and was told from all others
        (p for all pairs below 1 - level, Holm).
    """
    design = design.only_different()
    names, everything = design.names, np.arange(len(design.scenes))
    rows = []
    for number, name in enumerate(names):
        report(f"planting {name}", number, len(names))
        rng = settings.rng(10, number)
        counts = dict.fromkeys([*names, "told"], 0)
        for _ in range(studies):
            judgments = design.planted(name, rng)
            responses = population.respond(judgments, population.draw(observers, rng), rng)
            found = design.analysed(responses, everything, settings)
            best = _best(found)
            if best:
                counts[best] += 1
                counts["told"] += best == name and _told_from_all(found, best, settings)
        rows.append(counts)
    return pd.DataFrame(rows, index=pd.Index(names, name="planted")) / studies


def _best(found: PeopleAndModels) -> str:
    """The model that correlates best with people; empty if none has a correlation."""
    r = pearson(mean_judgments(found.trials.responses), found.judgments)
    return "" if np.isnan(r).all() else found.names[int(np.nanargmax(r))]


def _told_from_all(found: PeopleAndModels, best: str, settings: Settings) -> bool:
    number, pairs = found.names.index(best), _pairs(found, settings)
    own = (pairs.first == number) | (pairs.second == number)
    return bool((holm(pairs.p)[own] < 1.0 - settings.level).all())


def _pairs(found: PeopleAndModels, settings: Settings) -> Differences:
    return compare_pairs(found.trials.responses, found.judgments, settings.over)


def power_table(
    design: Design,
    true: str,
    rival: str,
    *,
    observers: Sequence[int],
    scenes: Sequence[int],
    studies: int,
    population: Population,
    settings: Settings,
    report: Report = no_report,
) -> pd.DataFrame:
    """Power to tell two models apart as `compare` does, in designs of several sizes.

    Parameters
    ----------
    design
        What is compared; p values are corrected for all pairs of its models.
    true, rival
        Names of the model in the observers' heads, and of the one that it is to be told from.
    observers, scenes
        Sizes. Scenes are drawn from those of the design, without replacement if there are enough.
    studies
        Simulated for each size.
    population
        How observers answer.
    settings
        How studies are analysed.
    report
        Told of the progress.

    Returns
    -------
    DataFrame
        A row a size: `observers`, `scenes`; `power` (share of studies that find the true model
        better), `low`, `high` (its interval, Wilson), `wrong` (share that find the rival
        better), `drawn_again` (whether some scenes are shown twice, as there are not enough: what
        is found then is too good).
    """
    sizes = [(people, shown) for people in observers for shown in scenes]
    available, rows = len(design.scenes), []
    for done, (people, count) in enumerate(sizes):
        report(f"{true} against {rival}: {people} x {count}", done, len(sizes))
        rng, again = settings.rng(11, people, count), count > available
        found = []
        for _ in range(studies):
            shown = rng.choice(available, count, replace=again)
            judgments = design.planted(true, rng)[shown]
            responses = population.respond(judgments, population.draw(people, rng), rng)
            study = design.analysed(responses, shown, settings)
            found.append(_finding(study, true, rival, settings))
        right = found.count(1)
        limits = binomtest(right, studies).proportion_ci(settings.level, method="wilson")
        rows.append(
            {
                "observers": people, "scenes": count, "power": right / studies,
                "low": float(limits.low), "high": float(limits.high),
                "wrong": found.count(-1) / studies, "drawn_again": again,
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def _finding(study: PeopleAndModels, true: str, rival: str, settings: Settings) -> int:
    """1 if the true model is found better, -1 if the rival is, 0 if they are not told apart."""
    if not {true, rival} <= set(study.names):
        return 0
    pairs = _pairs(study, settings)
    one, other = study.names.index(true), study.names.index(rival)
    number = np.flatnonzero((pairs.first == min(one, other)) & (pairs.second == max(one, other)))
    if not holm(pairs.p)[number[0]] < 1.0 - settings.level:
        return 0
    return int(np.sign(pairs.difference[number[0]])) * (1 if one < other else -1)
