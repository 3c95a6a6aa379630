"""Connections that are not kept open for nothing: nobody shuts participants out by being silent.

uvicorn has a time limit for connections between two requests alone. Here are the others: for a
request's head, for its body, and for whoever does not read the answer; and when connections get
scarce, those that say nothing make room for who comes.
"""

import asyncio
import sys
import time
from contextlib import suppress
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

if sys.platform != "win32":
    import resource

HEAD_SECONDS = 15.0
"""A request's head must be there so long after its first byte, or after the connection [s]."""

BODY_SECONDS = 30.0
"""A request's body must be there so long after its head: longer than the page waits [s]."""

READING_SECONDS = 60.0
"""An answer of which so long nothing more is read is given up [s]."""

LARGEST_HEAD = 65536
"""Of a request [bytes]."""

ENDING_SECONDS = 2.0
"""When the server ends, answers under way have so long [s]."""

_MOST_CONNECTIONS = 10_000
_MOST_FILES = 65536
_OTHER_FILES = 100
"""Files open beside connections: database, journal, libraries."""


def raise_file_limit() -> None:
    """Let this process open as many files, connections among them, as the system allows."""
    if sys.platform == "win32":
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _MOST_FILES if hard == resource.RLIM_INFINITY else min(hard, _MOST_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with suppress(ValueError, OSError):  # macOS has a limit of its own below
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def most_connections() -> int:
    """How many connections are held: as many as there may be open files, with room for others."""
    if sys.platform == "win32":
        return _MOST_CONNECTIONS
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return _MOST_CONNECTIONS
    # An answer may open a file of its own, a film.
    return max(8, min(_MOST_CONNECTIONS, int(0.7 * (soft - _OTHER_FILES))))


class LimitedConnection(HttpToolsProtocol):
    """A connection with a time limit for all that its client does.

    It holds as many as `most_connections`, and of one address half of that. Who comes beyond takes
    the place of one that waits for its client: silent ones that never asked anything before
    those between two requests, the longest silent first, and those of the address that has most.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._deadline: asyncio.TimerHandle | None = None
        self._unread: asyncio.TimerHandle | None = None
        self._head = 0
        self._heard = 0.0

    @property
    def address(self) -> str:
        """Whom it comes from, or the proxy that passes it on."""
        return self.client[0] if self.client else ""

    @property
    def is_silent(self) -> bool:
        """Whether it never asked anything."""
        return self.cycle is None

    @property
    def is_waiting(self) -> bool:
        """Whether it is the client's turn, and not ours."""
        return self.cycle is None or self.cycle.response_complete or self.cycle.more_body

    # What the transport says -----------------------------------------------------------

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Make room for it, and wait for its first request."""
        super().connection_made(transport)
        self._heard = time.monotonic()  # the loop's own time goes in steps
        self._expect(HEAD_SECONDS)
        self._make_room()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget its time limits."""
        for timer in (self._deadline, self._unread):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)
        self._unset_keepalive_if_required()

    def data_received(self, data: bytes) -> None:
        """Take what came; a head that grows beyond all measure ends the connection."""
        self._heard = time.monotonic()
        if self._deadline is None and self.is_waiting:
            self._expect(HEAD_SECONDS)
        self._head += len(data)
        super().data_received(data)
        if self._head > LARGEST_HEAD:
            self.transport.abort()

    def pause_writing(self) -> None:
        """Wait for the client to read."""
        super().pause_writing()
        if self._unread is None:
            self._unread = self.loop.call_later(READING_SECONDS, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on: the client reads."""
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None
        super().resume_writing()

    # What the parser says --------------------------------------------------------------

    def on_message_begin(self) -> None:
        """Wait for the rest of the head."""
        super().on_message_begin()
        if self._deadline is None:
            self._expect(HEAD_SECONDS)

    def on_headers_complete(self) -> None:
        """Wait for the body."""
        self._expect(BODY_SECONDS)
        self._head = 0
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Take a part of the body, which is none of the next head."""
        self._head = 0
        super().on_body(body)

    def on_message_complete(self) -> None:
        """Wait no more: it is our turn."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        self._head = 0
        super().on_message_complete()

    def timeout_keep_alive_handler(self) -> None:
        """End it between two requests; what the client never read of an answer is given up."""
        self.transport.abort()

    def shutdown(self) -> None:
        """End: at once if it is the client's turn, else when the answer is given, or soon."""
        if self.is_waiting:
            self.transport.abort()
            return
        super().shutdown()
        self.loop.call_later(ENDING_SECONDS, self.transport.abort)

    # Room ------------------------------------------------------------------------------

    def _expect(self, seconds: float) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = self.loop.call_later(seconds, self.transport.abort)

    def _make_room(self) -> None:
        """End a connection that waits, if there are too many; this one if none does."""
        most = most_connections()
        if len(self.connections) <= most // 2:
            return
        held: dict[str, list[LimitedConnection]] = {}
        for one in self.connections:
            assert isinstance(one, LimitedConnection)
            held.setdefault(one.address, []).append(one)
        if len(held[self.address]) > most // 2:
            crowd = held[self.address]
        elif len(self.connections) > most:
            crowd = max(held.values(), key=len)
        else:
            return
        waiting = [one for one in crowd if one.is_waiting and one is not self]
        ended = min(waiting, key=lambda one: (not one.is_silent, one._heard), default=self)
        self.connections.discard(ended)
        ended.transport.abort()
