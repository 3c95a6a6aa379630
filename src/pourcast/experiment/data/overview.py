"""How an experiment goes: for the admin page, and for `pourcast experiment status`."""

from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from pourcast.experiment.data.tables import trials_table
from pourcast.experiment.storage.storage import Storage


@dataclass(frozen=True)
class Overview:
    """How an experiment goes.

    Parameters
    ----------
    states
        A row a group, a column a state: numbers of recruited sessions.
    median_rt
        Median time of a test trial [s]; NaN without one.
    judgments
        Number of judgments saved, practice included.
    kept_aside
        Records that came under a key that another one had.
    responses
        Test responses of recruited sessions, by liquid and scene.
    """

    states: pd.DataFrame
    median_rt: float
    judgments: int
    kept_aside: int
    responses: Mapping[tuple[str, str], list[float]]


def overview(storage: Storage) -> Overview:
    """How an experiment goes, previews and simulated observers left out."""
    sessions = [one for one in storage.sessions() if one.entry not in ("preview", "simulation")]
    recruited = {one.number for one in sessions}
    trials = trials_table(storage, trajectories=False)
    trials = trials[trials["session"].isin(recruited)]
    test = trials[trials["phase"] == "test"]
    states = pd.crosstab(
        pd.Series([one.group + 1 for one in sessions], name="group", dtype=int),
        pd.Series([one.state for one in sessions], name="state", dtype=str),
    )
    responses = {
        (str(liquid), str(scene)): answers.tolist()
        for (liquid, scene), answers in test.groupby(["liquid", "scene"], sort=True)["response"]
    }
    aside = [record for record in storage.kept_aside() if record.session in recruited]
    return Overview(states, float(test["rt"].median()), len(trials), len(aside), responses)
