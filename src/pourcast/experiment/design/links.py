"""Links that participants come by, and what their parameters say of them."""

import hashlib
import hmac
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from pourcast.errors import InputError

Entry = Literal["lab", "prolific", "mturk", "preview", "simulation"]

PROLIFIC = ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")
MTURK = ("workerId", "assignmentId", "hitId")

PERSONAL = ("participant", PROLIFIC[0], MTURK[0])
"""Identifiers that tell one person from all others; those of studies and sessions don't."""

VISITS = (PROLIFIC[2], MTURK[1])
"""Identifiers of one visit of one person at the platform."""

_CALLED: tuple[Entry, ...] = ("lab", "prolific", "mturk")
"""Entries by which people have a name that is the same whenever they come."""

IDENTIFIERS = ("participant", *PROLIFIC, *MTURK)
"""All parameters of a link that a platform, or the researcher, fills in."""

UNACCEPTED = "ASSIGNMENT_ID_NOT_AVAILABLE"
"""What MTurk gives as `assignmentId` to who looks at a task without having accepted it."""

UNFILLED = "unfilled"
"""Among identifiers: the names of those that the link had, and nobody had filled in."""

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


def personal(identifiers: Mapping[str, str]) -> set[str]:
    """Those of somebody's identifiers that are nobody else's."""
    return {value for name, value in identifiers.items() if name in PERSONAL and value}


def participant_links(base: str, secret: bytes) -> dict[str, str]:
    """The links to give away, by entry."""
    prolific = "&".join(f"{name}={{{{%{name}%}}}}" for name in PROLIFIC)
    return {
        "lab": f"{base}/?lab={link_key(secret, 'lab')}",
        "prolific": f"{base}/?{prolific}",
        "preview": f"{base}/?preview={link_key(secret, 'preview')}",
    }


def visitor(parameters: Mapping[str, str], secret: bytes) -> Visitor | None:
    """Who comes by a link with these parameters; None if the link is none of ours, or nobody's.

    Identifiers count without blanks around them; one that nobody filled in counts as missing.
    """
    ids = identifiers(parameters)
    for entry in _KEYED:
        if entry in parameters:
            given = parameters[entry].strip().encode()
            if not hmac.compare_digest(given, link_key(secret, entry).encode()):
                return None
            if entry != "lab" or "participant" not in parameters:
                return Visitor(entry)
            name = ids.get("participant", "")
            code = participant_code(secret, f"lab {name}")
            return Visitor(entry, {"participant": name}, code) if name else None
    for platform, names in (("prolific", PROLIFIC), ("mturk", MTURK)):
        identifier = ids.get(names[0], "")
        if identifier and not is_unaccepted(parameters):
            platform_entry: Entry = "prolific" if platform == "prolific" else "mturk"
            return Visitor(
                platform_entry,
                {name: ids[name] for name in names if name in ids},
                participant_code(secret, f"{platform} {identifier}"),
            )
    return None


def is_unaccepted(parameters: Mapping[str, str]) -> bool:
    """Whether somebody looks at a task on MTurk without having accepted it."""
    return parameters.get("assignmentId", "").strip() == UNACCEPTED


def unfilled(parameters: Mapping[str, str]) -> dict[str, str]:
    """Identifiers of a link that nobody filled in, with what stands in their place."""
    return {
        name: parameters[name]
        for name in IDENTIFIERS
        if name in parameters and not filled(parameters[name])
    }


def identifiers(parameters: Mapping[str, str]) -> dict[str, str]:
    """Identifiers of a link that somebody filled in."""
    found = {name: filled(parameters[name]) for name in IDENTIFIERS if name in parameters}
    return {name: value for name, value in found.items() if value}


def marked(parameters: Mapping[str, str]) -> dict[str, str]:
    """A link's parameters; the names of those that nobody filled in stand under `UNFILLED`."""
    missing = unfilled(parameters)
    kept = {name: value for name, value in parameters.items() if name not in missing}
    kept |= identifiers(parameters)
    return kept | ({UNFILLED: " ".join(missing)} if missing else {})


def filled(value: str) -> str:
    """An identifier without blanks around it; empty if it is a placeholder.

    Examples
    --------
    >>> filled(" 5f0c1d2e3b4a5968778695a4 ")
    '5f0c1d2e3b4a5968778695a4'
    >>> [filled(value) for value in ("{{%PROLIFIC_PID%}}", "${e://Field/ID}", "[ID]", "null", " ")]
    ['', '', '', '', '']
    """
    text = _visible(value)
    plain = text
    for _ in range(3):  # links are encoded again by whoever passes them on
        plain = _visible(unquote(plain))
    return "" if _PLACEHOLDER.fullmatch(plain) else text


def read_ids(path: Path) -> frozenset[str]:
    """Ids of a platform's participants, from a text file with one on each line.

    Raises
    ------
    InputError
        One line that names the file, the line and what was expected.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file ({error})") from None
    ids = {number: filled(line) for number, line in enumerate(lines, start=1) if line.strip()}
    for number, one in ids.items():
        if not one or re.search(r"[\s,;\"]", one):
            found = lines[number - 1].strip()
            raise InputError(f"{path}: line {number}: expected one id, found {found[:60]!r}")
    if not ids:
        raise InputError(f"{path}: expected an id on each line, found none")
    return frozenset(ids.values())


def _visible(text: str) -> str:
    """A text without the characters around it that nobody sees."""
    hidden = {one for one in text if one.isspace() or unicodedata.category(one) in ("Cc", "Cf")}
    return text.strip("".join(hidden))


_PLACEHOLDER = re.compile(
    r"""
    [\W_]*                                        # no letter and no digit
    | [$#@:]?\{.* | .*\} | \$\w+ | :[A-Z_]+        # {{%PROLIFIC_PID%}}, ${e://Field/ID}, $ID, :ID
    | \[.*\] | <.*> | %.*% | @.*@ | __.*__         # [ID], <ID>, %ID%, @ID@, __ID__
    | [\W_]*(PROLIFIC_?P?ID|(STUDY|SESSION|WORKER|ASSIGNMENT|HIT|PARTICIPANT)_?ID|P?ID)[\W_]*
    | ASSIGNMENT_ID_NOT_AVAILABLE | undefined | null | n/a | (your|my)[ _-]?id
    | (?-i:none|None|nil|nan|NaN)                 # Nan is a name
    """,
    re.VERBOSE | re.IGNORECASE | re.DOTALL,
)
"""What stands in a link in place of an identifier, until a platform fills it in."""
