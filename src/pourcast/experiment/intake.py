"""Records from files: those that a participant downloaded, or that JATOS or DataPipe kept."""

import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pourcast.errors import InputError
from pourcast.experiment.journal import Journal
from pourcast.experiment.links import visitor
from pourcast.experiment.plan import Step
from pourcast.experiment.records import canonical
from pourcast.experiment.storage import Arrival, Record, Session, Storage
from pourcast.scene import one_line

FORMAT = "pourcast-records"


class _Opening(BaseModel):
    """First line of a session in a file."""

    model_config = ConfigDict(extra="ignore")

    format: str
    session: str = Field(min_length=8, max_length=100)
    entry: str = Field(default="static", max_length=20)
    identifiers: dict[str, str] = Field(default_factory=dict, max_length=20)
    group: int | None = Field(default=None, ge=0)
    place: int | None = Field(default=None, ge=0)


class _Line(BaseModel):
    """A record in a file."""

    model_config = ConfigDict(extra="ignore")

    session: str
    seq: int = Field(ge=0)
    body: dict[str, Any]


@dataclass(frozen=True)
class Imported:
    """What was read from a file: sessions, and what became of its records."""

    sessions: int
    new: int
    repeated: int
    kept_aside: int


def import_records(
    path: Path,
    storage: Storage,
    journal: Journal,
    plan: Callable[[int, int], Sequence[Step]],
    now: float,
) -> Imported:
    """Take in a file of records: one that a participant downloaded, or that JATOS or DataPipe kept.

    Parameters
    ----------
    path
        JSON Lines: a line that opens each session, and a line each record.
    storage, journal
        Where they go.
    plan
        From group and place to a session's steps, of sessions that the database does not know.
    now
        Seconds since 1970.

    Raises
    ------
    InputError
        One line that names the file, the line and what was expected. Nothing of the
        file is taken in then.
    """
    sessions: dict[str, Session] = {}
    records = []
    for number, content in _json_lines(path):
        where = f"{path}: line {number}"
        try:
            if "format" in content:
                opening = _Opening.model_validate(content)
                sessions[opening.session] = _opened(opening, storage, plan, now, where)
                continue
            line = _Line.model_validate(content)
            session = sessions.get(line.session)
            if session is None:
                raise InputError(f"{where}: session: no line before opens it")
            if line.seq >= len(session.plan):
                raise InputError(f"{where}: seq: expected below {len(session.plan)}")
            kind = session.plan[line.seq].kind
            body = canonical(kind, line.body)
        except ValidationError as error:
            raise InputError(f"{where}: {one_line(error)}") from None
        records.append(Record(session.number, line.seq, kind, body, now))
    results = storage.save(records) if records else []
    journal.append(r for r, saved in zip(records, results, strict=True) if saved.result == "new")
    for session in sessions.values():
        if len(storage.done(session.number)) == len(session.plan):
            storage.end(session.number, "complete")
    found = Counter(saved.result for saved in results)
    return Imported(len(sessions), found["new"], found["repeated"], found["conflict"])


def _json_lines(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file ({error})") from None
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            content = json.loads(line)
        except ValueError as error:
            raise InputError(f"{path}: line {number}: not JSON ({error})") from None
        if not isinstance(content, dict):
            raise InputError(f"{path}: line {number}: expected an object")
        yield number, content


def _opened(
    opening: _Opening,
    storage: Storage,
    plan: Callable[[int, int], Sequence[Step]],
    now: float,
    where: str,
) -> Session:
    """The session of an opening line; a new one, if it was run without our server."""
    if opening.format != FORMAT:
        raise InputError(f"{where}: format: expected {FORMAT}, found {opening.format}")
    known = storage.session_of(opening.session)
    if known is not None:
        return known
    if opening.group is None or opening.place is None:
        raise InputError(f"{where}: session: not one of this study's")
    who = visitor(opening.identifiers, storage.secret)
    arrival = Arrival(
        f"import {opening.session}",
        opening.entry,
        opening.identifiers,
        tab="",
        participant=who.participant if who else "",
    )
    return storage.insert(arrival, opening.group, opening.place, plan, now)
