"""Taking a participant out of a study, everywhere."""

from pathlib import Path

import pandas as pd

from pourcast.errors import InputError
from pourcast.experiment.design.links import PERSONAL
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.sessions import Session
from pourcast.experiment.storage.storage import Storage
from pourcast.files import finished_files
from pourcast.tables import TABLE_SUFFIXES, read_table, write_table


def withdraw(study: Path, storage: Storage, journal: Journal, who: str) -> list[str]:
    """Delete a participant everywhere in a study: database, journal, tables of responses.

    Parameters
    ----------
    study
        The study folder.
    storage, journal
        Its data.
    who
        Code of the participant or of the session, or the platform's id.

    Returns
    -------
    list of str
        What was deleted, a line each.

    Raises
    ------
    InputError
        If there is no such participant.
    StoreError
        If journal or database can't be changed.
    """
    sessions = [one for one in storage.sessions() if who in _names(one)]
    if not sessions:
        raise InputError(f"withdraw: there is no participant {who!r}")
    numbers = {one.number for one in sessions}
    codes = {one.participant for one in sessions}
    # The database last: it tells who they are, should this be interrupted and begun again.
    names = {name for one in sessions for name in _names(one)}
    lines = journal.remove({one.key for one in sessions}, names)
    deleted = [f"{journal.path.name}: {lines} lines"]
    for path in finished_files(study / "responses"):
        removed = _remove_from_table(path, codes)
        if removed:
            deleted.append(f"{path.relative_to(study)}: {removed} rows")
    rows = storage.delete(numbers)
    return deleted + [f"database: {count} rows of {table}" for table, count in rows.items()]


def _names(session: Session) -> set[str]:
    """What one person alone is called by; a study's id would take everybody out."""
    ids = {value for name, value in session.identifiers.items() if name in PERSONAL}
    return {session.participant, session.code, *ids}


def _remove_from_table(path: Path, codes: set[str]) -> int:
    if path.suffix not in TABLE_SUFFIXES:
        return 0
    table = read_table(path, verbatim=True)
    gone = table.get("participant", pd.Series(dtype=str)).astype(str).isin(codes)
    if gone.any():
        write_table(path, table[~gone.to_numpy()])
    return int(gone.sum())
