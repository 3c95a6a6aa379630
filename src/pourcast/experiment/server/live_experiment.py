"""An experiment that runs: what happens when a participant comes, answers and ends.

It knows no HTTP; `app` speaks that. The database has one worker, off the event loop: one thing
happens after another.
"""

import asyncio
import contextlib
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Mapping, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pourcast.errors import StoreError
from pourcast.experiment.data.record_import import restore
from pourcast.experiment.design.links import UNFILLED, Visitor, personal
from pourcast.experiment.design.materials import prepare_materials
from pourcast.experiment.design.settings import texts_of
from pourcast.experiment.server.clock import Clock, RunningClock
from pourcast.experiment.storage.database_file import TakenAwayError
from pourcast.experiment.storage.endings import Ending
from pourcast.experiment.storage.failures import LOGGER, Failures
from pourcast.experiment.storage.journal import Journal, journal_words
from pourcast.experiment.storage.record_bodies import canonical
from pourcast.experiment.storage.record_lines import (
    Line,
    browser_line,
    opening_line,
    record_line,
    state_line,
    tab_line,
    token_line,
)
from pourcast.experiment.storage.records import Record, SaveResult
from pourcast.experiment.storage.sessions import (
    DECLINED,
    OPEN,
    Arrival,
    Refusal,
    Session,
    token_digest,
)
from pourcast.experiment.storage.storage import Storage
from pourcast.experiment.storage.visits import REFUSED_BECAUSE
from pourcast.progress import Report, no_report

T = TypeVar("T")

_HOUR = 3600.0
_LARGEST_BATCH = 256
_MOST_WAITING = 20000
_REMEMBERED = 5000
_MOST_MESSAGES = 20

_JOURNAL_RETRY = 10.0
"""After so long what the journal could not take is tried again [s]."""

_LOOK_AFTER_FILES = 0.5
"""So often it is looked whether the database and the journal are still there [s]."""


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
        Seconds since 1970, that go on evenly; a `RunningClock` by default.
    sessions_per_address
        How many sessions an address may open in an hour.
    allowed_ids
        Ids of a recruiting platform that may take part; None: all.
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
        clock: Clock | None = None,
        sessions_per_address: int = 200,
        allowed_ids: Set[str] | None = None,
        journal_retry: float = _JOURNAL_RETRY,
    ) -> None:
        self.study, self.storage, self.clock = study, storage, clock or RunningClock()
        self.journal = Journal.of_study(study, storage.states)
        storage.take_words(journal_words(self.journal.path))
        self.materials = prepare_materials(study, storage.secret, report)
        self.scenes, self.design = self.materials.scenes, self.materials.design
        self.texts = texts_of(study, self.design)
        self._restore()
        self.storage_failures = Failures("participants' browsers try again until it works")
        self.materials.publish_for(
            session.steps for session in storage.sessions() if session.state == OPEN
        )
        # All that an earlier server's stamps tell may be of another clock.
        self.storage.wait_anew(self.clock())
        self._delete_declined()
        # What an earlier server deleted may be in the log still, if it was killed just then.
        self._log_is_clean = storage.forget_log()
        self.journal.catch_up(storage.journal_lines())
        self._journal_identity = self._identity_of_journal()
        self._states = storage.states()
        self._is_away = False
        self._visits = _Visits(sessions_per_address)
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._allowed_ids = allowed_ids
        self._told_refusals: set[str] = set()
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="database")
        self._journal_retry = journal_retry
        self._waiting: asyncio.Queue[_Waiting] | None = None

    def _restore(self) -> None:
        """Take in what the journal has and the database, which may be a new one, has not."""
        restored = restore(self.storage, self.journal, self.materials.steps, self.clock())
        if restored.opened or restored.new:
            LOGGER.warning(
                "%s: had %s sessions and %s records that the database lacked; they are restored",
                self.journal.path,
                restored.opened,
                restored.new,
            )
        # Such as that they are another study's.
        for message in restored.messages[:_MOST_MESSAGES]:
            LOGGER.warning("%s", message)
        if restored.left_out:
            LOGGER.warning(
                "%s: %s lines could not be taken in, and stay as they are; "
                "`pourcast experiment data %s --import %s` names each, and says why",
                self.journal.path,
                restored.left_out,
                self.study,
                self.journal.path,
            )

    @property
    def failures(self) -> list[str]:
        """What goes wrong at the moment, a line each."""
        failures = (self.storage_failures.current, self.journal.failures.current)
        return [failure for failure in failures if failure]

    def close(self) -> None:
        """Close the database; what the journal could not take is tried once more."""
        self._pool.shutdown()
        with contextlib.suppress(StoreError):  # said below: all of it still waits
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
        self._limit_visits(address)
        ids = personal(visitor.identifiers)
        is_platforms = visitor.entry in ("prolific", "mturk")
        if is_platforms and self._allowed_ids is not None and not ids <= self._allowed_ids:
            await self._count_refusal("unlisted")
            raise Refusal("unlisted")
        arrival = Arrival(request, visitor.entry, visitor.identifiers, tab, visitor.participant)

        def work() -> tuple[Session, str]:
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
                self._append_to_journal([opening_line(session, self.storage.name, [digest])])
            else:
                lines = [token_line(session.key, digest), tab_line(session.key, tab)]
                if (session.number, request) in self.storage.browsers():
                    lines.append(browser_line(session.key, request))
                self._append_to_journal(lines)
            self._note_states()
            return session, token

        return await self._call(work)

    async def refuse_unfilled(self, found: Mapping[str, str], address: str) -> NoReturn:
        """Refuse somebody whose link nobody filled in, and tell the researcher.

        Parameters
        ----------
        found
            What stands in the link in place of identifiers.
        address
            Of who comes.

        Raises
        ------
        Refusal
            Always.
        """
        self._limit_visits(address)
        await self._count_refusal(UNFILLED, ", ".join(f"{k}={v}" for k, v in found.items()))
        raise Refusal(UNFILLED)

    def _limit_visits(self, address: str) -> None:
        """Refuse who comes too often; that is not counted, or it would cost what it saves."""
        if not self._visits.allowed(address, self.clock()):
            self._tell_refusal(
                "busy",
                f"as more than {self._visits.most} visits came from one address within an hour; if "
                "they are your participants, see --sessions-per-address, and --behind-proxy",
            )
            raise Refusal("busy")

    async def _count_refusal(self, reason: str, found: str = "") -> None:
        """Count a refusal, and tell of the first one: without ids, which are for no log."""
        await self._call(lambda: self.storage.count_refusal(reason))
        found = f" (found {found[:100]!r})" if found else ""
        why = f"{REFUSED_BECAUSE[reason]}{found}; `pourcast experiment status` counts them"
        self._tell_refusal(reason, why)

    def _tell_refusal(self, reason: str, why: str) -> None:
        if reason not in self._told_refusals:
            self._told_refusals.add(reason)
            LOGGER.warning("a visitor was refused, %s", why)

    async def resume(self, token: str, tab: str | None) -> Session:
        """Look a session up, and give it to a tab if there is one.

        Raises
        ------
        Refusal
            If the session is none (`gone`), or was left for too long and its place is somebody
            else's (`late`).
        """

        def work() -> Session | None:
            session = self.storage.resume(
                token,
                tab,
                places=self.design.places,
                largest_gap=self.design.largest_gap,
                now=self.clock(),
            )
            if session is not None and tab is not None and session.state == OPEN:
                self._append_to_journal([tab_line(session.key, tab)])
            self._note_states()
            return session

        session = await self._call(work)
        if session is None:
            raise Refusal("gone")
        return session

    async def saved_steps(self, session: Session) -> list[int]:
        """Numbers of the steps that are saved."""
        return await self._call(lambda: self.storage.saved_steps(session.number))

    async def save(self, token: str, seq: int, content: Any, tab: str) -> SaveResult:
        """Save a record; the database has it on the disk when this returns.

        Raises
        ------
        Refusal
            If the token opens no session (`gone`).
        pydantic.ValidationError
            If it isn't what the step's record says.
        NoSuchStepError
            If there is no such step.
        StoreError
            If it could not be saved.
        """
        session = await self._remembered(token)
        if not 0 <= seq < len(session.steps):
            raise NoSuchStepError(seq)
        kind = session.steps[seq].kind
        body = canonical(kind, content)
        record = Record(session.number, seq, kind, body, self.clock(), tab, token)
        if self._waiting is None or self._waiting.qsize() >= _MOST_WAITING:
            self.storage_failures.add("too much is waiting to be saved")
            raise StoreError("too much is waiting to be saved")
        saved: asyncio.Future[SaveResult] = asyncio.get_running_loop().create_future()
        self._waiting.put_nowait(_Waiting(session, record, saved))
        result = await saved
        if result.status == "gone":
            self._sessions.pop(token, None)
            raise Refusal("gone")
        return result

    async def _remembered(self, token: str) -> Session:
        """A token's session, of which only what never changes may be relied on, such as its steps.

        A token is never another session's. Whether the session is still there only the database
        knows, when a record is saved.
        """
        session = self._sessions.get(token)
        if session is None:
            session = await self._call(lambda: self.storage.session_of(token))
            if session is None:
                raise Refusal("gone")
            self._sessions[token] = session
            if len(self._sessions) > _REMEMBERED:
                self._sessions.popitem(last=False)
        return session

    async def finish(self, token: str, state: str, tab: str) -> Ending | None:
        """End a session as a page wishes, if it can; see `finish_session`. None if there is none.

        Those who declined are deleted.

        Raises
        ------
        StoreError
            If it could not be done.
        """

        def work() -> Ending | None:
            ending = self.storage.finish(token, state, tab)
            if ending is not None and ending.session.state == DECLINED:
                self._delete_declined()
            elif ending is not None and ending.is_new:
                self._note_states()
            return ending

        return await self._call(work)

    def _delete_declined(self) -> None:
        """Delete those who declined, everywhere.

        That they did is in the database by now: whatever ends this half-way, the next start, or the
        page when it asks again, does the rest. The database last, as it tells who they are.
        """
        sessions = [one for one in self.storage.sessions() if one.state == DECLINED]
        if not sessions:
            return
        # Lines that were damaged, too, if they have a name that is this person's alone.
        names = {one.code for one in sessions}.union(*(personal(s.identifiers) for s in sessions))
        self.journal.remove({session.key for session in sessions}, names)
        self._journal_identity = self._identity_of_journal()
        self.storage.delete({session.number for session in sessions})
        self._log_is_clean = self.storage.forget_log()

    # Saving --------------------------------------------------------------------------

    async def keep_saving(self) -> None:
        """Save what comes, and what the journal could not take; runs as long as the server."""
        waiting = self._waiting = asyncio.Queue()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._save_batches(waiting))
                tasks.create_task(self._retry_journal())
                tasks.create_task(self._look_after_files())
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
        results = self.storage.save([one.record for one in batch])
        back = {
            one.session.number for one, result in zip(batch, results, strict=True) if result.dropped
        }
        for session in back:
            self.storage.reopen(session, self.design.places, self.clock())
        self._append_to_journal(
            record_line(one.session, one.record, aside=result.status == "conflict")
            for one, result in zip(batch, results, strict=True)
            if result.kept
        )
        if back:
            self._note_states()
        return results

    def _note_states(self) -> None:
        """Write to the journal what has become of sessions: ended, dropped, or open again."""
        states = self.storage.states()
        changed = {
            key: state for key, state in states.items() if state != self._states.get(key, OPEN)
        }
        self._states = states
        if changed:
            self._append_to_journal(state_line(key, state) for key, state in changed.items())

    async def _retry_journal(self) -> None:
        """Try again what the journal could not take, should no more records come."""
        while True:
            await asyncio.sleep(self._journal_retry)
            if self.journal.waiting:
                with contextlib.suppress(StoreError):  # counted by `_call`; tried again
                    await self._call(lambda: self._append_to_journal([]))

    async def _look_after_files(self) -> None:
        """Notice what becomes of the database and the journal, should no records come."""
        while True:
            await asyncio.sleep(_LOOK_AFTER_FILES)
            with contextlib.suppress(StoreError):  # noted; looked at again
                await asyncio.get_running_loop().run_in_executor(self._pool, self._look)

    def _look(self) -> None:
        try:
            self.storage.check()
        except StoreError as error:
            if not self._is_away:
                self.storage_failures.add(str(error))
            self._is_away = True
            raise
        if self._is_away:
            self._is_away = False
            # It may have taken records that nobody was told of, nor the journal.
            self.journal.catch_up(self.storage.journal_lines())
            self._journal_identity = self._identity_of_journal()
            self.storage_failures.end()
        self._look_after_journal()
        if not self._log_is_clean:
            self._log_is_clean = self.storage.forget_log()

    def _append_to_journal(self, lines: Iterable[Line]) -> None:
        """Append what the database has by now; a journal that somebody took away is told of."""
        with contextlib.suppress(StoreError):  # can't be read: appending fails, too, and is told of
            if not self._look_after_journal():
                lines = self.journal.missing(lines)
        self.journal.append(lines)
        self._journal_identity = self._identity_of_journal()

    def _look_after_journal(self) -> bool:
        """Write the journal anew from the database if it was taken away; whether it was there."""
        found, before = self._identity_of_journal(), self._journal_identity
        if found == before and self.journal.waiting:
            return True  # it could not be made yet
        # The system gives the number of a file that was deleted to the next one.
        if found and before and found[0] == before[0] and found[1] >= before[1]:
            return True
        self.journal.keep_waiting_of(())  # all of it is in the database
        missing = self.journal.catch_up(self.storage.journal_lines())
        self._journal_identity = self._identity_of_journal()
        if missing and before is not None:
            LOGGER.warning(
                "%s: was deleted, emptied or replaced while the study was served (a withdrawal "
                "replaces it, too); %s lines that it lacked were written again from the database",
                self.journal.path,
                missing,
            )
        return False

    def _identity_of_journal(self) -> tuple[tuple[int, int], int] | None:
        """Which file the journal is, and its size; None if there is none, or nothing in it."""
        try:
            found = self.journal.path.stat()
        except OSError:
            return None
        return ((found.st_dev, found.st_ino), found.st_size) if found.st_size else None

    async def _call(self, work: Callable[[], T]) -> T:
        """Do something with the database: one thing after another, off the event loop."""

        def watched() -> T:
            try:
                result = work()
            except StoreError as error:
                self.storage_failures.add(str(error))
                self._is_away |= isinstance(error, TakenAwayError)
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
        self.most = most
        self._times: OrderedDict[str, deque[float]] = OrderedDict()

    def allowed(self, address: str, now: float) -> bool:
        times = self._times.setdefault(address, deque(maxlen=self.most))
        self._times.move_to_end(address)
        if len(self._times) > _REMEMBERED:
            self._times.popitem(last=False)
        if len(times) == self.most and 0.0 <= now - times[0] < _HOUR:
            return False
        times.append(now)
        return True
