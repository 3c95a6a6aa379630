"""People's responses to a study: its database's, or a table's."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pourcast.errors import InputError
from pourcast.extras import require_extra
from pourcast.scenes.scene import Scene
from pourcast.study.columns import find_columns
from pourcast.study.folder import DATABASE, study_experiment, study_liquids
from pourcast.study.recode import table_files
from pourcast.study.responses import TEST, check_responses, read_responses
from pourcast.study.scale import Scale

JOURNAL = "responses.jsonl"
"""The second copy of what the database has (`storage.journal`)."""

RESPONSES = "responses"
"""Folder of a study's tables of responses."""


def study_responses(
    study: Path,
    path: Path | None,
    scenes: Sequence[Scene],
    *,
    scale: Scale | None = None,
    columns: str | None = None,
) -> tuple[pd.DataFrame, Path]:
    """The responses to a study, checked, and where they come from.

    Parameters
    ----------
    study
        The study folder.
    path
        A table, a folder of tables, or the database of the study's experiment; None for the study's
        only one.
    scenes
        The study's scenes.
    scale
        Of a table's responses, if they aren't shares.
    columns
        A mapping of a table's columns; see `study.columns.find_columns`.

    Returns
    -------
    DataFrame, Path
        As from `read_responses`; `attrs["columns"]` says what mapped its columns, if anything did.

    Raises
    ------
    InputError
        If there is none, or more than one; names file, row and column of what is wrong.
    """
    source, own = path or find_responses(study), study_liquids(study)
    experiment = study_experiment(study, list(scenes))
    if source.suffix == ".sqlite":
        if columns is not None:
            raise InputError(f"columns: {source} is a database of ours, whose columns are known")
        table = _collected(source)
        return check_responses(table, source, scenes, own=own, experiment=experiment), source
    mapping, said = find_columns(columns, source)
    table = read_responses(
        source, scenes, columns=mapping, scale=scale, own=own, experiment=experiment
    )
    told = table.attrs["told"]
    table.attrs["columns"] = said
    table.attrs["told"] = (*([f"columns are mapped by {said}"] if said else []), *told)
    return table, source


def find_responses(study: Path) -> Path:
    """The study's only responses: a table, or its experiment's database.

    Raises
    ------
    InputError
        If there are none, or more than one.
    """
    folder = study / RESPONSES
    sources = table_files(folder) if folder.is_dir() else []
    if (study / DATABASE).is_file() and (not sources or len(_collected(study / DATABASE))):
        sources.insert(0, study / DATABASE)
    if not sources and (study / JOURNAL).is_file() and not (study / DATABASE).is_file():
        _refuse_lost_database(study)
    if not sources:
        raise InputError(
            f"{study / RESPONSES}: no table of responses; collect some with `pourcast experiment "
            "serve`, give a table with --responses FILE, or rehearse with `pourcast experiment "
            "simulate`"
        )
    if len(sources) > 1:
        names = ", ".join(str(path.relative_to(study)) for path in sources)
        raise InputError(
            f"{study}: more than one source of responses ({names}); name one with --responses, "
            f"or {study / RESPONSES}, if they are one table a person"
        )
    return sources[0]


def _refuse_lost_database(study: Path) -> None:
    """Say how to get a database again, if its journal is still there."""
    require_extra("experiment")
    from pourcast.experiment.storage.journal import how_to_restore  # noqa: PLC0415

    if todo := how_to_restore(study):
        raise InputError(f"{study / DATABASE}: not there; {todo}")


def _collected(database: Path) -> pd.DataFrame:
    """Test trials in an experiment's database; of simulated observers only if they are alone."""
    require_extra("experiment")
    from pourcast.experiment.data.tables import trials_table  # noqa: PLC0415 - needs the extra
    from pourcast.experiment.storage.database import file_url  # noqa: PLC0415
    from pourcast.experiment.storage.storage import Storage  # noqa: PLC0415

    if not database.is_file():
        raise InputError(f"{database}: not there")
    storage = Storage(file_url(database))
    try:
        trials = trials_table(storage, trajectories=False)
    finally:
        storage.close()
    trials = trials[trials["phase"] == TEST]
    people = trials[~trials["simulated"].astype(bool)]
    return people if len(people) else trials
