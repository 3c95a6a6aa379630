"""A study's responses, rehearsed by simulated observers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.errors import InputError, unknown
from pourcast.experiment.data.responses import RESPONSES
from pourcast.experiment.design.settings import NAME as DESIGN_FILE
from pourcast.experiment.design.settings import read_design
from pourcast.observers.observers import Observers, simulate_observers
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.study.experiments.base import Experiment, observer_model
from pourcast.sweep.judgments import LiquidAndModel, judge_in_study, sweep_words
from pourcast.tables import write_table

USUAL_OBSERVERS = 20
"""How many observers judge scenes that belong to no experiment, unless it is said otherwise."""


def study_groups(study: Path, experiment: Experiment | None) -> tuple[tuple[str, ...], ...]:
    """Liquids that each group of a study's participants sees.

    As its `experiment.toml` says; without one as its experiment does, else water.
    """
    if (study / DESIGN_FILE).is_file():
        return read_design(study).groups
    return (("water",),) if experiment is None else experiment.groups


def observers_of(
    experiment: Experiment | None,
    count: int | None = None,
    models: Mapping[str, str] | None = None,
    groups: tuple[tuple[str, ...], ...] | None = None,
    **options: Any,
) -> Observers:
    """Observers as many, and in such groups, as an experiment has participants.

    Parameters
    ----------
    experiment
        The experiment; without one, `USUAL_OBSERVERS` see water.
    count
        How many, if not as many as there.
    models
        Liquid -> model in their heads, where it isn't the experiment's.
    groups
        Liquids that each group sees, if not those of the experiment.
    **options
        Other fields of `Observers`.
    """
    if groups is None:
        groups = (("water",),) if experiment is None else experiment.groups
    usual = USUAL_OBSERVERS if experiment is None else experiment.participants
    shown = dict.fromkeys(liquid for group in groups for liquid in group)
    usual_models = {liquid: observer_model(experiment, liquid) for liquid in shown}
    return Observers(
        usual if count is None else count, usual_models | dict(models or {}), groups, **options
    )


def models_by_liquid(given: Sequence[str], groups: Sequence[Sequence[str]]) -> dict[str, str]:
    """Models in observers' heads, from what a user said: ``NAME[:...]`` or ``LIQUID=NAME[:...]``.

    Parameters
    ----------
    given
        Each for a liquid's trials; without a liquid, for all that are not named.
    groups
        Liquids that each group sees.

    Raises
    ------
    InputError
        If a liquid is not shown, or two models are given for one.

    Examples
    --------
    >>> models_by_liquid(["gravity"], [["water"]])
    {'water': 'gravity'}
    """
    shown = tuple(dict.fromkeys(liquid for group in groups for liquid in group))
    chosen: dict[str, str] = {}
    for text in given:
        liquid, equals, spec = text.partition("=")
        if not equals or ":" in liquid:
            liquid, spec = "", text
        elif liquid not in shown:
            raise InputError(f"model: {liquid}: {unknown(liquid, shown)}")
        if liquid in chosen:
            raise InputError(f"model: two models for {liquid or 'all'} trials")
        chosen[liquid] = spec
    for_all = chosen.pop("", None)
    return chosen if for_all is None else dict.fromkeys(shown, for_all) | chosen


def rehearse(
    study: Path,
    scenes: Sequence[Scene],
    observers: Observers,
    path: Path | None = None,
    report: Report = no_report,
) -> Path:
    """Let simulated observers answer a study's scenes, and write their responses.

    Judgments come through the study's store: what was swept is not simulated again.

    Parameters
    ----------
    study
        The study folder.
    scenes
        Its scenes.
    observers
        Who answers.
    path
        Table to write; ``responses/simulated.csv`` in the study by default.
    report
        Told of the progress.

    Returns
    -------
    Path
        The table.
    """
    target = path or study / RESPONSES / "simulated.csv"
    write_table(target, observers_table(study, scenes, observers, report))
    return target


def observers_table(
    study: Path, scenes: Sequence[Scene], observers: Observers, report: Report = no_report
) -> pd.DataFrame:
    """What simulated observers answer; their models' judgments come through the study's store.

    See `simulate_observers`.
    """

    def judge(
        models: Sequence[LiquidAndModel],
    ) -> Mapping[LiquidAndModel, NDArray[np.float64]]:
        tell = sweep_words(report, "observers' models")
        return judge_in_study(study, scenes, models, "observers", report=tell)

    return simulate_observers(scenes, observers, judge)
