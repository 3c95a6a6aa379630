"""The experiment as a service: what happens when a participant comes, answers and ends.

It knows no HTTP; `server` speaks that.
"""

import asyncio
import json
import time
from collections import OrderedDict, deque
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pourcast.errors import StoreError
from pourcast.experiment.design.links import Visitor
from pourcast.experiment.design.plan import Stock, own_default
from pourcast.experiment.design.settings import NAME, Design, read_design, texts_of
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.records import canonical
from pourcast.experiment.storage.storage import (
    COMPLETE,
    DROPPED,
    OPEN,
    Arrival,
    Record,
    Refusal,
    Saved,
    Session,
    Storage,
)
from pourcast.files import write_text
from pourcast.progress import Report
from pourcast.study.folder import load_practice, study_scenes

T = TypeVar("T")

_HOUR = 3600.0
_LARGEST_BATCH = 256
_MOST_WAITING = 20000
_REMEMBERED = 5000

Clock = Callable[[], float]


class Experiment:
    """A study's experiment, ready to be served.

    Parameters
    ----------
    study
        The study folder.
    storage
        Where judgments are kept.
    report
        Told of the progress of making stimuli.
    clock
        Seconds since 1970.
    sessions_per_address
        How many sessions an address may open in an hour.

    Raises
    ------
    InputError
        If the study is not fit for it.
    """

    def __init__(
        self,
        study: Path,
        storage: Storage,
        report: Report | None = None,
        *,
        clock: Clock = time.time,
        sessions_per_address: int = 200,
    ) -> None:
        self.study, self.storage, self.clock = study, storage, clock
        self.stock = prepare_stock(study, storage, report)
        self.scenes, self.design = self.stock.scenes, self.stock.design
        self.texts = texts_of(study, self.design)
        self.journal = Journal.of_study(study)
        sessions = storage.sessions()
        self.stock.hand_out_of(one.plan for one in sessions if one.state == OPEN)
        self.journal.catch_up([*map(_opening, sessions), *storage.records()])
        self._visits = _Visits(sessions_per_address)
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="database")
        self._waiting: asyncio.Queue[tuple[Record, asyncio.Future[Saved]]] | None = None

    def close(self) -> None:
        """Close the database."""
        self._pool.shutdown()
        self.storage.close()

    # Participants --------------------------------------------------------------------

    async def begin(
        self, visitor: Visitor, request: str, tab: str, address: str
    ) -> tuple[Session, str]:
        """Begin a session, or go on with it; see `Storage.begin`."""
        if not self._visits.allowed(address, self.clock()):
            raise Refusal("busy")
        arrival = Arrival(request, visitor.entry, visitor.identifiers, tab, visitor.participant)

        def work() -> tuple[Session, str]:
            session, token, fresh = self.storage.begin(
                arrival,
                self.stock.plan,
                groups=len(self.design.groups),
                places=self.design.places,
                largest_gap=self.design.largest_gap,
                now=self.clock(),
            )
            if fresh:
                self.journal.append([_opening(session)])
            return session, token

        return await self._call(work)

    async def session_of(self, token: str) -> Session | None:
        """Session of a token; as it was when it was first asked for."""
        if token not in self._sessions:
            found = await self._call(lambda: self.storage.session_of(token))
            if found is None:
                return None
            self._sessions[token] = found
            if len(self._sessions) > _REMEMBERED:
                self._sessions.popitem(last=False)
        return self._sessions[token]

    async def resume(self, token: str, tab: str | None) -> Session:
        """Look a session up, and give it to a tab if there is one.

        Raises
        ------
        Refusal
            If the session is none (`gone`), or was left for too long (`late`).
        """

        def work() -> Session | None:
            now = self.clock()
            self.storage.drop_stale(self.design.largest_gap, now)
            session = self.storage.session_of(token)
            if tab is not None and session is not None and session.state == OPEN:
                self.storage.claim(session.number, tab, now)
            return session

        session = await self._call(work)
        if session is None:
            raise Refusal("gone")
        if session.state == DROPPED:
            raise Refusal("late")
        return session

    async def done(self, session: Session) -> list[int]:
        """Numbers of the steps that are saved."""
        return await self._call(lambda: self.storage.done(session.number))

    async def save(self, session: Session, seq: int, content: Any, tab: str) -> Saved:
        """Save a record; it is on the disk when this returns.

        Raises
        ------
        pydantic.ValidationError
            If it isn't what the step's record says.
        IndexError
            If there is no such step.
        StoreError
            If it could not be saved.
        """
        if not 0 <= seq < len(session.plan):
            raise IndexError(seq)
        kind = session.plan[seq].kind
        record = Record(session.number, seq, kind, canonical(kind, content), self.clock(), tab)
        if self._waiting is None or self._waiting.qsize() >= _MOST_WAITING:
            raise StoreError("too much is waiting to be saved")
        saved: asyncio.Future[Saved] = asyncio.get_running_loop().create_future()
        self._waiting.put_nowait((record, saved))
        return await saved

    async def finish(self, session: Session, state: str) -> list[int]:
        """End a session; returns the steps of which there is no record yet.

        Those who declined are deleted.
        """

        def work() -> list[int]:
            if state == "declined":
                self.storage.delete([session.number], vacuum=False)
                self.journal.remove(lambda line: line["session"] == session.number)
                return []
            if state == COMPLETE:
                done = set(self.storage.done(session.number))
                missing = [step.seq for step in session.plan if step.seq not in done]
                if missing:
                    return missing
            self.storage.end(session.number, state)
            return []

        return await self._call(work)

    # Saving --------------------------------------------------------------------------

    async def keep_saving(self) -> None:
        """Save what comes, all that waits in one transaction; runs as long as the server."""
        self._waiting = asyncio.Queue()
        while True:
            batch = [await self._waiting.get()]
            while not self._waiting.empty() and len(batch) < _LARGEST_BATCH:
                batch.append(self._waiting.get_nowait())
            try:
                results = await self._call(partial(self._save, [record for record, _ in batch]))
            except Exception as error:
                for _, saved in batch:
                    if not saved.done():
                        saved.set_exception(error)
                continue
            for (_, saved), result in zip(batch, results, strict=True):
                if not saved.done():
                    saved.set_result(result)

    def _save(self, records: list[Record]) -> list[Saved]:
        results = self.storage.save(records)
        self.journal.append(
            [r for r, saved in zip(records, results, strict=True) if saved.result == "new"]
        )
        return results

    def _call(self, work: Callable[[], T]) -> Awaitable[T]:
        """Do something with the database: one thing after another, off the event loop."""
        return asyncio.get_running_loop().run_in_executor(self._pool, work)


class _Visits:
    """How often each address opened a session in the last hour."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._times: OrderedDict[str, deque[float]] = OrderedDict()

    def allowed(self, address: str, now: float) -> bool:
        times = self._times.setdefault(address, deque(maxlen=self._most))
        self._times.move_to_end(address)
        if len(self._times) > _REMEMBERED:
            self._times.popitem(last=False)
        if len(times) == self._most and 0.0 <= now - times[0] < _HOUR:
            return False
        times.append(now)
        return True


def prepare_stock(study: Path, storage: Storage, report: Report | None = None) -> Stock:
    """A study's scenes and stimuli, as its design asks for them; what is missing is made.

    Raises
    ------
    InputError
        If the study is not fit for it.
    """
    stock = Stock(
        study, study_scenes(study), load_practice(study), prepare_design(study), storage.secret
    )
    stock.prepare(report)
    return stock


def prepare_design(study: Path) -> Design:
    """A study's design; the paper's is written for a study that has none."""
    if not (study / NAME).is_file():
        write_text(study / NAME, own_default(study))
    return read_design(study)


def _opening(session: Session) -> Record:
    """First line of a session in the journal: who it is, should the database be lost."""
    body = {
        "participant": session.participant,
        "entry": session.entry,
        "group": session.group,
        "place": session.place,
        "identifiers": dict(session.identifiers),
    }
    return Record(session.number, -1, "session", json.dumps(body), session.started)
