"""Whose program a table is from, told by its columns: how it may be mapped (`study.columns`)."""

from collections.abc import Collection, Sequence

SHORT = {
    "jsPsych": "participant=subject,scene=stimulus,liquid:water,rt_unit:ms,scale:0-100,"
    "trials.trial_type:image-slider-response",
    "PsychoPy": "liquid=fluid,response=slider.response,rt=slider.rt,scale:-1..1,"
    "trials.trials.thisN:*",
    "Qualtrics": "participant=ResponseId,liquid:water,wide:true,header_rows:2,scale:0-100",
    "a matrix": "liquid:water,wide:true",
    "lab.js": "participant:NAME,rt=duration,rt_unit:ms,scale:0-100,trials.sender:slider",
    "means": "response=mean,liquid:water,means:true,answers=n",
}
"""Short mappings of programs' tables; names of columns, and of screens, are a study's own."""

_HOW = "say which column is which with --columns, such as"

_PEOPLE = (
    "participant", "subject", "subject_id", "participant_id", "PROLIFIC_PID", "prolific_pid", "PID",
    "pid", "ResponseId", "id", "ID",
)  # fmt: skip
_SCENES = ("scene", "stimulus", "scene_id", "image", "video", "item")
_RESPONSES = ("response", "slider.response", "rating", "answer", "mean")
_TIMES = ("rt", "slider.rt", "RT", "duration")
_LIQUIDS = ("liquid", "fluid")


def hint(columns: Sequence[str], scene_ids: Collection[str] = ()) -> str:
    """How a table's columns may be mapped, half a sentence.

    Parameters
    ----------
    columns
        Those that are there.
    scene_ids
        Of the study's scenes.

    Examples
    --------
    >>> hint(["participant", "exp1-001"], ["exp1-001"]).partition("such as ")[2]
    'liquid:water,wide:true (this looks like a matrix of people by scenes)'
    """
    program, items = _guess(columns, scene_ids)
    looks = f" (this looks like {program})" if program else ""
    told = [item for item in items if item.partition("=")[0] != item.partition("=")[2]]
    return f"{_HOW} {','.join(told)}{looks}"


def _guess(columns: Sequence[str], scene_ids: Collection[str]) -> tuple[str, list[str]]:
    """A program's name, and what a mapping of its table may say."""
    there = set(columns)
    people = _first("participant", _PEOPLE, there, "COLUMN")
    if any(scene in name for name in columns for scene in scene_ids):
        qualtrics = bool(there & {"ResponseId", "StartDate"})
        name = "Qualtrics" if qualtrics else "a matrix of people by scenes"
        header = ["header_rows:2"] if qualtrics else []
        return name, [people, _liquid(there), "wide:true", *header]
    trial = [
        _first("scene", _SCENES, there, "COLUMN"), _liquid(there),
        _first("response", _RESPONSES, there, "COLUMN"),
    ]  # fmt: skip
    if "mean" in there and not there & set(_PEOPLE):
        return "means alone", [*trial, "means:true", *(["answers=n"] if "n" in there else [])]
    program, more = _of_program(columns)
    times = [_first("rt", _TIMES, there)] if there & set(_TIMES) else []
    return program, [people, *trial, *times, *more]


def _of_program(columns: Sequence[str]) -> tuple[str, list[str]]:
    """A program that writes a row a step, and which of its rows are trials."""
    if {"trial_type", "time_elapsed"} <= set(columns):
        return "jsPsych", ["rt_unit:ms", "trials.trial_type:image-slider-response"]
    if {"sender", "sender_type"} <= set(columns):
        return "lab.js", ["rt_unit:ms", "trials.sender:NAME"]
    loops = [name for name in columns if name.endswith(".thisN") and "practice" not in name]
    if loops or "psychopyVersion" in columns:
        return "PsychoPy", [f"trials.{name}:*" for name in loops[:1]]
    return "", []


def _liquid(there: Collection[str]) -> str:
    return _first("liquid", _LIQUIDS, there) or "liquid:water"


def _first(field: str, names: Sequence[str], there: Collection[str], other: str = "") -> str:
    """A field and the first of some names that is there."""
    found = next((name for name in names if name in there), other)
    return f"{field}={found}" if found else ""
