"""Ctrl-C ends a command within a second, whatever it is at, and in one line.

Python raises `KeyboardInterrupt` in the main thread as soon as that runs Python's own code again:
not while it compiles a kernel, or waits for threads that do. So a thread watches, and ends the
process if it hasn't ended by itself. Nothing is lost by that: files are there as a whole or not
at all, and worker processes follow their parent.
"""

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

INTERRUPTED = 128 + signal.SIGINT
"""Exit code of a command that was interrupted."""

PATIENCE = 0.6
"""A command has so long to end by itself [s]."""


class _Watch:
    """What watches for Ctrl-C in a process, of which there is one, as of its signals."""

    def __init__(self) -> None:
        self.words = "interrupted"
        self._asked = False

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Interrupt the main thread, but not what it does to end."""
        if not self._asked:
            self._asked = True
            raise KeyboardInterrupt

    def follow(self, signals: socket.socket, sender: socket.socket) -> None:
        """End the process soon after a signal that is ours, and at once after a second one."""
        while not self._is_ours(signals.recv(1)):
            pass
        signals.settimeout(PATIENCE)
        with suppress(TimeoutError):
            signals.recv(1)
        # Not by way of `sys.stderr`: the main thread may hold its lock.
        clear = "\r\x1b[K\x1b[?25h" if os.isatty(2) else ""
        with suppress(OSError):
            os.write(2, f"{clear}pourcast: {self.words}\n".encode())
        os._exit(INTERRUPTED)

    def _is_ours(self, received: bytes) -> bool:
        return signal.getsignal(received[0]) == self.handle


_watch = _Watch()


def watch_for_interruptions() -> None:
    """Let Ctrl-C end this process within a second; called once, from the main thread.

    Who has another handler of SIGINT, such as the experiment's server, ends in their own time.
    """
    signals, sender = socket.socketpair()
    sender.setblocking(False)
    signal.set_wakeup_fd(sender.fileno(), warn_on_full_buffer=False)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _watch.handle)
    sys.unraisablehook = _ignore_interruptions
    threading.Thread(target=_watch.follow, args=(signals, sender), daemon=True).start()


def _ignore_interruptions(problem: "sys.UnraisableHookArgs") -> Any:
    # Raised where Python can't pass it on, such as in a callback of the compiler.
    if not isinstance(problem.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(problem)


@contextmanager
def said_if_interrupted(words: str) -> Iterator[None]:
    """What is said if the process must be ended while it is at something."""
    before, _watch.words = _watch.words, words
    try:
        yield
    finally:
        _watch.words = before


def end_in_own_time() -> None:
    """From now on Ctrl-C waits until all is cleaned up, such as jobs in a cluster's queue."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def end_interrupted() -> NoReturn:
    """End a process that has said that it was interrupted.

    At once: Python would wait for threads, and end by the signal if it came at a bad moment.
    """
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(INTERRUPTED)
