"""A study's responses, rehearsed by simulated observers."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pourcast.experiment.data.responses import RESPONSES
from pourcast.observers.observers import Head, Observers, simulate_observers
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.sweep.judgments import judge_in_study, sweep_words
from pourcast.tables import write_table

OBSERVERS = {"exp1": 65, "exp2": 21}
"""Participants of the paper's experiments."""

HEADS = {"water": "water-ife", "honey": "honey-ife-2"}
"""What observers have in their heads unless it is said otherwise: the paper's best models."""


def rehearse(
    study: Path,
    scenes: Sequence[Scene],
    observers: Observers,
    path: Path | None = None,
    report: Report | None = None,
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
    study: Path, scenes: Sequence[Scene], observers: Observers, report: Report | None = None
) -> pd.DataFrame:
    """What simulated observers answer; their heads' judgments come through the study's store.

    See `simulate_observers`.
    """

    def judge(heads: Sequence[Head]) -> Mapping[Head, NDArray[np.float64]]:
        tell = sweep_words(report or no_report, "observers' heads")
        return judge_in_study(study, scenes, heads, "observers", report=tell)

    return simulate_observers(scenes, observers, judge)
