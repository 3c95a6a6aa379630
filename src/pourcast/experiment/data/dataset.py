"""An experiment's data written to files: two tables, or a Psych-DS dataset."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pourcast.experiment.data.psych_ds import write_psych_ds
from pourcast.experiment.data.tables import (
    FREE_TEXT,
    KNOWN_ELSEWHERE,
    participants_table,
    trials_table,
    write_csv,
)
from pourcast.experiment.design.settings import read_design
from pourcast.experiment.storage.storage import Storage


@dataclass(frozen=True)
class WrittenData:
    """What was written: the files, and how many participants and judgments are in them."""

    paths: list[Path]
    participants: int
    judgments: int


def write_data(
    folder: Path,
    study: Path,
    storage: Storage,
    form: Literal["csv", "psych-ds"] = "csv",
    *,
    identifiers: bool = False,
    remarks: bool = False,
    preview: bool = False,
) -> WrittenData:
    """Write an experiment's data.

    The two tables are the researcher's own, and their owner alone can read them. A dataset is
    made for others: it has no remarks, in which people may say who they are, and no completion
    codes, by which a platform knows them, unless it is asked for; then it is private, too.

    Parameters
    ----------
    folder
        Where to. For Psych-DS it must not exist, or be empty.
    study
        The study folder.
    storage
        Its database.
    form
        Two tables, or a whole dataset.
    identifiers
        With the recruiting platform's ids, which must not be published.
    remarks
        For Psych-DS: with what participants wrote at the end.
    preview
        With those who came by the preview link.

    Raises
    ------
    InputError
        If the design is wrong, or the folder can't be written or, for Psych-DS, holds
        something already.
    StoreError
        If the database can't be read.
    """
    trials = trials_table(storage, preview=preview)
    participants = participants_table(storage, preview=preview, identifiers=identifiers)
    if form == "psych-ds":
        left_out = (*(() if remarks else FREE_TEXT), *(() if identifiers else KNOWN_ELSEWHERE))
        paths = write_psych_ds(
            folder,
            study,
            read_design(study),
            trials,
            participants.drop(columns=list(left_out)),
            private=remarks or identifiers,
        )
    else:
        paths = [folder / "trials.csv", folder / "participants.csv"]
        for path, table in zip(paths, (trials, participants), strict=True):
            write_csv(path, table, private=True)
    return WrittenData(paths, len(participants), len(trials))
