"""Links that participants come by, and what their parameters say of them."""

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Entry = Literal["lab", "prolific", "mturk", "preview", "simulation"]

PROLIFIC = ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")
MTURK = ("workerId", "assignmentId", "hitId")

PERSONAL = ("participant", PROLIFIC[0], MTURK[0])
"""Identifiers that tell one person from all others; those of studies and sessions don't."""

_CALLED: tuple[Entry, ...] = ("lab", "prolific", "mturk")
"""Entries by which people have a name that is the same whenever they come."""

_KEYED: tuple[Entry, ...] = ("lab", "preview", "simulation")


@dataclass(frozen=True)
class Visitor:
    """Who comes by a link.

    Parameters
    ----------
    entry
        How.
    identifiers
        Ids that the recruiting platform gave.
    participant
        The same code for the same platform id; empty if there is none.
    """

    entry: Entry
    identifiers: Mapping[str, str] = field(default_factory=dict)
    participant: str = ""


def link_key(secret: bytes, entry: str) -> str:
    """The word that opens a link of ours."""
    return hmac.new(secret, f"link {entry}".encode(), hashlib.sha256).hexdigest()[:20]


def participant_code(secret: bytes, identifier: str) -> str:
    """Code of a platform's id, that can't be turned back without the study's database."""
    return hmac.new(secret, f"id {identifier}".encode(), hashlib.sha256).hexdigest()[:12]


def codes_of(identifier: str, secret: bytes) -> set[str]:
    """Codes of whoever is called so, wherever they came from."""
    return {participant_code(secret, f"{entry} {identifier}") for entry in _CALLED}


def participant_links(base: str, secret: bytes) -> dict[str, str]:
    """The links to give away, by entry."""
    prolific = "&".join(f"{name}={{{{%{name}%}}}}" for name in PROLIFIC)
    return {
        "lab": f"{base}/?lab={link_key(secret, 'lab')}",
        "prolific": f"{base}/?{prolific}",
        "preview": f"{base}/?preview={link_key(secret, 'preview')}",
    }


def visitor(parameters: Mapping[str, str], secret: bytes) -> Visitor | None:
    """Who comes by a link with these parameters; None if the link is none of ours."""
    for entry in _KEYED:
        if entry in parameters:
            given = parameters[entry].encode()
            if not hmac.compare_digest(given, link_key(secret, entry).encode()):
                return None
            name = parameters.get("participant", "")
            if entry != "lab" or not name:
                return Visitor(entry)
            return Visitor(entry, {"participant": name}, participant_code(secret, f"lab {name}"))
    for platform, names in (("prolific", PROLIFIC), ("mturk", MTURK)):
        identifier = parameters.get(names[0], "")
        if identifier and parameters.get("assignmentId") != "ASSIGNMENT_ID_NOT_AVAILABLE":
            ids = {name: parameters[name] for name in names if parameters.get(name)}
            platform_entry: Entry = "prolific" if platform == "prolific" else "mturk"
            return Visitor(
                platform_entry, ids, participant_code(secret, f"{platform} {identifier}")
            )
    return None
