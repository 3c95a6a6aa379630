"""A server within this process that is killed and started again, and clocks that are set.

A process that is killed leaves its files as they lie at that moment. Here the files are copied at
that moment; what runs comes to its end where nobody hears of it, the copies take the place of the
files, and a new server starts on them. PostgreSQL is a process of its own: it loses the connections
at that moment, and takes no others of those that were killed.
"""

import asyncio
import json
import sys
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from filelock import FileLock, Timeout

from pourcast.experiment.data.record_import import import_records
from pourcast.experiment.data.withdrawal import withdraw
from pourcast.experiment.server.app import create_app
from pourcast.experiment.server.clock import RunningClock
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.storage import Storage

AT_THE_ANSWER = "killed at the answer"
"""Killed as soon as the answer to a request is on its way."""

_TOUCHES = frozenset(
    {
        "execute", "executemany", "commit", "do_commit", "open", "write", "ftruncate", "fsync",
        "rename", "replace", "unlink", "close",
    }
)  # fmt: skip
"""Functions that touch the disk: between two calls or returns of these nothing changes there."""

_SLOW_DISK = 0.02
"""How long a commit takes at least where somebody is killed at the answer [s]."""


class Clock:
    """Clocks: the one on the wall, which is set, and the time that really passes."""

    def __init__(self) -> None:
        self.elapsed = 0.0
        self._set = 1_700_000_000.0

    def even(self) -> float:
        """Seconds since some moment, that nobody sets."""
        return self.elapsed

    def wall(self) -> float:
        """Seconds since 1970, as the machine believes."""
        return self._set + self.elapsed

    def advance(self, seconds: float) -> None:
        """Time passes."""
        self.elapsed += seconds

    def jump(self, seconds: float) -> None:
        """The clock on the wall is set."""
        self._set += seconds


@dataclass(frozen=True)
class Request:
    """What a browser sends."""

    what: str
    method: str
    path: str
    content: dict[str, Any]
    token: str = ""

    @property
    def seq(self) -> int:
        """The step that a record is of."""
        return int(self.path.rpartition("/")[2])


@dataclass
class Answer:
    """What comes back; `heard` if it was on its way before the server was killed."""

    status: int = 0
    body: bytes = b""
    heard: bool = False

    @property
    def said(self) -> dict[str, Any]:
        """The body."""
        content = json.loads(self.body)
        assert isinstance(content, dict)
        return content


class World:
    """A study that is served.

    Parameters
    ----------
    study
        The study folder.
    url
        Of a PostgreSQL database that nobody else uses; None for SQLite in the study.
    """

    def __init__(self, study, url=None):
        self.study, self.url = study, url
        self.clock = Clock()
        self.starts = 0
        self._dead = False
        self._touches_left = None
        self._meanwhile = None
        self._commits_left = 0
        self._dies_at_the_answer = False
        self.start()

    # A process -----------------------------------------------------------------------

    def start(self):
        """Start the server."""
        self.starts += 1
        self._dead = False
        threading.setprofile(self._count)  # of threads that begin from now on
        self.storage = self._opened()
        self.experiment = LiveExperiment(
            self.study,
            self.storage,
            clock=RunningClock(self.clock.wall, self.clock.even),
            sessions_per_address=10**6,
        )
        self.app = create_app(self.experiment)
        self._loop = asyncio.new_event_loop()
        self._lifespan = self.app.router.lifespan_context(self.app)
        self._loop.run_until_complete(self._lifespan.__aenter__())

    def stop(self):
        """End the server, as Ctrl-C does."""
        self._loop.run_until_complete(self._end())
        self._loop.close()
        self.experiment.close()
        threading.setprofile(None)

    async def _end(self):
        await self._lifespan.__aexit__(None, None, None)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.gather(*others, return_exceptions=True)

    @contextmanager
    def other_process(self):
        """Database and journal, as a command beside the server opens them."""
        storage = self._opened()
        try:
            yield storage, Journal.of_study(self.study, storage.states)
        finally:
            storage.close()

    def _opened(self):
        storage = Storage.of_study(self.study, self.url)

        def refuse(*_):
            if self._dead:
                raise sa.exc.OperationalError("", None, Exception("this process was killed"))

        def wait(_):
            if self._dies_at_the_answer:
                threading.Event().wait(_SLOW_DISK)

        sa.event.listen(storage.engine, "do_connect", refuse)
        sa.event.listen(storage.engine, "commit", wait)
        return storage

    # What is done with it ------------------------------------------------------------

    def ask(self, requests, kill=None, *, meanwhile=None, commit=1):
        """Send requests at the same time.

        Parameters
        ----------
        requests
            What is sent.
        meanwhile, commit
            What another process does after so many commits, before the server does anything else.
        kill
            The server is killed meanwhile, and started again: `AT_THE_ANSWER`, or when the disk
            has been touched so often. None: it isn't killed.

        Returns
        -------
        list of Answer
            In the requests' order.
        """

        async def all_of_it():
            return await asyncio.gather(*map(self._ask, requests))

        self._meanwhile, self._commits_left = meanwhile, commit
        try:
            return self._killed(lambda: self._loop.run_until_complete(all_of_it()), kill)
        finally:
            self._meanwhile = None

    def withdraw(self, who, kill=None):
        """Withdraw somebody, in another process; whether it was said that it is done."""
        with self._counted_here():
            return self._killed(lambda: self.withdraw_now(who), kill)

    def withdraw_now(self, who):
        """The work of another process, that is killed with the server if anything is."""
        with self.other_process() as (storage, journal):
            withdraw(self.study, storage, journal, who)
        return not self._dead

    def import_file(self, path, kill=None):
        """Take a file of records in, in another process; None if it was killed in it."""

        def work():
            with self.other_process() as (storage, journal):
                steps = self.experiment.materials.steps
                summary = import_records(path, storage, journal, steps, self.clock.wall())
            return None if self._dead else summary

        with self._counted_here():
            return self._killed(work, kill)

    def delete_database(self):
        """Delete the database, whoever uses it."""
        if self.url is None:
            for path in self.study.glob("responses.sqlite*"):
                path.unlink()
            return
        _cut_connections(self.url)
        engine = sa.create_engine(sa.make_url(self.url).set(drivername="postgresql+psycopg"))
        with engine.begin() as connection:
            connection.exec_driver_sql("DROP SCHEMA public CASCADE")
            connection.exec_driver_sql("CREATE SCHEMA public")
        engine.dispose()

    def kill(self):
        """Kill the server while nothing happens."""
        self._killed(lambda: None, 1)

    def _killed(self, work, kill):
        self._dies_at_the_answer = kill == AT_THE_ANSWER
        self._touches_left = kill if isinstance(kill, int) else None
        result = None
        try:
            result = work()
        except Exception:
            if not self._dead:
                raise
        finally:
            self._touches_left = None
        if kill is not None:
            self._die()
            with suppress(Exception):  # nobody hears of what the dead say
                self.stop()
            self._restore()
            self.start()
        return result

    @contextmanager
    def _counted_here(self):
        """Count in this thread, too: not while a server works for it in others."""
        profile = sys.getprofile()
        sys.setprofile(self._count)
        try:
            yield
        finally:
            sys.setprofile(profile)

    async def _ask(self, request):
        answer = Answer()
        body = json.dumps(request.content).encode()
        headers = [(b"content-type", b"application/json")]
        if request.token:
            headers.append((b"authorization", f"Bearer {request.token}".encode()))
        scope = {
            "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "scheme": "http",
            "method": request.method, "path": request.path, "raw_path": request.path.encode(),
            "query_string": b"", "root_path": "", "headers": headers,
            "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 80),
        }  # fmt: skip

        async def receive():
            return {"type": "http.request", "body": body, "more_body": False}

        async def send(message):
            if message["type"] == "http.response.start":
                answer.status = message["status"]
                answer.heard = not self._dead
                if self._dies_at_the_answer:
                    self._die()
            else:
                answer.body += message.get("body", b"")

        with suppress(Exception):  # the answer says 500 then
            await self.app(scope, receive, send)
        return answer

    # Death ---------------------------------------------------------------------------

    def _count(self, frame, event, argument):
        """Profiling function: dies when the disk has been touched often enough."""
        if self._touches_left is None and self._meanwhile is None:
            return
        name = argument.__name__ if event.startswith("c_") else frame.f_code.co_name
        if self._meanwhile is not None and (event, name) == ("return", "do_commit"):
            self._commits_left -= 1
            # Who has to wait for the server's lock comes after it.
            if self._commits_left <= 0 and not self._journal_is_locked():
                work, self._meanwhile = self._meanwhile, None
                work()
        if self._touches_left is None:
            return
        if name in _TOUCHES:
            self._touches_left -= 1
            if self._touches_left <= 0:
                self._die()

    def _journal_is_locked(self):
        lock = FileLock(self.study / "responses.lock")
        try:
            lock.acquire(blocking=False)
        except Timeout:
            return True
        lock.release()
        return False

    def _die(self):
        self._touches_left = None
        if self._dead:
            return
        self._dead = True
        if self.url is not None:
            _cut_connections(self.url)
        self._left = {p: (p.read_bytes(), p.stat().st_mode) for p in self.files()}

    def files(self):
        """The study's files that are there for people's answers, and what belongs to them."""
        stimuli = self.study / "stimuli"
        return [p for p in self.study.rglob("*") if p.is_file() and stimuli not in p.parents]

    def _restore(self):
        for path in self.files():
            path.unlink()
        for path, (content, mode) in self._left.items():
            path.write_bytes(content)
            path.chmod(mode)


def _cut_connections(url):
    """End all connections to a PostgreSQL database; what they had not committed is undone."""
    parsed = sa.make_url(url).set(drivername="postgresql+psycopg")
    engine = sa.create_engine(parsed.set(database="postgres"), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(
            sa.text(
                "SELECT pg_terminate_backend(pid, 5000) FROM pg_stat_activity WHERE datname = :name"
            ),
            {"name": parsed.database},
        ).all()
    engine.dispose()
