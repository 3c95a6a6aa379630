"""A person who took part, by all the names that files may call them."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pourcast.experiment.data.file_search import Needle
from pourcast.experiment.design.links import PERSONAL, VISITS, personal

_SHORTEST = 6
"""A name with fewer letters stands in many files that speak of nobody."""

_DISTINCTIVE = 10
"""Platforms' ids have as many letters, digits among them: no other word is written so."""


@dataclass(frozen=True)
class SessionNames:
    """What a session, and who took part in it, are called.

    Parameters
    ----------
    key, code, participant
        As in `storage.sessions.Session`; empty where it isn't known.
    requests
        By which browsers began it, or went on with it.
    identifiers
        The recruiting platform's ids.
    tokens
        Digests of its tokens.
    """

    key: str = ""
    requests: tuple[str, ...] = ()
    code: str = ""
    participant: str = ""
    identifiers: Mapping[str, str] = field(default_factory=dict)
    tokens: tuple[str, ...] = ()

    @property
    def given(self) -> set[str]:
        """What others call this person alone; a study's id would be everybody's."""
        return personal(self.identifiers)

    @property
    def visits(self) -> set[str]:
        """What the platform calls this visit."""
        return {value for name, value in self.identifiers.items() if name in VISITS and value}

    @property
    def names(self) -> set[str]:
        """What this person can be asked for by."""
        return {name for name in (self.participant, self.code, self.key) if name} | self.given


@dataclass(frozen=True)
class Person:
    """A participant: all their sessions.

    Parameters
    ----------
    sessions
        What is known of their sessions; may be none.
    asked
        What they were asked for by.
    codes
        Participant codes that belong to what they were asked for by.
    others
        What other people and their visits are called.
    """

    sessions: tuple[SessionNames, ...]
    asked: str
    codes: frozenset[str] = frozenset()
    others: frozenset[str] = frozenset()

    @property
    def keys(self) -> set[str]:
        """Keys of the sessions."""
        return {one.key for one in self.sessions if one.key}

    @property
    def tokens(self) -> set[str]:
        """Digests of the sessions' tokens."""
        return {token for one in self.sessions for token in one.tokens}

    @property
    def participants(self) -> set[str]:
        """Participant codes."""
        return {one.participant for one in self.sessions if one.participant} | self.codes

    @property
    def completion_codes(self) -> set[str]:
        """The sessions' own completion codes."""
        return {one.code for one in self.sessions if one.code}

    @property
    def given(self) -> set[str]:
        """What others call the person; what was asked for by, unless it is a name of ours."""
        ours = {name for one in self.sessions for name in (one.key, one.code, one.participant)}
        return {name for one in self.sessions for name in one.given} | ({self.asked} - ours)

    @property
    def visits(self) -> set[str]:
        """What the platform calls their visits, as far as that is nobody else's too."""
        visits = {name for one in self.sessions for name in one.visits}
        return {name for name in visits - self.others if len(name) >= _SHORTEST}

    @property
    def distinctive(self) -> set[str]:
        """What others call the person, as far as hardly anybody else can be called so."""
        return {
            name
            for name in self.given
            if len(name) >= _DISTINCTIVE and any(letter.isdigit() for letter in name)
        }

    @property
    def to_look_for(self) -> list[str]:
        """What files elsewhere may call the person."""
        codes = {one.participant for one in self.sessions if one.participant} or self.codes
        return sorted(self.given | codes | self.visits | self.completion_codes | self.keys)

    def needles(self) -> list[Needle]:
        """What to look for in files."""
        own = [
            *((name, f"participant code {name}") for name in sorted(self.participants)),
            *((name, f"the platform's session {name}") for name in sorted(self.visits)),
            *((name, f"completion code {name}") for name in sorted(self.completion_codes)),
            *((name, f"session {name}") for name in sorted(self.keys)),
            *((word, "request of a browser") for one in self.sessions for word in one.requests),
            *((token, "digest of a token") for token in sorted(self.tokens)),
        ]
        made_by_us = [Needle(text, label, whole=True) for text, label in own]
        return [*(self._needle(name) for name in sorted(self.given)), *made_by_us]

    def _needle(self, name: str) -> Needle:
        """A name that others gave: it may be any text, and a part of another's."""
        is_others = any(name in other for other in self.others)
        return Needle(
            name,
            f"id {name!r}",
            whole=True,
            fields=PERSONAL if len(name) < _SHORTEST else (),
            in_databases=len(name) >= _SHORTEST and not is_others,
        )


def person_called(who: str, known: Iterable[SessionNames], codes: Iterable[str] = ()) -> Person:
    """A person and all their sessions, by one of their names.

    Parameters
    ----------
    who
        A platform's id, a name in the lab, the code of the participant or of a session.
    known
        All sessions that are known of, from the database or the journal.
    codes
        Participant codes that a platform's id of this name has.
    """
    known = list(known)
    codes = set(codes)
    named = [one for one in known if who in one.names or one.participant in codes]
    # Another session of the same person bears the same code.
    codes |= {one.participant for one in named if one.participant}
    keys = {one.key for one in named}
    theirs = tuple(one for one in known if one.key in keys or one.participant in codes)
    return Person(
        theirs,
        who,
        frozenset(codes),
        frozenset(n for one in known if one not in theirs for n in one.names | one.visits) - {who},
    )


def names_in_lines(lines: Iterable[Mapping[str, Any]]) -> list[SessionNames]:
    """What sessions are called in the lines of a journal, or of what a database should have in it.

    A session may be opened by several lines; all that they say counts.
    """
    openings: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    tokens: dict[str, set[str]] = defaultdict(set)
    requests: dict[str, set[str]] = defaultdict(set)
    for line in lines:
        key = str(line.get("session", ""))
        if "identifiers" in line:
            openings[key].append(line)
        tokens[key].update(map(str, (*line.get("tokens", ()), line.get("token", ""))))
        requests[key].update(map(str, (line.get("request", ""), line.get("browser", ""))))
    return [
        SessionNames(
            key=key,
            requests=tuple(sorted(requests[key] - {""})),
            code=str(line.get("code", "")),
            participant=str(line.get("participant", "")),
            identifiers={str(k): str(v) for k, v in line["identifiers"].items()},
            tokens=tuple(sorted(tokens[key] - {""})),
        )
        for key, opened in openings.items()
        for line in opened
    ]
