"""How an experiment goes: for the admin page, and for `pourcast experiment status`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pourcast.experiment.data.tables import trials_table
from pourcast.experiment.design.settings import read_design
from pourcast.experiment.storage.journal import NAME as JOURNAL
from pourcast.experiment.storage.journal import Journal
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
    conflicts
        Number of records that came under a key that another one had.
    missing_in_journal
        Number of records that the database has, and the journal has not.
    responses
        Test responses of recruited sessions, by liquid and scene.
    """

    states: pd.DataFrame
    median_rt: float
    judgments: int
    conflicts: int
    missing_in_journal: int
    responses: Mapping[tuple[str, str], list[float]]

    @property
    def warnings(self) -> list[str]:
        """What a researcher should look into, a line each."""
        lines = []
        if self.conflicts:
            lines.append(
                f"{self.conflicts} records came under a key that had another one; they are kept "
                "aside"
            )
        if self.missing_in_journal:
            lines.append(
                f"{self.missing_in_journal} records are in the database alone, and not in "
                f"{JOURNAL}; a server appends them when it can, or when it starts"
            )
        return lines

    def for_json(self) -> dict[str, Any]:
        """The overview as JSON's types; NaN where there is no median."""
        return {
            "groups": json.loads(self.states.reset_index().to_json(orient="records")),
            "judgments": self.judgments,
            "median_rt": self.median_rt,
            "kept_aside": self.conflicts,
            "missing_in_journal": self.missing_in_journal,
            "scenes": [
                {"liquid": liquid, "scene": scene, "responses": responses}
                for (liquid, scene), responses in self.responses.items()
            ],
        }


def study_overview(study: Path, storage: Storage, now: float) -> Overview:
    """How a study's experiment goes; who was away for too long counts as dropped.

    Parameters
    ----------
    study
        The study folder.
    storage
        Its database.
    now
        Seconds since 1970.

    Raises
    ------
    InputError
        If the study's design is wrong.
    StoreError
        If database or journal can't be read.
    """
    storage.drop_stale(read_design(study).largest_gap, now)
    return overview(storage, Journal.of_study(study))


def overview(storage: Storage, journal: Journal) -> Overview:
    """How an experiment goes, previews and simulated observers left out.

    Records that the journal has not are counted whoever made them.
    """
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
    return Overview(
        states,
        median_rt=float(test["rt"].median()),
        judgments=len(trials),
        conflicts=sum(record.session in recruited for record in storage.conflicts()),
        missing_in_journal=len(journal.missing(storage.journal_lines())),
        responses=responses,
    )
