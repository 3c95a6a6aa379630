"""The lines that sessions and records are written in outside the database: one form of JSON.

The study's journal has them, a participant's downloaded file, and what JATOS and DataPipe collect;
`data.record_import` reads them all. An opening line says whose records follow:

    {"format": "pourcast-records", "schema_version": 2, "session": KEY, "group": 0, "place": 3, ...}

and each record is a line that could be understood alone:

    {"session": KEY, "seq": 7, "kind": "judgment", "scene": "a-1", "liquid": "honey", "body": {...}}

The journal says more, so that a database can be made of it that lacks nothing: its first line has
the secrets of the database, opening lines have all of a session, and what changed since has lines
of its own. So it is as confidential as the database.
"""

import json
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

from pourcast.experiment.storage.records import Record
from pourcast.experiment.storage.sessions import OPEN, Session, plan_content

FORMAT = "pourcast-records"
"""What an opening line calls its format."""

JOURNAL_FORMAT = "pourcast-journal"
"""What the first line of a journal calls its format."""

SHOWN = ("phase", "trial", "block", "liquid", "scene", "mirrored")
"""What a record's line says of its step, should its session's opening line be lost."""

LAST = "last_session"
"""What the first line of a journal calls the last number of a session, if some are gone."""

SCHEMA_VERSION = 2

CHANGES = ("token", "tab", "browser", "state")
"""What a journal's line says that tells what became of a session."""

Line = Mapping[str, Any]


def head_line(words: Mapping[str, str]) -> Line:
    """First line of a journal: the secrets of the database, which links and names come from."""
    return {"format": JOURNAL_FORMAT, "schema_version": SCHEMA_VERSION, **words}


def opening_line(session: Session, database: str, tokens: Sequence[str] = ()) -> Line:
    """All of a session but its records, and whose it is; `tokens` are digests."""
    return {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "session": session.key,
        "number": session.number,
        "request": session.request,
        "participant": session.participant,
        "entry": session.entry,
        "identifiers": dict(session.identifiers),
        "group": session.group,
        "place": session.place,
        "code": session.code,
        "tab": session.tab,
        "started": session.started,
        "tokens": list(tokens),
        "database": database,
        "steps": plan_content(session.steps),
    }


def record_line(session: Session, record: Record, *, aside: bool = False) -> Line:
    """A record, and what it was a record of; `aside`: another one came before under its key."""
    step = session.steps[record.seq]
    return (
        {"session": session.key, "seq": record.seq, "kind": record.kind}
        | {"group": session.group, "place": session.place}
        | step.model_dump(include=set(SHOWN), exclude_defaults=True)
        | {"body": json.loads(record.body), "received": record.received}
        | ({"aside": True} if aside else {})
    )


def token_line(key: str, digest: str) -> Line:
    """A further token that lets its holder write to a session."""
    return {"session": key, "token": digest}


def tab_line(key: str, tab: str) -> Line:
    """A browser tab that took a session over."""
    return {"session": key, "tab": tab}


def browser_line(key: str, request: str) -> Line:
    """A browser that went on with a session while another one was at it."""
    return {"session": key, "browser": request}


def state_line(key: str, state: str) -> Line:
    """How a session ended."""
    return {"session": key, "state": state}


def line_names(line: Line) -> set[Hashable]:
    """What a line says, in short: two lines with the same names say the same."""
    key = line.get("session")
    if line.get("format") == JOURNAL_FORMAT:
        return {("words", line.get("secret"), line.get("admin"))}
    if line.get("format") == FORMAT:
        tokens = line.get("tokens", ())
        return {(key, "opening", ""), *((key, "token", str(token)) for token in tokens)}
    if "seq" in line:
        body = json.dumps(line.get("body"), sort_keys=True) if line.get("aside") else ""
        return {(key, str(line["seq"]), body)}
    return {(key, name, str(line[name])) for name in CHANGES if name in line}


def names_of(lines: Iterable[Line]) -> set[Hashable]:
    """What all of some lines say; a state counts until the next."""
    names: set[Hashable] = set()
    states = {}
    for line in lines:
        if "state" in line:
            states[line.get("session")] = line
        elif line.get("format") == FORMAT:
            states.setdefault(line.get("session"), state_line(line["session"], OPEN))
        if "state" not in line:
            names |= line_names(line)
    return names.union(*map(line_names, states.values()))


def is_line(content: object) -> bool:
    """Whether something is a line of this form, as far as what tells it from others goes."""
    if not isinstance(content, dict):
        return False
    if content.get("format") == JOURNAL_FORMAT:
        return all(isinstance(content.get(name), str) for name in ("secret", "admin"))
    if not isinstance(content.get("session"), str):
        return False
    if content.get("format") == FORMAT:
        return isinstance(content.get("tokens", []), list)
    if "seq" in content:
        return isinstance(content["seq"], int)
    changes = [content[name] for name in CHANGES if name in content]
    return bool(changes) and all(isinstance(change, str) for change in changes)


def dumps(line: Line) -> str:
    """A line as text, with its end."""
    return json.dumps(line, separators=(",", ":"), ensure_ascii=False) + "\n"
