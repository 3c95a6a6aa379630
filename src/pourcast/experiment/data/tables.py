"""The data of an experiment, out of the database, as tables."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pourcast.experiment.design.steps import Step
from pourcast.experiment.storage.records import Record
from pourcast.experiment.storage.sessions import DECLINED, Session
from pourcast.experiment.storage.storage import Storage
from pourcast.files import replacing
from pourcast.tables import csv_bytes

TRIAL_COLUMNS = {
    "participant": "Code of the participant, the same in all tables",
    "session": "Number of the session",
    "entry": "How the participant came: lab, prolific, mturk, jatos, static, preview, simulation; "
    "unknown where a file of answers had lost the line that says it",
    "state": "State of the session: open, complete, dropped, screened_out, failed_check, or "
    "declined_later (after having agreed)",
    "group": "Number of the group, from 1; groups see different liquids",
    "phase": "practice, followed by a film of what happens, or test",
    "block": "Part of the test, from 1; parts are followed by a break",
    "trial": "Number of the trial in its phase, from 1",
    "scene": "Id of the scene in the study's scene file",
    "liquid": "Liquid shown, as participants call it",
    "mirrored": "Whether the scene was shown in a mirror, left and right exchanged",
    "response": "Answer to what was asked, 0 to 1, of the scene as it was shown",
    "rt": "Time from the picture to the answer [s]",
    "start": "Where the slider's handle stood at first, 0 to 1; empty without a handle",
    "first_move": "Time until the handle was first moved [s]",
    "moves": "Number of the handle's movements",
    "input": "What moved the handle last: mouse, touch or keyboard",
    "window_width": "Width of the window [points]",
    "window_height": "Height of the window [points]",
    "picture_width": "Width of the picture when the answer was handed in [points]",
    "picture_height": "Height of the picture when the answer was handed in [points]",
    "pixel_ratio": "The screen's pixels in a point; page zoom counts",
    "focus_losses": "How often the page lost the focus during the trial",
    "dropped_frames": "Pictures that the screen did not show in time during the trial",
    "received": "When the answer was saved [seconds since 1970, UTC]",
    "simulated": "Whether a simulated observer answered",
    "trajectory": "Times [s] and places of the handle, as JSON; only if the design asks for it",
}
"""Columns of the table of trials, and what each means."""

PARTICIPANT_COLUMNS = {
    "participant": TRIAL_COLUMNS["participant"],
    "session": TRIAL_COLUMNS["session"],
    "entry": TRIAL_COLUMNS["entry"],
    "state": TRIAL_COLUMNS["state"],
    "group": TRIAL_COLUMNS["group"],
    "liquids": "Liquids that the group sees, parted by +",
    "order": "Number of the order of the trials, from 0; sessions that share one share the number",
    "practice_trials": "Number of practice trials that were answered",
    "test_trials": "Number of test trials that were answered",
    "median_rt": "Median time from picture to answer, test trials [s]",
    "started": "When the session began [seconds since 1970, UTC]",
    "duration": "Time from the session's begin to its last record [s]",
    "attempts": "How often the questions about the instructions were answered",
    "browser": "Name and version of the browser",
    "system": "Operating system",
    "mobile": "Whether it was a mobile device",
    "refresh_rate": "Pictures that the screen shows in a second, measured [1/s]",
    "language": "Language of the browser",
    "browsers": "Browsers that took turns with the session; with more than 1 its answers may be of "
    "more than one person",
    "kept_aside": "Records that came under a key that had another one already",
    "remarks": "What the participant wrote at the end",
    "code": "The session's own code",
    "simulated": "Whether it is a simulated observer",
}
"""Columns of the table of participants, and what each means."""

FREE_TEXT = ("remarks",)
"""Columns in which people may have written who they are."""

KNOWN_ELSEWHERE = ("code",)
"""Columns by which the recruiting platform, or whoever saw the last page, knows a person."""

IDENTIFIER_PREFIX = "id_"
"""Begins the columns of the recruiting platform's ids; no other column begins so."""

_LONGEST_NAME = 60
_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff]")


def trials_table(
    storage: Storage, *, preview: bool = False, trajectories: bool = True
) -> pd.DataFrame:
    """All judgments, a row each, practice too; columns as in `TRIAL_COLUMNS`.

    Parameters
    ----------
    storage
        The database.
    preview
        Those of previews, too.
    trajectories
        With the handle's whole way, if it was recorded.
    """
    sessions = _chosen(storage, preview=preview)
    rows = []
    for record in storage.records():
        session = sessions.get(record.session)
        if session is not None and record.kind == "judgment":
            rows.append(_trial(session, session.steps[record.seq], record))
    table = pd.DataFrame(rows, columns=list(TRIAL_COLUMNS)).astype({"block": "Int64"})
    if not trajectories or table["trajectory"].isna().all():
        table = table.drop(columns="trajectory")
    return table


def participants_table(
    storage: Storage, *, preview: bool = False, identifiers: bool = False
) -> pd.DataFrame:
    """All sessions, a row each; columns as in `PARTICIPANT_COLUMNS`.

    Parameters
    ----------
    storage
        The database.
    preview
        Those of previews, too.
    identifiers
        With the recruiting platform's ids, which must not be published; each in a column
        that begins with `IDENTIFIER_PREFIX`.
    """
    sessions = _chosen(storage, preview=preview)
    records: dict[int, list[Record]] = {number: [] for number in sessions}
    for record in storage.records():
        if record.session in records:
            records[record.session].append(record)
    conflicts = Counter(record.session for record in storage.conflicts())
    at_once = storage.browsers_at_once()
    rows = []
    for number, session in sessions.items():
        counts = {"browsers": at_once.get(number, 1), "kept_aside": conflicts[number]}
        rows.append(_participant(session, records[number]) | counts)
    table = pd.DataFrame(rows, columns=list(PARTICIPANT_COLUMNS))
    return _with_identifiers(table, list(sessions.values())) if identifiers else table


def _with_identifiers(table: pd.DataFrame, sessions: Sequence[Session]) -> pd.DataFrame:
    """A table of sessions with their identifiers; a column has one name's, and is none of ours."""
    columns = identifier_columns(name for one in sessions for name in one.identifiers)
    given = {
        column: [printable(one.identifiers.get(name)) for one in sessions]
        for name, column in columns.items()
    }
    return pd.concat([table, pd.DataFrame(given, index=table.index, dtype=object)], axis=1)


def identifier_columns(names: Iterable[str]) -> Mapping[str, str]:
    """Column of each name of an identifier. A name may be any text, as it came in a file."""
    columns: dict[str, str] = {}
    for name in dict.fromkeys(names):
        column = IDENTIFIER_PREFIX + re.sub(r"[^\w.-]", "_", name)[:_LONGEST_NAME]
        same = sum(
            re.fullmatch(rf"{re.escape(column)}(~\d+)?", c) is not None for c in columns.values()
        )
        columns[name] = f"{column}~{same + 1}" if same else column
    return columns


def _chosen(storage: Storage, *, preview: bool) -> dict[int, Session]:
    return {
        one.number: one
        for one in storage.sessions()
        # Those who declined are there only until a server that was killed starts again.
        if one.state != DECLINED and (preview or one.entry != "preview")
    }


def _who(session: Session) -> dict[str, Any]:
    """What both tables say of a session."""
    return {
        "participant": session.participant,
        "session": session.number,
        "entry": session.entry,
        "state": session.state,
        "group": session.group + 1,
        "simulated": session.entry == "simulation",
    }


def _trial(session: Session, step: Step, record: Record) -> dict[str, Any]:
    body: dict[str, Any] = json.loads(record.body)
    way = body.pop("trajectory")
    return (
        body
        | _who(session)
        | {
            "phase": step.phase,
            "block": step.block or None,
            "trial": step.trial,
            "scene": step.scene,
            "liquid": step.liquid,
            "mirrored": step.mirrored,
            "received": record.received,
            "trajectory": None if way is None else json.dumps(way),
        }
    )


def _participant(session: Session, records: Sequence[Record]) -> dict[str, Any]:
    bodies = [(session.steps[record.seq], json.loads(record.body)) for record in records]
    of_kind = {step.kind: body for step, body in bodies}
    judged = [(step.phase, body["rt"]) for step, body in bodies if step.kind == "judgment"]
    test = [rt for phase, rt in judged if phase == "test"]
    check = of_kind.get("check", {})
    liquids = dict.fromkeys(step.liquid for step in session.steps if step.phase == "test")
    row = _who(session) | {
        "liquids": "+".join(sorted(liquids, reverse=True)),
        "order": session.place,
        "practice_trials": len(judged) - len(test),
        "test_trials": len(test),
        "median_rt": float(pd.Series(test, dtype=float).median()),
        "started": session.started,
        "duration": max((r.received for r in records), default=session.started) - session.started,
        "attempts": len(of_kind.get("instructions", {}).get("attempts", [])),
        "browser": f"{check.get('browser', '')} {check.get('browser_version', '')}".strip(),
        "system": check.get("system", ""),
        "mobile": check.get("mobile", False),
        "refresh_rate": check.get("refresh_rate"),
        "language": check.get("language", ""),
        "remarks": of_kind.get("debrief", {}).get("remarks", ""),
        "code": session.code,
    }
    return {name: printable(value) for name, value in row.items()}


def printable(value: Any) -> Any:
    """A text that any program can read: halves of characters and control characters replaced."""
    return _UNPRINTABLE.sub("\ufffd", value) if isinstance(value, str) else value


def write_csv(path: Path, table: pd.DataFrame, *, private: bool = False, mark: bool = True) -> None:
    """Write a table of people's data as CSV; see `pourcast.tables.csv_bytes`.

    Parameters
    ----------
    path, table
        The file, and what is to be in it.
    private
        For its owner alone.
    mark
        Begin with a byte-order mark, if there are letters beyond ASCII.
    """
    with replacing(path, private=private) as temporary:
        temporary.write_bytes(csv_bytes(table, mark=mark))
