"""Data as a Psych-DS dataset: tables whose every column is described, for other people.

The standard: https://psychds-docs.readthedocs.io (schema.org's Dataset in
`dataset_description.json`, tables in `data/`, file names made of keywords).
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from pourcast.experiment.data.tables import (
    FREE_TEXT,
    IDENTIFIER_PREFIX,
    KNOWN_ELSEWHERE,
    PARTICIPANT_COLUMNS,
    TRIAL_COLUMNS,
    write_csv,
)
from pourcast.experiment.design.settings import Design
from pourcast.files import check_empty, make_private_folder, write_text
from pourcast.study.chosen import CHOSEN_FILE

_README = """# {title}

Judgments of where a liquid ends up, collected with pourcast. The experiment is that of Bates,
Yildirim, Tenenbaum and Battaglia (2019), https://doi.org/10.1371/journal.pcbi.1007210.

- `data/study-{study}_description-trials_data.csv`: a row a judgment
- `data/study-{study}_description-participants_data.csv`: a row a session
- `materials/scenes.json`, `materials/practice.json`: the scenes that were shown
- `materials/chosen.json`: how they were drawn and chosen, if pourcast drew them
- `materials/experiment.toml`: the design

`dataset_description.json` describes every column. Before you publish this: add its fields
`author` and `license`{look}. When sessions began and answers came is told to the second.
"""


def write_psych_ds(
    folder: Path,
    study: Path,
    design: Design,
    trials: pd.DataFrame,
    participants: pd.DataFrame,
    *,
    private: bool = False,
) -> list[Path]:
    """Write a Psych-DS dataset.

    Parameters
    ----------
    folder
        Must not exist, or be empty.
    study
        The study folder; its scenes and design become materials.
    design
        The design.
    trials, participants
        From `trials_table` and `participants_table`.
    private
        For its owner alone.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    InputError
        If the folder holds something already, or can't be written.
    """
    check_empty(folder)
    if private:
        make_private_folder(folder)
    name = "".join(letter for letter in study.resolve().name if letter.isalnum()) or "study"
    written = []
    for what, table in (("trials", trials), ("participants", participants)):
        path = folder / "data" / f"study-{name}_description-{what}_data.csv"
        write_csv(path, table, private=private, mark=False)  # Psych-DS: plain UTF-8
        written.append(path)
    for material in ("scenes.json", "practice.json", CHOSEN_FILE, "experiment.toml"):
        if (study / material).is_file():
            path = folder / "materials" / material
            text = (study / material).read_text(encoding="utf-8")
            write_text(path, _without_codes(text, design))
            written.append(path)
    columns = {**TRIAL_COLUMNS, **PARTICIPANT_COLUMNS}
    described = [*trials.columns, *(c for c in participants.columns if c not in trials.columns)]
    for path, text in (
        (
            folder / "dataset_description.json",
            json.dumps(_description(design, described, columns), indent=2) + "\n",
        ),
        (
            folder / "README.md",
            _README.format(title=design.title, study=name, look=_to_look_through(participants)),
        ),
    ):
        write_text(path, text)
        written.append(path)
    return written


def _to_look_through(participants: pd.DataFrame) -> str:
    """What in a table of participants may say who they are."""
    identifying = [*FREE_TEXT, *KNOWN_ELSEWHERE]
    columns = [
        name
        for name in participants.columns
        if name in identifying or name.startswith(IDENTIFIER_PREFIX)
    ]
    names = ", ".join(f"`{name}`" for name in columns)
    return f", and take out what tells who people are (columns {names})" if columns else ""


def _without_codes(text: str, design: Design) -> str:
    """A material without the completion codes: whoever has one gets paid."""
    for value in design.recruiting.model_dump().values():
        for written in {json.dumps(value), json.dumps(value, ensure_ascii=False), f"'{value}'"}:
            text = text.replace(written, '""') if value else text
    return text


def _description(
    design: Design, described: list[str], columns: Mapping[str, str]
) -> dict[str, Any]:
    return {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": design.title,
        "description": "Judgments of where a liquid ends up, collected with pourcast in the "
        "experiment of Bates, Yildirim, Tenenbaum and Battaglia (2019).",
        "schemaVersion": "Psych-DS 1.4.0",
        "keywords": ["intuitive physics", "liquids", "prediction", "psychophysics"],
        "citation": "https://doi.org/10.1371/journal.pcbi.1007210",
        "variableMeasured": [
            {
                "@type": "PropertyValue",
                "name": name,
                "description": columns.get(name, "Identifier from the recruiting platform"),
                **_properties(name),
            }
            for name in described
        ],
    }


def _properties(name: str) -> dict[str, Any]:
    """Unit and range of a column, where it has them."""
    if name in ("response", "start"):
        return {"minValue": 0, "maxValue": 1}
    if name in ("rt", "first_move", "median_rt", "duration", "received", "started"):
        return {"unitText": "s"}
    return {}
