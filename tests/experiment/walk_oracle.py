"""What each person was told is saved, and whether the study has it: the oracle of the walk.

It shares no code with the server: it knows what browsers sent and what they were told.
"""

import json
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from pourcast.experiment.data.tables import participants_table, trials_table

OPEN, COMPLETE, DROPPED, DECLINED_LATER = "open", "complete", "dropped", "declined_later"
RECRUITED = ("lab", "prolific")
MOST_CONFLICTS = 20


@dataclass
class Kept:
    """A session that somebody was told of, and what was said to be saved of it.

    `may_be` are the states that it may have next, beside its own; `overdue`: nothing was heard of
    it for longer than the design allows.
    """

    key: str
    request: str
    link: dict[str, str]
    participant: str
    steps: list[dict[str, Any]]
    tab: str
    heard: float
    state: str = OPEN
    code: str = ""
    overdue: bool = False
    may_be: set[str] = field(default_factory=set)
    number: int | None = None
    place: tuple[int, int] | None = None
    records: dict[int, dict[str, Any]] = field(default_factory=dict)
    conflicts: dict[int, list[dict[str, Any]]] = field(default_factory=dict)
    received: dict[int, float] = field(default_factory=dict)

    @property
    def entry(self):
        """How they came."""
        return entry_of(self.link)

    @property
    def missing(self):
        """Numbers of the steps that nothing is saved of."""
        return [step["seq"] for step in self.steps if step["seq"] not in self.records]

    @property
    def marks(self):
        """What is found nowhere else than with this person."""
        texts = [
            body["remarks"]
            for bodies in ([*self.records.values()], *self.conflicts.values())
            for body in bodies
            if "remarks" in body
        ]
        return {self.key, self.request, *texts, *personal(self.link)}


def entry_of(link):
    """How somebody comes by a link."""
    return "prolific" if "PROLIFIC_PID" in link else "lab" if "lab" in link else "preview"


def personal(link):
    """What a link says of a person."""
    return {link[name] for name in ("PROLIFIC_PID", "participant") if name in link}


class Oracle:
    """All that people were told.

    Parameters
    ----------
    world
        The server and its clocks.
    largest_gap
        How long a participant may be silent [s].
    """

    def __init__(self, world, largest_gap):
        self.world, self.largest_gap = world, largest_gap
        self.seen: Counter[str] = Counter()
        self.alive: dict[str, Kept] = {}
        self.dead: dict[str, Kept] = {}
        self.tokens: dict[str, str] = {}
        self.numbers: dict[int, str] = {}

    # Time ----------------------------------------------------------------------------

    def pass_time(self, seconds):
        """Time passes for all."""
        self.world.clock.advance(seconds)
        for kept in self.alive.values():
            kept.overdue = kept.overdue or self._is_late(kept)

    def _is_late(self, kept):
        return self.world.clock.elapsed - kept.heard > self.largest_gap

    def _heard_of(self, kept):
        kept.heard = self.world.clock.elapsed
        kept.overdue = False

    # Answers -------------------------------------------------------------------------

    def answered(self, request, answer):
        """A request was answered: it must be the right answer, and is remembered."""
        assert answer.status < 500, (request, answer)
        self.seen[f"{request.what} {answer.status}"] += 1
        if request.what == "begin":
            self._began(request, answer)
            return
        kept = self.alive.get(self.tokens.get(request.token, ""))
        if kept is None:
            # Who declined, and never heard that it is done, is told so again.
            again = request.content.get("state") == "declined" and answer.status == 200
            assert answer.status == 401 or again, (request, answer)
            return
        {"resume": self._resumed, "save": self._saved, "finish": self._finished}[request.what](
            kept, request, answer
        )

    def _began(self, request, answer):
        link, word = request.content["link"], request.content["request"]
        same_request = [k for k in self.alive.values() if k.request == word]
        mine = same_request or [k for k in self.alive.values() if k.link == link and personal(link)]
        known = [k for k in self.alive.values() if personal(k.link) & personal(link)]
        if answer.status >= 300:
            # Nobody is refused who has not been here, or has just been here.
            assert mine or known, (request, answer)
            assert not mine or all(k.state != OPEN or self._is_late(k) for k in mine), answer
            assert all(k.state not in (OPEN, COMPLETE) or k.overdue for k in mine), answer
            return
        told = answer.said
        assert told["token"] not in self.tokens
        self.tokens[told["token"]] = told["key"]
        kept = self.alive.get(told["key"])
        if kept is None:
            assert not mine, (request, answer)
            self._opened(request, told)
            return
        assert kept in mine, (request, answer)
        self._view(kept, told)
        self._claimed(kept, request)

    def _opened(self, request, told):
        assert told["key"] not in self.dead
        assert told["state"] == OPEN
        assert told["done"] == []
        assert [step["seq"] for step in told["steps"]] == list(range(len(told["steps"])))
        self.alive[told["key"]] = Kept(
            told["key"], request.content["request"], request.content["link"],
            told["participant"], told["steps"], request.content["tab"],
            self.world.clock.elapsed, code=told["code"],
        )  # fmt: skip

    def _view(self, kept, told):
        """What a browser is told of a session that it goes on with."""
        assert told["key"] == kept.key
        assert told["participant"] == kept.participant
        assert told["entry"] == kept.entry
        assert told["steps"] == kept.steps
        assert told["done"] == sorted(kept.records)
        assert told["state"] == kept.state or told["state"] in self._allowed(kept)

    def _claimed(self, kept, request):
        tab = request.content.get("tab")
        if tab is not None and kept.state in (OPEN, DROPPED):
            kept.tab = tab
            self._heard_of(kept)

    def _resumed(self, kept, request, answer):
        if answer.status == 410:
            assert kept.state == DROPPED or kept.overdue, (request, answer)
            assert self._is_late(kept), "refused, though they have just been heard of"
            return
        assert answer.status == 200, (request, answer)
        self._view(kept, answer.said)
        self._claimed(kept, request)

    def _saved(self, kept, request, answer):
        assert answer.status == 200, (request, answer)
        said = answer.said
        assert said["saved"] == self._keep(kept, request.seq, request.content["body"])
        if kept.state in (OPEN, DROPPED):
            assert said["superseded"] == (request.content["tab"] != kept.tab)
        self._heard_of(kept)

    def _keep(self, kept, seq, body):
        """Remember a record; what it is called."""
        self.seen["records"] += seq not in kept.records
        if seq not in kept.records:
            kept.records[seq] = body
            return "new"
        if kept.records[seq] == body:
            return "repeated"
        others = kept.conflicts.setdefault(seq, [])
        if body not in others and len(others) < MOST_CONFLICTS:
            others.append(body)
        return "conflict"

    def _finished(self, kept, request, answer):
        assert answer.status == 200, (request, answer)
        said, state = answer.said, request.content["state"]
        self._end(kept, request)
        if kept.key in self.dead:
            return
        ended = kept.state not in (OPEN, DROPPED)
        assert said["missing"] == (kept.missing if state == COMPLETE and not ended else [])
        told = said.get("code", "")
        assert told == (kept.code if kept.state == COMPLETE and kept.entry != "lab" else "")

    def _end(self, kept, request):
        """End a session as a page wishes, if it can."""
        state = request.content["state"]
        if kept.state not in (OPEN, DROPPED):
            return  # what has ended stays as it is
        if state == COMPLETE:
            if not kept.missing:
                self.seen[f"{kept.state} to complete"] += 1
                kept.state = COMPLETE
        elif request.content["tab"] != kept.tab:
            pass  # a tab that was forgotten ends nothing
        elif state != "declined":
            kept.state = state
        elif kept.records:
            kept.state = DECLINED_LATER  # and nothing is deleted
        else:
            self.died(kept)

    def imported(self, kept, bodies, summary):
        """A person's file was taken in, or nobody heard that it was."""
        if summary is None:
            self._settle_import(kept, bodies)
            return
        said = Counter(self._keep(kept, seq, body) for seq, body in bodies.items())
        assert (summary.new, summary.repeated, summary.conflicts) == tuple(
            said[name] for name in ("new", "repeated", "conflict")
        )
        if not kept.missing and kept.state in (OPEN, DROPPED):
            kept.state = COMPLETE

    def _settle_import(self, kept, bodies):
        there = self._bodies_there()
        for seq, body in bodies.items():
            if there[kept.key, seq, body["rt"]]:
                self._keep(kept, seq, body)
        if not kept.missing and kept.state in (OPEN, DROPPED):
            kept.may_be = {COMPLETE}

    def died(self, kept):
        """Somebody declined, or was withdrawn."""
        self.seen["gone"] += 1
        del self.alive[kept.key]
        self.dead[kept.key] = kept

    def restored(self):
        """The database was made anew from the journal: numbers may have begun again."""
        self.numbers.clear()
        for kept in self.alive.values():
            kept.number = None

    # What was sent, and nobody heard the answer ------------------------------------------

    def settle(self, requests):
        """After a kill: each request that was on its way was done, or it was not."""
        sessions = {one.key: one for one in self.world.storage.sessions()}
        for request in requests:
            if request.what == "begin":
                self._settle_begin(request, sessions)
                continue
            kept = self.alive.get(self.tokens.get(request.token, ""))
            if kept is None:
                continue
            if request.what == "finish":
                done = sessions.get(kept.key)
                if done is None or done.state == request.content["state"].replace(
                    "declined", DECLINED_LATER
                ):
                    self._end(kept, request)
            elif request.what == "resume":
                self._settle_tab(kept, request, sessions)
        self._settle_records([one for one in requests if one.what == "save"])

    def _settle_begin(self, request, sessions):
        known = [k for k in self.alive.values() if k.request == request.content["request"]]
        link = request.content["link"]
        known = known or [k for k in self.alive.values() if k.link == link and personal(link)]
        for kept in known:
            self._settle_tab(kept, request, sessions)
        for key in sessions.keys() - self.alive.keys():
            session = sessions[key]
            assert not known, "a session that nobody began"
            assert dict(session.identifiers).items() <= link.items()
            told = {
                "key": key, "participant": session.participant, "state": OPEN, "done": [],
                "steps": [step.for_participant() for step in session.steps], "code": session.code,
            }  # fmt: skip
            self._opened(request, told)

    def _settle_tab(self, kept, request, sessions):
        if kept.key in sessions and sessions[kept.key].tab == request.content.get("tab"):
            self._claimed(kept, request)

    def _settle_records(self, requests):
        bodies = self._bodies_there()
        for request in requests:
            kept = self.alive.get(self.tokens.get(request.token, ""))
            body = request.content["body"]
            if kept is not None and bodies[kept.key, request.seq, body["rt"]]:
                self._keep(kept, request.seq, body)
                self._heard_of(kept)

    def _bodies_there(self):
        """The answers in the database, by session, step and what tells them from all others."""
        numbers = {one.number: one.key for one in self.world.storage.sessions()}
        there = [*self.world.storage.records(), *self.world.storage.conflicts()]
        return Counter((numbers[r.session], r.seq, _answer_id(r.body)) for r in there)

    # The study -------------------------------------------------------------------------

    def check(self):
        """The study has what people were told, each its own, and nothing else."""
        storage = self.world.storage
        sessions = {one.key: one for one in storage.sessions()}
        assert sessions.keys() == self.alive.keys(), "a session was lost, or rose again"
        for kept in self.alive.values():
            self._check_session(kept, sessions[kept.key])
        self._check_records(storage)
        self._check_journal()
        self._check_tables(storage)

    def _allowed(self, kept):
        """States that a session may have, beside the last one that was seen."""
        allowed = set(kept.may_be)
        if kept.state == OPEN and kept.overdue:
            allowed.add(DROPPED)
        if kept.state == DROPPED:
            allowed.add(OPEN)
        return allowed

    def _check_session(self, kept, session):
        assert session.state == kept.state or session.state in self._allowed(kept), (
            f"{kept.key} is {session.state}, and was {kept.state}"
        )
        if session.state != kept.state:
            self.seen[f"{kept.state} to {session.state}"] += 1
        kept.state, kept.may_be = session.state, set()
        if kept.number is None:
            assert session.number not in self.numbers, "a number was given out again"
            self.numbers[session.number] = kept.key
            kept.number = session.number
        if kept.place is None:
            self._check_place(kept, session)
            kept.place = (session.group, session.place)
        assert session.number == kept.number
        assert (session.group, session.place) == kept.place
        assert session.participant == kept.participant
        assert session.code == kept.code
        assert session.entry == kept.entry
        assert set(session.identifiers.values()) >= personal(kept.link)
        assert [step.for_participant() for step in session.steps] == kept.steps

    def _check_place(self, kept, session):
        """Who is new has a place of their own."""
        taken = {
            other.place
            for other in self.alive.values()
            if other.place is not None and other.entry in RECRUITED
            and (other.state == COMPLETE or (other.state == OPEN and not other.overdue))
        }  # fmt: skip
        assert kept.entry not in RECRUITED or (session.group, session.place) not in taken

    def _check_records(self, storage):
        numbers = {kept.number: kept for kept in self.alive.values()}
        there = {}
        for record in storage.records():
            kept = numbers[record.session]
            there[kept.key, record.seq] = json.loads(record.body)
            assert kept.steps[record.seq]["kind"] == record.kind
            assert kept.received.setdefault(record.seq, record.received) == record.received
        told = {
            (kept.key, seq): body
            for kept in self.alive.values()
            for seq, body in kept.records.items()
        }
        assert there.keys() == told.keys(), "a record was lost, or came from nowhere"
        for key, body in told.items():
            assert body.items() <= there[key].items(), key
        aside = Counter(
            (numbers[one.session].key, one.seq, _answer_id(one.body)) for one in storage.conflicts()
        )
        assert aside == Counter(
            (kept.key, seq, body["rt"])
            for kept in self.alive.values()
            for seq, bodies in kept.conflicts.items()
            for body in bodies
        )

    def _check_journal(self):
        """The journal has what the database has, each record once."""
        lines = list(self.world.experiment.journal.lines())
        there = Counter(
            (line["session"], line["seq"], line["body"]["rt"], line.get("aside", False))
            for line in lines
            if "seq" in line
        )
        assert there == Counter(
            (kept.key, seq, body["rt"], aside)
            for kept in self.alive.values()
            for bodies, aside in ((kept.records, False), (kept.conflicts, True))
            for seq, of_step in bodies.items()
            for body in (of_step if aside else [of_step])
        )
        assert {line["session"] for line in lines if "session" in line} == self.alive.keys()

    def _check_tables(self, storage):
        trials = trials_table(storage, preview=True)
        columns = ["participant", "session", "entry", "state", "group", "phase", "trial", "scene",
                   "liquid", "mirrored", "response", "rt"]  # fmt: skip
        found = Counter(trials[columns].itertuples(index=False, name=None))
        assert found == Counter(
            row for kept in self.alive.values() for row in self._trial_rows(kept)
        )
        people = participants_table(storage, preview=True, identifiers=True)
        columns = ["participant", "session", "entry", "state", "group", "order", "practice_trials",
                   "test_trials", "kept_aside", "remarks", "code"]  # fmt: skip
        found = Counter(people[columns].itertuples(index=False, name=None))
        assert found == Counter(map(self._person_row, self.alive.values()))
        if "PROLIFIC_PID" in people:
            ids = dict(zip(people["session"], people["PROLIFIC_PID"], strict=True))
            for kept in self.alive.values():
                told = kept.link.get("PROLIFIC_PID")
                assert ids[kept.number] == told or (told is None and pd.isna(ids[kept.number]))

    def _who(self, kept):
        group, _ = kept.place
        return kept.participant, kept.number, kept.entry, kept.state, group + 1

    def _trial_rows(self, kept):
        # Participants aren't told which scene they see: the schedule says it.
        plan = self.world.experiment.materials.steps(*kept.place)
        assert [step.for_participant() for step in plan] == kept.steps
        for seq, body in kept.records.items():
            step = plan[seq]
            if step.kind == "judgment":
                yield (*self._who(kept), step.phase, step.trial, step.scene, step.liquid,
                       step.mirrored, body["response"], body["rt"])  # fmt: skip

    def _person_row(self, kept):
        judged = Counter(
            step["phase"]
            for step in kept.steps
            if step["kind"] == "judgment" and step["seq"] in kept.records
        )
        remarks = [body["remarks"] for body in kept.records.values() if "remarks" in body]
        aside = sum(map(len, kept.conflicts.values()))
        return (*self._who(kept), kept.place[1], judged["practice"], judged["test"], aside,
                "".join(remarks), kept.code)  # fmt: skip

    def check_nothing_is_left(self):
        """Who declined or was withdrawn is nowhere in the study's files."""
        living = {mark for kept in self.alive.values() for mark in kept.marks}
        gone = {mark for kept in self.dead.values() for mark in kept.marks} - living
        for path in self.world.files():
            content = path.read_bytes()
            left = [mark for mark in gone if mark.encode() in content]
            assert not left, f"{path.name}: {left}"


def _answer_id(body):
    """What tells one answer from all others: the walk gives each a time of its own."""
    return json.loads(body)["rt"]
