"""Journals as they were before lines named sessions by key and said what was shown (schema 1).

Their lines name a session by its number in the database; numbers began again at 1 when the database
was lost, and then a line that opens a session begins another one.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pourcast.experiment.data.answer_files import Faults, Place
from pourcast.experiment.storage.record_lines import FORMAT, Line

_OPENING = "session"
"""The kind that a line has that opens a session."""


def is_old_line(content: Any) -> bool:
    """Whether something is a line of such a journal."""
    return (
        isinstance(content, dict)
        and isinstance(content.get("session"), int)
        and isinstance(content.get("body"), dict)
        and {"seq", "kind"} <= content.keys()
    )


def current_lines(
    values: Iterable[tuple[Place, Any]], keys: Mapping[tuple[str, float], str], faults: Faults
) -> Iterator[tuple[Place, Any]]:
    """Lines of an old journal as they are written now; what is none is passed on.

    Parameters
    ----------
    values
        What is in the file, in its order.
    keys
        Keys of sessions that the database has, by participant and begin: the same session has the
        same key.
    faults
        Told of records that no line before opens.
    """
    opened: dict[int, str] = {}
    for place, content in values:
        if not is_old_line(content):
            yield place, content
        elif content["kind"] == _OPENING:
            line = _opening(content, keys)
            opened[content["session"]] = line["session"]
            yield place, line
        elif content["session"] in opened:
            yield place, content | {"session": opened[content["session"]]}
        else:
            faults.add(place, "left out: no line before opens its session")


def _opening(content: dict[str, Any], keys: Mapping[tuple[str, float], str]) -> Line:
    body, started = content["body"], content.get("received")
    who = str(body.get("participant")), started
    made = hashlib.sha256(f"{content['session']} {who[0]} {started}".encode()).hexdigest()[:32]
    known = isinstance(started, float | int) and keys.get((who[0], float(started)))
    return {**body, "format": FORMAT, "session": known or made, "started": started}
