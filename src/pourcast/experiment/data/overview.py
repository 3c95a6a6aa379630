"""How an experiment goes: for the admin page, and for `pourcast experiment status`."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from pourcast.experiment.data.tables import trials_table
from pourcast.experiment.design.links import UNFILLED
from pourcast.experiment.design.settings import read_design
from pourcast.experiment.storage.journal import NAME as JOURNAL
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_lines import FORMAT, line_names, names_of
from pourcast.experiment.storage.sessions import (
    DECLINED,
    DECLINED_LATER,
    DROPPED,
    OPEN,
    Session,
)
from pourcast.experiment.storage.storage import Storage
from pourcast.experiment.storage.visits import REFUSED_BECAUSE


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
    missing_in_database
        Number of records that the journal has, and the database has not.
    declined_later
        Codes of participants who declined after they had agreed.
    shared
        How many browsers took turns with one session, by the participant's code.
    unfilled
        Codes of participants whose link nobody had filled in, in files that were imported.
    refusals
        Number of visits that were refused, by reason: `unfilled` links, `unlisted` ids.
    responses
        Test responses of recruited sessions, by liquid and scene.
    """

    states: pd.DataFrame
    median_rt: float
    judgments: int
    conflicts: int
    missing_in_journal: int
    missing_in_database: int
    declined_later: tuple[str, ...]
    shared: Mapping[str, int]
    unfilled: tuple[str, ...]
    refusals: Mapping[str, int]
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
        if self.missing_in_database:
            lines.append(
                f"{self.missing_in_database} records are in {JOURNAL} alone, and not in the "
                "database; the server takes in what it can when it starts, and so does `pourcast "
                f"experiment data STUDY --import STUDY/{JOURNAL}`, which names what it can't"
            )
        if self.missing_in_journal:
            lines.append(
                f"{self.missing_in_journal} records are in the database alone, and not in "
                f"{JOURNAL}; a server appends them when it can, or when it starts"
            )
        if self.declined_later:
            lines.append(
                f"{', '.join(self.declined_later)}: declined after they had agreed; what they gave "
                "before is kept, and `pourcast experiment data STUDY --withdraw ID` deletes it"
            )
        for participant, browsers in self.shared.items():
            lines.append(
                f"{participant}: {browsers} browsers took turns with one id within a minute; the "
                "answers may be of more than one person"
            )
        if self.unfilled:
            lines.append(
                f"{', '.join(self.unfilled)}: came by a link that nobody had filled in; each is an "
                "anonymous participant of their own"
            )
        return lines + [
            f"visits that were refused: {self.refusals[reason]}, {because}"
            for reason, because in REFUSED_BECAUSE.items()
            if reason in self.refusals
        ]

    def for_json(self) -> dict[str, Any]:
        """The overview as JSON's types; NaN where there is no median."""
        return {
            "groups": json.loads(self.states.reset_index().to_json(orient="records")),
            "judgments": self.judgments,
            "median_rt": self.median_rt,
            "kept_aside": self.conflicts,
            "missing_in_journal": self.missing_in_journal,
            "missing_in_database": self.missing_in_database,
            "declined_later": list(self.declined_later),
            "browsers_at_once": dict(self.shared),
            "unfilled_links": list(self.unfilled),
            "refusals": dict(self.refusals),
            "scenes": [
                {"liquid": liquid, "scene": scene, "responses": responses}
                for (liquid, scene), responses in self.responses.items()
            ],
        }


def study_overview(study: Path, storage: Storage, now: float) -> Overview:
    """How a study's experiment goes; who was away for too long counts as dropped.

    Nothing is changed: only a server knows for how long it waited for somebody.

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
    latest = now - read_design(study).largest_gap
    return overview(storage, Journal.of_study(study), stale_before=latest)


def overview(storage: Storage, journal: Journal, *, stale_before: float = -math.inf) -> Overview:
    """How an experiment goes, previews and simulated observers left out.

    Records that the journal has not are counted whoever made them. Open sessions that were last
    heard of before `stale_before` [s since 1970] count as dropped.
    """
    missing_in_journal, missing_in_database = _missing(storage, journal)
    sessions = [
        one
        for one in storage.sessions()
        if one.entry not in ("preview", "simulation") and one.state != DECLINED
    ]
    recruited = {one.number for one in sessions}

    def state_of(session: Session) -> str:
        is_stale = session.state == OPEN and session.last_seen < stale_before
        return DROPPED if is_stale else session.state

    at_once = storage.browsers_at_once()
    trials = trials_table(storage, trajectories=False)
    trials = trials[trials["session"].isin(recruited)]
    test = trials[trials["phase"] == "test"]
    states = pd.crosstab(
        pd.Series([one.group + 1 for one in sessions], name="group", dtype=int),
        pd.Series([state_of(one) for one in sessions], name="state", dtype=str),
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
        declined_later=tuple(one.participant for one in sessions if one.state == DECLINED_LATER),
        missing_in_journal=missing_in_journal,
        missing_in_database=missing_in_database,
        shared={one.participant: at_once[one.number] for one in sessions if one.number in at_once},
        unfilled=tuple(one.participant for one in sessions if UNFILLED in one.identifiers),
        refusals=storage.refusals(),
        responses=responses,
    )


def _missing(storage: Storage, journal: Journal) -> tuple[int, int]:
    """How many records the journal lacks, and how many the database."""
    # In this order: what comes meanwhile is in the database before it is in the journal.
    noted = [line for line in journal.lines() if "seq" in line or line.get("format") == FORMAT]
    lines = storage.journal_lines()
    # That somebody was dropped is told by the time, too.
    lasting = [line for line in lines if line.get("state") != DROPPED]
    alone = set().union(*map(line_names, noted)) - names_of(lines)
    return len(journal.missing(lasting)), len(alone)
