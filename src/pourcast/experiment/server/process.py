"""The server as a process: it has a study to itself, listens at an address, and is ended."""

import asyncio
import signal
import socket
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import uvicorn
from filelock import FileLock, Timeout
from starlette.applications import Starlette
from starlette.types import ASGIApp, Receive, Scope, Send

from pourcast.errors import InputError, StoreError
from pourcast.experiment.design.links import participant_links
from pourcast.experiment.server.addresses import NO_PROXIES, ForwardedAddress, Proxies
from pourcast.experiment.server.admin import admin_routes
from pourcast.experiment.server.app import create_app
from pourcast.experiment.server.connections import (
    ENDING_SECONDS,
    LimitedConnection,
    most_connections,
    raise_file_limit,
)
from pourcast.experiment.server.live_experiment import LiveExperiment
from pourcast.experiment.storage.storage import Storage
from pourcast.files import PRIVATE, keep_private
from pourcast.progress import Report, no_report

LOCK = "experiment.lock"

_LARGEST_BACKLOG = 2048

_LONGEST_END = int(2 * ENDING_SECONDS) + 1
"""After so long what is not answered is broken off, when the server ends [s]."""


@dataclass(frozen=True)
class Address:
    """Where the experiment is served.

    Parameters
    ----------
    host, port
        What the server listens to; port 0 takes any free one.
    public_url
        How participants reach it, if there is another server before it.
    proxies
        Such servers, that are believed who the participants are.
    """

    host: str = "127.0.0.1"
    port: int = 8000
    public_url: str = ""
    proxies: Proxies = NO_PROXIES

    def __post_init__(self) -> None:
        if self.public_url and not self.public_url.startswith(("http://", "https://")):
            raise InputError(f"public-url: expected http:// or https://, found {self.public_url}")
        if self.proxies.hops and not self.proxies.networks and not self._is_here:
            raise InputError(
                f"host: at {self.host} anybody can come past your web server; say where it is by "
                "--trusted-proxy, or listen to this machine alone (127.0.0.1)"
            )

    @property
    def _is_here(self) -> bool:
        return self.host in ("127.0.0.1", "::1", "localhost")

    @property
    def is_public(self) -> bool:
        """Whether others than this machine can reach it."""
        return bool(self.public_url) or not self._is_here

    def base(self, port: int) -> str:
        """URL that links begin with."""
        if self.public_url:
            return self.public_url.rstrip("/")
        anywhere = self.host in ("0.0.0.0", "::")
        name = socket.gethostname() if anywhere else self.host
        return f"http://{f'[{name}]' if ':' in name else name}:{port}"


class ExperimentServer:
    """A study's experiment, made ready to be served; nobody else serves it until it is closed.

    Parameters
    ----------
    study
        The study folder.
    storage
        Where judgments are kept; closed with the server.
    address
        Where it will be served.
    admin
        Whether there is an admin page; None: only if others can't reach the address.
    sessions_per_address
        How many sessions an address may open in an hour.
    allowed_ids
        Ids of a recruiting platform that may take part; None: all.
    report
        Told of the progress of making stimuli.

    Raises
    ------
    InputError
        If the study is not fit for it, or the page has not been built.
    StoreError
        If another server has the study, or database or journal can't be read.
    """

    def __init__(
        self,
        study: Path,
        storage: Storage,
        address: Address,
        *,
        admin: bool | None = None,
        sessions_per_address: int = 200,
        allowed_ids: Set[str] | None = None,
        report: Report = no_report,
    ) -> None:
        self.address = address
        self.has_admin = not address.is_public if admin is None else admin
        with ExitStack() as resources:
            lock = lock_study(study)
            resources.callback(lock.release)
            self.experiment = LiveExperiment(
                study,
                storage,
                report,
                sessions_per_address=sessions_per_address,
                allowed_ids=allowed_ids,
            )
            resources.callback(self.experiment.close)
            routes = admin_routes(self.experiment) if self.has_admin else ()
            self.app = create_app(self.experiment, extra=routes)
            self._resources = resources.pop_all()

    def close(self) -> None:
        """Close the database, and let others serve the study."""
        self._resources.close()

    def links(self, base: str) -> dict[str, str]:
        """The links to give away, and that of the admin page if there is one, by name."""
        storage = self.experiment.storage
        links = participant_links(base, storage.secret)
        if self.has_admin:
            links["admin"] = f"{base}/admin?token={storage.admin_token}"
        return links

    def run(self, ready: Callable[[Mapping[str, str]], None]) -> None:
        """Serve until Ctrl-C or a signal ends it.

        Parameters
        ----------
        ready
            Called with the links, by name, before the first request.

        Raises
        ------
        StoreError
            If the port is taken.
        """
        serve(self.app, self.address, lambda base: ready(self.links(base)))


def lock_study(study: Path) -> FileLock:
    """The right to serve a study; one server has it at a time.

    Raises
    ------
    StoreError
        If another one serves it.
    """
    keep_private(study / LOCK)
    lock = FileLock(study / LOCK, mode=PRIVATE)
    try:
        lock.acquire(blocking=False)
    except Timeout:
        raise StoreError(f"{study}: is being served already; end that server first") from None
    except OSError as error:
        raise StoreError(f"{study}: cannot be written ({error.strerror or error})") from None
    return lock


def serve(app: Starlette, address: Address, ready: Callable[[str], None]) -> None:
    """Serve an application until Ctrl-C or a signal ends it.

    Parameters
    ----------
    app
        The application.
    address
        Where.
    ready
        Called with the URL that links begin with, before the first request.

    Raises
    ------
    StoreError
        If the port is taken.
    """
    raise_file_limit()
    backlog = min(_LARGEST_BACKLOG, most_connections() // 4)
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    with socket.socket(family) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address.host, address.port))
            # Whoever comes before the server is ready waits, and is not turned away.
            listener.listen(backlog)
        except OSError as error:
            raise StoreError(
                f"{address.host}:{address.port}: {error.strerror}; choose another with --port"
            ) from None
        server = web_server(app, address.proxies, backlog)
        with _ended_by_signals(server):
            ready(address.base(listener.getsockname()[1]))
            server.run(sockets=[listener])


def web_server(app: ASGIApp, proxies: Proxies, backlog: int) -> uvicorn.Server:
    """A server of an application that leaves signals alone; its connections have time limits.

    Parameters
    ----------
    app
        The application.
    proxies
        Who is believed where requests come from.
    backlog
        How many connections wait to be taken. All of them can be taken at once, before any that is
        too much is closed: there must be files for them.
    """
    config = uvicorn.Config(
        _EndsQuietly(ForwardedAddress(app, proxies)),
        http=LimitedConnection,
        ws="none",
        backlog=backlog,
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=_LONGEST_END,
        # Longer than a trial: a connection serves a whole session.
        timeout_keep_alive=75,
    )
    return _Server(config)


class _EndsQuietly:
    """Middleware: what is broken off when the server ends is no error."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or be cancelled without a word: the connection is gone by then."""
        with suppress(asyncio.CancelledError):
            await self.app(scope, receive, send)


class _Server(uvicorn.Server):
    """uvicorn's server, which leaves signals to us.

    By itself it raises them again when it has ended, and takes a second one for leave to break off.
    """

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Leave signals alone."""
        yield


@contextmanager
def _ended_by_signals(server: uvicorn.Server) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end a server, which takes seconds; more of them change nothing."""

    def end(_number: int, _frame: FrameType | None) -> None:
        server.should_exit = True

    before = {one: signal.signal(one, end) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
