"""Answers from files: a participant's download, what JATOS or DataPipe kept, the study's journal.

Whatever is good in them is taken in, and what isn't is named by file and line. The same file twice
changes nothing. `storage.record_lines` says what the lines are.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from pourcast.errors import one_line
from pourcast.experiment.data.answer_files import Faults, Place, answer_files, json_values
from pourcast.experiment.data.old_journal import current_lines, is_old_line
from pourcast.experiment.design.links import link_key, marked, visitor
from pourcast.experiment.design.schedule import OWN_ORDERS
from pourcast.experiment.design.steps import Kind, Schedule, Step
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_bodies import canonical
from pourcast.experiment.storage.record_lines import (
    CHANGES,
    FORMAT,
    JOURNAL_FORMAT,
    LAST,
    SCHEMA_VERSION,
    SHOWN,
    dumps,
    is_line,
    line_names,
    names_of,
    opening_line,
)
from pourcast.experiment.storage.records import Record, SaveResult
from pourcast.experiment.storage.sessions import COMPLETE, DROPPED, OPEN, UNKNOWN, Session
from pourcast.experiment.storage.storage import Storage

_Key = Annotated[str, StringConstraints(min_length=8, max_length=100)]
_Time = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
_Value = tuple[Place, Any]

_LARGEST = 10**9
"""No number of ours is larger, and databases take those that follow."""

_Number = Annotated[int, Field(ge=0, le=_LARGEST)]

_BATCH = 1000
"""Records that are saved in one transaction, at most."""

_UNPLACED = (
    "left out: {unopened}, and none of its lines says which group and place it had; perhaps they "
    "are another study's; if they are this one's, and you know both, put "
    '{{"format":"pourcast-records","session":"{key}","group":GROUP,"place":PLACE}} '
    "(both counted from 0) into the file, and import it again"
)


class _Content(BaseModel):
    """A line; what else stands in it is another's, and left alone."""

    model_config = ConfigDict(extra="ignore")


class _Opening(_Content):
    """First line of a session; a journal's says more than a page's."""

    session: _Key
    schema_version: int = Field(default=1, le=SCHEMA_VERSION)
    database: str = ""
    entry: str = Field(default="static", max_length=20)
    identifiers: dict[str, str] = Field(default_factory=dict, max_length=20)
    group: _Number | None = None
    place: _Number | None = None
    number: _Number = 0
    request: str = ""
    participant: str = ""
    code: str = ""
    tab: str = ""
    started: _Time | None = None
    tokens: list[str] = Field(default_factory=list)
    steps: list[Step] = Field(default_factory=list)


class _Line(_Content):
    """A record."""

    session: _Key
    seq: int = Field(ge=0)
    kind: Kind | None = None
    group: _Number | None = None
    place: _Number | None = None
    phase: str = ""
    trial: int = 0
    block: int = 0
    liquid: str = ""
    scene: str = ""
    mirrored: bool = False
    body: dict[str, Any]
    received: _Time | None = None
    aside: bool = False


class _Change(_Content):
    """What became of a session: only a journal tells."""

    session: _Key
    token: str = ""
    tab: str = ""
    browser: str = ""
    state: Annotated[str, StringConstraints(pattern="^[a-z_]{0,20}$")] = ""


@dataclass(frozen=True)
class ImportSummary:
    """What became of what was read.

    Parameters
    ----------
    sessions
        Number of sessions whose records or openings were read.
    opened
        Number of those that the database had not.
    new, repeated, conflicts
        Numbers of records that were taken in, were there already, and were kept aside.
    left_out
        Number of lines that were not taken in.
    messages
        What a researcher should know, a line each, by file and line.
    """

    sessions: int
    opened: int
    new: int
    repeated: int
    conflicts: int
    left_out: int
    messages: tuple[str, ...]

    @property
    def changes(self) -> bool:
        """Whether the database has changed."""
        return bool(self.opened or self.new or self.conflicts)


def import_records(
    path: Path, storage: Storage, journal: Journal, schedule: Schedule, now: float
) -> ImportSummary:
    """Take in answers from a file, an archive or a folder of files.

    Parameters
    ----------
    path
        What a participant downloaded, what JATOS or DataPipe kept, or a journal.
    storage, journal
        Where they go; the journal may be what is read.
    schedule
        From group and place to a session's steps, of sessions that the database does not know.
    now
        Seconds since 1970.

    Raises
    ------
    InputError
        If it can't be read.
    StoreError
        If database or journal fail. What was taken in until then stays, and the same call
        goes on.
    """
    is_own = path.resolve() == journal.path.resolve()
    importer = _Importer(storage, schedule, now, is_studys=is_own)
    faults = importer.faults
    if is_own:
        summary = _take_in_journal(importer, journal, str(path), lambda values: values)
    else:
        files = answer_files(path, faults)
        values = [value for name, content in files for value in json_values(name, content, faults)]
        summary = importer.take_in(values)
        _call_ours(journal, storage, importer.adopted)
    journal.catch_up(storage.journal_lines())
    return summary


def restore(storage: Storage, journal: Journal, schedule: Schedule, now: float) -> ImportSummary:
    """Take in what a study's journal has and its database lacks, such as a new one's all.

    See `import_records`. What the journal lacks is for `Journal.catch_up`.
    """
    importer = _Importer(storage, schedule, now, is_studys=True)
    name = str(journal.path)
    return _take_in_journal(importer, journal, name, lambda values: _lacking(values, storage))


def _take_in_journal(
    importer: "_Importer",
    journal: Journal,
    name: str,
    chosen: Callable[[list[_Value]], list[_Value]],
) -> ImportSummary:
    """Take in what is chosen of the study's own journal, which is called `name` in messages."""
    # Who withdraws, or declines, meanwhile is taken out of the journal first: not before this ends.
    with journal.held():
        values = list(json_values(name, journal.read(), importer.faults))
        summary = importer.take_in(chosen(values))
        _renew_old(journal, importer.storage, values, importer.faults.lines(name))
    _call_ours(journal, importer.storage, importer.adopted)
    return summary


def _call_ours(journal: Journal, storage: Storage, sessions: Sequence[Session]) -> None:
    """Say in the journal that sessions of another database are this one's now."""
    if sessions:
        journal.append(opening_line(session, storage.name) for session in sessions)


def _lacking(values: Sequence[_Value], storage: Storage) -> list[_Value]:
    """What a database lacks of a journal; what is no line stays, too."""
    there = names_of(storage.journal_lines())
    # Of what a session once was only the last counts.
    last = names_of(content for _, content in values if is_line(content))
    return [
        (place, content)
        for place, content in values
        if not is_line(content)
        or content.get("format") == JOURNAL_FORMAT
        or (line_names(content) - there and line_names(content) <= last)
    ]


def _renew_old(
    journal: Journal, storage: Storage, values: Iterable[_Value], left_out: Collection[int]
) -> None:
    """Write a journal of an older form anew; what was left out of it stays in it as it was."""
    if not any(is_old_line(content) for _, content in values):
        return
    texts = journal.read().split(b"\n")
    kept = [text + b"\n" for number, text in enumerate(texts, 1) if number in left_out]
    lines = [dumps(line).encode("utf-8", "replace") for line in storage.journal_lines()]
    journal.rewrite(b"".join([*lines, *kept]))


@dataclass
class _Run:
    """What the files say of a session."""

    openings: list[tuple[Place, _Opening]] = field(default_factory=list)
    records: list[tuple[Place, _Line]] = field(default_factory=list)
    changes: list[_Change] = field(default_factory=list)

    @property
    def opening(self) -> _Opening | None:
        """The first line that opens it."""
        return self.openings[0][1] if self.openings else None


class _Importer:
    """Takes lines into a database.

    Parameters
    ----------
    storage, schedule, now
        As for `import_records`.
    is_studys
        Whether it is the study's own journal, even where the line that says so was lost.
    """

    def __init__(
        self, storage: Storage, schedule: Schedule, now: float, *, is_studys: bool = False
    ) -> None:
        self._is_studys = is_studys
        self.storage, self.schedule, self.now = storage, schedule, now
        self.faults = Faults()
        """What was left out."""
        self._counts: Counter[str] = Counter()
        self._is_journal = False
        """Whether a server wrote the lines: it tells more than a participant's browser can."""
        self._is_own = False
        """Whether that server had this database's secrets."""
        self._has_others = False
        """Whether a server wrote lines that had another database's."""
        self._tells_ends = False
        """Whether the lines tell how sessions ended."""
        self.adopted: list[Session] = []
        """Sessions that another database had, and this one has now."""
        self._keeps_own = False
        """Whether sessions of other databases don't belong here."""

    def take_in(self, values: Sequence[_Value]) -> ImportSummary:
        """Take in what is good of these lines."""
        is_old = any(is_old_line(content) for _, content in values)
        if is_old:
            keys = {(one.participant, one.started): one.key for one in self.storage.sessions()}
            values = list(current_lines(values, keys, self.faults))
        heads = [(place, content) for place, content in values if _is_head(content)]
        if heads:
            self.storage.take_words(heads[0][1])
        for place, head in heads:
            self._compare_words(place, head)
        is_journal = bool(heads) or (self._is_studys and not is_old)
        self._is_journal, self._tells_ends = is_journal or is_old, is_journal
        self._keeps_own = self._is_studys and (self._is_own or bool(self.storage.states()))
        runs = _runs(values, self.faults)
        for key, run in runs.items():
            self._take_in_run(key, run)
        return ImportSummary(
            sum(bool(run.openings or run.records) for run in runs.values()),
            self._counts["opened"],
            self._counts["new"],
            self._counts["repeated"],
            self._counts["conflict"],
            len(self.faults),
            tuple(self.faults.messages()),
        )

    def _compare_words(self, place: Place, head: Mapping[str, Any]) -> None:
        """See whether a first line is this database's, or another one's."""
        if head.get("secret") == self.storage.words["secret"]:
            self._is_own = True
            last = head.get(LAST)
            if isinstance(last, int) and 0 < last <= _LARGEST:
                self.storage.count_from(last)
            return
        self._has_others = True
        self.faults.add(
            place,
            "left out: the secrets of another database; links that were given away with them "
            "don't open this study",
        )

    # Sessions ------------------------------------------------------------------------

    def _take_in_run(self, key: str, run: _Run) -> None:
        # What this database says of a session goes before what an earlier one said.
        run.openings.sort(key=lambda opening: opening[1].database != self.storage.name)
        known = self.storage.session_with_key(key) or self.storage.session_of(key)
        session = known or self._opened(key, run)
        if session is None:
            return
        if known and known.entry == UNKNOWN and run.opening:
            self.storage.identify(self._identified(known, run.opening))
        for first in range(0, len(run.records), _BATCH):
            self._save(session, run.records[first : first + _BATCH])
        self._end(session, run, is_new=known is None)

    def _opened(self, key: str, run: _Run) -> Session | None:
        """A session that the database has not, put into it; None if nobody can tell its steps."""
        stranger = run.opening and self._why_not_ours(run.opening)
        if stranger:
            for place, _ in [*run.openings, *run.records]:
                self.faults.add(place, stranger)
            return None
        placed = self._placed(run)
        if placed is None:
            unopened = "its session is left out" if run.openings else "no line opens its session"
            for place, _ in run.records:
                self.faults.add(place, _UNPLACED.format(unopened=unopened, key=key))
            return None
        group, place_number, steps = placed
        opening = run.opening
        if opening is None:
            opening = _Opening(session=key, entry=UNKNOWN)
            self.faults.note(
                run.records[0][0],
                f"no line opens session {key}; it is taken in as one of group "
                f"{group + 1}, order {place_number}, with the entry {UNKNOWN!r}",
            )
        started = self.now if opening.started is None else opening.started
        session = Session(
            number=0,
            key=key,
            request="",
            participant="",
            entry=opening.entry,
            identifiers=opening.identifiers,
            group=group,
            place=place_number,
            state=OPEN,
            tab="",
            # What a page without a server shows at the end.
            code=key[:8].upper(),
            steps=tuple(steps),
            started=self.now,
            last_seen=self.now,
        )
        tokens: list[str] = []
        browsers: list[str] = []
        if self._is_journal:
            browsers = [one.browser for one in run.changes if one.browser]
            tokens = [
                *(token for _, one in run.openings for token in one.tokens),
                *(one.token for one in run.changes if one.token),
            ]
            session = replace(
                session,
                number=opening.number,
                request=opening.request,
                tab=_last([opening.tab, *(one.tab for one in run.changes)]),
                code=opening.code,
                started=started,
                last_seen=started,
            )
        self._counts["opened"] += 1
        restored = self.storage.restore(self._identified(session, opening), tokens, browsers)
        if opening.database not in ("", self.storage.name):
            self.adopted.append(restored)
        return restored

    def _why_not_ours(self, opening: _Opening) -> str:
        """Why a session that another database had is not taken in; empty if it is."""
        if opening.database in ("", self.storage.name):
            return ""
        if self._keeps_own:
            return (
                "left out: a session of another study's database; if it belongs to this study, "
                "import it from a file beside"
            )
        foreign = {step.scene for step in opening.steps if step.scene} - self._scenes
        if foreign:
            return f"left out: another study's: this one has no scene {min(foreign)!r}"
        return ""

    @cached_property
    def _scenes(self) -> set[str]:
        """Scenes of the study."""
        scenes: set[str] = set()
        for group in count():
            try:
                scenes |= {step.scene for step in self.schedule(group, 0)}
            except IndexError:
                return scenes
        return scenes

    def _identified(self, session: Session, opening: _Opening) -> Session:
        """A session with who it is, as its opening line says."""
        participant = opening.participant if self._is_journal else ""
        # A server has looked at the link before it wrote the line.
        ids = opening.identifiers if self._is_journal else marked(opening.identifiers)
        # The same person is called the same as in this database, which may have other secrets.
        secret = self.storage.secret
        # But number 1 in the laboratory is somebody else in another study.
        is_named = opening.entry == "lab" and self._is_studys and not self._has_others
        link = {"lab": link_key(secret, "lab")} if is_named else {}
        who = visitor(opening.identifiers | link, secret)
        participant = (who.participant if who else "") or participant
        return replace(
            session,
            participant=participant,
            entry=opening.entry,
            identifiers=ids,
        )

    def _placed(self, run: _Run) -> tuple[int, int, Sequence[Step]] | None:
        """Group, place and steps of a session that the database does not know."""
        said: list[_Opening | _Line] = [one for _, one in run.openings]
        said += [one for _, one in run.records]
        places = [
            (one.group, one.place)
            for one in said
            if one.group is not None and one.place is not None
        ]
        if run.opening and run.opening.steps and self._is_journal and places:
            return *places[0], run.opening.steps
        found = places[0] if places else _place_by_stimuli(run.records, self.schedule)
        if found is None:
            for place, _ in run.openings:
                self.faults.add(place, "left out: session: not one of this study's")
            return None
        try:
            steps = self.schedule(*found)
        except IndexError:
            for place, _ in run.openings:
                self.faults.add(place, f"left out: group: this study has no group {found[0]}")
            return None
        return *found, _as_shown(steps, run.records)

    def _end(self, session: Session, run: _Run, *, is_new: bool) -> None:
        """Say how a session ended: as a journal says, or complete if all of it is there.

        What has ended stays as it is.
        """
        if not self._tells_ends:
            goes_on = session.state in (OPEN, DROPPED)
            if goes_on and len(self.storage.saved_steps(session.number)) == len(session.steps):
                self.storage.end(session.number, COMPLETE)
            return
        if self._is_own:
            self.storage.add_tokens(session.number, [one.token for one in run.changes if one.token])
        state = _last(one.state for one in run.changes)
        if state not in ("", OPEN) and (is_new or (self._is_own and state != DROPPED)):
            self.storage.end(session.number, state)

    # Records -------------------------------------------------------------------------

    def _save(self, session: Session, lines: Sequence[tuple[Place, _Line]]) -> None:
        """Save a session's records, and count what becomes of them."""
        checked = []
        # What was kept aside comes after what it was in conflict with.
        for place, line in sorted(lines, key=lambda one: one[1].aside):
            record = self._checked(place, line, session)
            if record is not None:
                checked.append((place, record))
        results = self.storage.save([record for _, record in checked]) if checked else []
        for (place, record), result in zip(checked, results, strict=True):
            self._count(place, record, result)

    def _count(self, place: Place, record: Record, result: SaveResult) -> None:
        if result.status == "gone":
            self.faults.add(place, "left out: its session was deleted in the meantime")
        elif result.status != "conflict":
            self._counts[result.status] += 1
        elif result.kept:
            self._counts["conflict"] += 1
            self.faults.note(
                place, f"step {record.seq} has another answer already; this one is kept aside"
            )
        elif self._is_aside(record):
            self._counts["repeated"] += 1
        else:
            self.faults.add(place, "left out: too many other answers are kept aside under its step")

    def _is_aside(self, record: Record) -> bool:
        return any(
            (one.session, one.seq, one.body) == (record.session, record.seq, record.body)
            for one in self.storage.conflicts()
        )

    def _checked(self, place: Place, line: _Line, session: Session) -> Record | None:
        """A line's record as it is stored; None if it is none of its step."""
        if line.seq >= len(session.steps):
            self.faults.add(
                place, f"left out: seq: expected below {len(session.steps)}, found {line.seq}"
            )
            return None
        kind = session.steps[line.seq].kind
        if line.kind not in (None, kind):
            self.faults.add(
                place, f"left out: kind: step {line.seq} is {kind!r}, found {line.kind!r}"
            )
            return None
        try:
            body = canonical(kind, line.body)
        except ValidationError as error:
            self.faults.add(place, f"left out: {one_line(error)}")
            return None
        received = line.received if self._is_journal else None
        time = self.now if received is None else received
        return Record(session.number, line.seq, kind, body, time)


def _is_head(content: Any) -> bool:
    return isinstance(content, dict) and content.get("format") == JOURNAL_FORMAT


def _runs(values: Iterable[_Value], faults: Faults) -> dict[str, _Run]:
    """What there is of each session, by its key; what is no line is a fault."""
    runs: dict[str, _Run] = {}
    for place, content in values:
        if _is_head(content):
            continue
        try:
            line = _parsed(content)
        except ValidationError as error:
            faults.add(place, f"left out: {one_line(error)}")
            continue
        if line is None:
            faults.add(place, f"left out: no line of {FORMAT}")
            continue
        run = runs.setdefault(line.session, _Run())
        if isinstance(line, _Opening):
            run.openings.append((place, line))
        elif isinstance(line, _Line):
            run.records.append((place, line))
        else:
            run.changes.append(line)
    return runs


def _parsed(content: Any) -> _Opening | _Line | _Change | None:
    if not isinstance(content, dict):
        return None
    if content.get("format") == FORMAT:
        return _Opening.model_validate(content)
    if {"session", "seq"} <= content.keys():
        return _Line.model_validate(content)
    if "session" in content and content.keys() & CHANGES:
        return _Change.model_validate(content)
    return None


def _place_by_stimuli(
    records: Sequence[tuple[Place, _Line]], schedule: Schedule
) -> tuple[int, int] | None:
    """Group and place that show what these records are of, if one group alone does."""
    shown = {line.seq: line.body["stimulus"] for _, line in records if "stimulus" in line.body}
    fitting: list[tuple[int, int]] = []
    for group in count():
        for place in range(OWN_ORDERS):
            try:
                steps = schedule(group, place)
            except IndexError:
                return fitting[0] if len({one for one, _ in fitting}) == 1 else None
            if shown and _fits(shown, steps):
                fitting.append((group, place))
    raise AssertionError


def _fits(shown: Mapping[int, Any], steps: Sequence[Step]) -> bool:
    return all(
        seq < len(steps) and name and name in (steps[seq].still, steps[seq].film)
        for seq, name in shown.items()
    )


def _as_shown(steps: Sequence[Step], records: Iterable[tuple[Place, _Line]]) -> list[Step]:
    """Steps of a schedule, with what records say that was shown: the design may have changed."""
    changed = list(steps)
    for _, line in records:
        if line.seq < len(changed) and line.kind and line.scene:
            shown = {name: getattr(line, name) for name in SHOWN}
            step = changed[line.seq]
            if any(getattr(step, name) != value for name, value in shown.items()):
                changed[line.seq] = Step(seq=line.seq, kind=line.kind, **shown)
    return changed


def _last(words: Iterable[str]) -> str:
    """The last word that is not empty."""
    return next((word for word in reversed(list(words)) if word), "")
