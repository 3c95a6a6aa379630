"""An experiment that runs: what happens when a participant comes, answers and ends.

It knows no HTTP; `app` speaks that. The database has one worker, off the event loop: one thing
happens after another.
"""

import asyncio
import contextlib
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pourcast.errors import StoreError
from pourcast.experiment.design.links import Visitor
from pourcast.experiment.design.materials import prepare_materials
from pourcast.experiment.design.settings import texts_of
from pourcast.experiment.storage.failures import LOGGER, Failures
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.record_bodies import canonical
from pourcast.experiment.storage.record_lines import (
    Line,
    opening_line,
    record_line,
    state_line,
    tab_line,
    token_line,
)
from pourcast.experiment.storage.records import Record, SaveResult
from pourcast.experiment.storage.sessions import (
    COMPLETE,
    DROPPED,
    OPEN,
    Arrival,
    Refusal,
    Session,
    token_digest,
)
from pourcast.experiment.storage.storage import Storage
from pourcast.progress import Report, no_report

T = TypeVar("T")

_HOUR = 3600.0
_LARGEST_BATCH = 256
_MOST_WAITING = 20000
_REMEMBERED = 5000

_JOURNAL_RETRY = 10.0
"""After so long what the journal could not take is tried again [s]."""

Clock = Callable[[], float]


class NoSuchStepError(LookupError):
    """A session has no step of this number."""


class LiveExperiment:
    """A study's experiment, ready for participants.

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
    journal_retry
        After so long what the journal could not take is tried again [s].

    Raises
    ------
    InputError
        If the study is not fit for it.
    StoreError
        If database or journal can't be read.
    """

    def __init__(
        self,
        study: Path,
        storage: Storage,
        report: Report = no_report,
        *,
        clock: Clock = time.time,
        sessions_per_address: int = 200,
        journal_retry: float = _JOURNAL_RETRY,
    ) -> None:
        self.study, self.storage, self.clock = study, storage, clock
        self.materials = prepare_materials(study, storage.secret, report)
        self.scenes, self.design = self.materials.scenes, self.materials.design
        self.texts = texts_of(study, self.design)
        self.journal = Journal.of_study(study)
        self.storage_failures = Failures("participants' browsers try again until it works")
        self.materials.publish_for(
            session.steps for session in storage.sessions() if session.state == OPEN
        )
        self.journal.catch_up(storage.journal_lines())
        self._visits = _Visits(sessions_per_address)
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="database")
        self._journal_retry = journal_retry
        self._waiting: asyncio.Queue[_Waiting] | None = None

    @property
    def failures(self) -> list[str]:
        """What goes wrong at the moment, a line each."""
        failures = (self.storage_failures.current, self.journal.failures.current)
        return [failure for failure in failures if failure]

    def close(self) -> None:
        """Close the database; what the journal could not take is tried once more."""
        self._pool.shutdown()
        with contextlib.suppress(StoreError):  # said below: all of it still waits
            self._forget_deleted_sessions()
            self.journal.retry()
        if self.journal.waiting:
            LOGGER.error(
                "%s: %s records are in the database alone; the next start appends them",
                self.journal.path,
                self.journal.waiting,
            )
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
            self._forget_deleted_sessions()
            session, token, is_new = self.storage.begin(
                arrival,
                self.materials.steps,
                groups=len(self.design.groups),
                places=self.design.places,
                largest_gap=self.design.largest_gap,
                now=self.clock(),
            )
            digest = token_digest(token)
            if is_new:
                self._note([opening_line(session, [digest])])
            else:
                self._note([token_line(session.key, digest), tab_line(session.key, tab)])
            return session, token

        return await self._call(work)

    async def session_of(self, token: str) -> Session | None:
        """Session of a token; as it was when it was first asked for."""
        if token not in self._sessions:
            session = await self._call(lambda: self.storage.session_of(token))
            if session is None:
                return None
            self._sessions[token] = session
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
                self._note([tab_line(session.key, tab)])
            return session

        session = await self._call(work)
        if session is None:
            raise Refusal("gone")
        if session.state == DROPPED:
            raise Refusal("late")
        return session

    async def saved_steps(self, session: Session) -> list[int]:
        """Numbers of the steps that are saved."""
        return await self._call(lambda: self.storage.saved_steps(session.number))

    async def save(self, session: Session, seq: int, content: Any, tab: str) -> SaveResult:
        """Save a record; the database has it on the disk when this returns.

        Raises
        ------
        pydantic.ValidationError
            If it isn't what the step's record says.
        NoSuchStepError
            If there is no such step.
        StoreError
            If it could not be saved.
        """
        if not 0 <= seq < len(session.steps):
            raise NoSuchStepError(seq)
        kind = session.steps[seq].kind
        record = Record(session.number, seq, kind, canonical(kind, content), self.clock(), tab)
        if self._waiting is None or self._waiting.qsize() >= _MOST_WAITING:
            self.storage_failures.add("too much is waiting to be saved")
            raise StoreError("too much is waiting to be saved")
        saved: asyncio.Future[SaveResult] = asyncio.get_running_loop().create_future()
        self._waiting.put_nowait(_Waiting(session, record, saved))
        return await saved

    async def finish(self, session: Session, state: str) -> list[int]:
        """End a session; returns the steps of which there is no record yet.

        Those who declined are deleted.

        Raises
        ------
        StoreError
            If it could not be done.
        """

        def work() -> list[int]:
            if state == "declined":
                # The database last: it tells who they are, should this fail and be tried again.
                self.journal.remove([session.key])
                self.storage.delete([session.number], vacuum=False)
                return []
            if state == COMPLETE:
                saved = set(self.storage.saved_steps(session.number))
                missing = [step.seq for step in session.steps if step.seq not in saved]
                if missing:
                    return missing
            self.storage.end(session.number, state)
            self._note([state_line(session.key, state)])
            return []

        missing = await self._call(work)
        if state == "declined":
            for token in [t for t, one in self._sessions.items() if one.number == session.number]:
                del self._sessions[token]
        return missing

    # Saving --------------------------------------------------------------------------

    async def keep_saving(self) -> None:
        """Save what comes, and what the journal could not take; runs as long as the server."""
        waiting = self._waiting = asyncio.Queue()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._save_batches(waiting))
                tasks.create_task(self._retry_journal())
        except Exception:
            LOGGER.exception("records are not saved any more; start the server again")
            raise
        finally:
            self._waiting = None

    async def _save_batches(self, waiting: "asyncio.Queue[_Waiting]") -> None:
        """Save all that waits in one transaction, again and again."""
        while True:
            batch = [await waiting.get()]
            while not waiting.empty() and len(batch) < _LARGEST_BATCH:
                batch.append(waiting.get_nowait())
            try:
                results = await self._call(partial(self._save, batch))
            except Exception as error:
                listeners = [one.saved for one in batch if not one.saved.done()]
                for saved in listeners:
                    saved.set_exception(error)
                if not listeners:
                    LOGGER.exception("%s records were not saved; nobody waits for them", len(batch))
                continue
            for one, result in zip(batch, results, strict=True):
                if not one.saved.done():
                    one.saved.set_result(result)

    def _save(self, batch: "list[_Waiting]") -> list[SaveResult]:
        self._forget_deleted_sessions()
        results = self.storage.save([one.record for one in batch])
        self._note(
            record_line(one.session, one.record, aside=result.status == "conflict")
            for one, result in zip(batch, results, strict=True)
            if result.kept
        )
        return results

    def _note(self, lines: Iterable[Line]) -> None:
        """Write to the journal; one that is new, or was deleted, gets all that the database has."""
        if self.journal.waiting or self.journal.is_begun:
            self.journal.append(lines)
        else:
            self.journal.catch_up(self.storage.journal_lines())

    async def _retry_journal(self) -> None:
        """Try again what the journal could not take, should no more records come."""

        def work() -> None:
            self._forget_deleted_sessions()
            self.journal.retry()

        while True:
            await asyncio.sleep(self._journal_retry)
            if self.journal.waiting:
                with contextlib.suppress(StoreError):  # counted by `_call`; tried again
                    await self._call(work)

    def _forget_deleted_sessions(self) -> None:
        """Keep out of the journal who withdrew while it could not be written."""
        if self.journal.waiting:
            self.journal.keep_waiting_of(self.storage.session_keys())

    async def _call(self, work: Callable[[], T]) -> T:
        """Do something with the database: one thing after another, off the event loop."""

        def watched() -> T:
            try:
                result = work()
            except StoreError as error:
                self.storage_failures.add(str(error))
                raise
            self.storage_failures.end()
            return result

        return await asyncio.get_running_loop().run_in_executor(self._pool, watched)


@dataclass
class _Waiting:
    """A record that waits to be saved, and who waits for that."""

    session: Session
    record: Record
    saved: asyncio.Future[SaveResult]


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
