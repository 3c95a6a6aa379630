"""Threads that share a simulation: those that help, and what they wait for one another by."""

import platform
import time
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_WORD = ir.IntType(64)
_YIELD = "SwitchToThread" if platform.system() == "Windows" else "sched_yield"
"""The system's own function, which every process has loaded."""


class Helper:
    """A thread's part in a simulation that another thread leads, frame by frame."""

    def __init__(self) -> None:
        self._frames: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._done: SimpleQueue[None] = SimpleQueue()

    def help(self) -> None:
        """Do what the leader asks for, until it lets go; called by the thread that helps."""
        while (frame := self._frames.get()) is not None:
            frame()
            self._done.put(None)

    def begin(self, frame: Callable[[], None]) -> None:
        """Ask for a frame."""
        self._frames.put(frame)

    def wait(self) -> None:
        """Wait for the end of the frame that was asked for."""
        self._done.get()

    def let_go(self) -> None:
        """End the help."""
        self._frames.put(None)


if numba.config.DISABLE_JIT:

    def add_one(counter: Any) -> None:
        """Count one more, in the first entry of an array of int64."""
        counter[0] += 1

    def read(counter: Any) -> int:
        """The first entry of an array of int64, as other threads have left it."""
        return int(counter[0])

    def yield_processor() -> None:
        """Let another thread run, if one is ready to."""
        time.sleep(0)

else:

    def _first(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return context.make_array(sig.args[0])(context, builder, args[0]).data

    @intrinsic  # type: ignore[untyped-decorator]
    def add_one(typingctx: Any, counter: Any) -> Any:
        """Count one more, in the first entry of an array of int64."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            pointer = _first(context, builder, sig, args)
            builder.atomic_rmw("add", pointer, ir.Constant(_WORD, 1), "seq_cst")
            return context.get_dummy_value()

        return types.void(counter), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def read(typingctx: Any, counter: Any) -> Any:
        """The first entry of an array of int64, as other threads have left it."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            return builder.load_atomic(_first(context, builder, sig, args), "seq_cst", 8)

        return types.int64(counter), generate

    @intrinsic  # type: ignore[untyped-decorator]
    def yield_processor(typingctx: Any) -> Any:
        """Let another thread run, if one is ready to."""

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            kind = ir.FunctionType(ir.IntType(32), [])
            known = builder.module.globals.get(_YIELD)
            builder.call(known or ir.Function(builder.module, kind, _YIELD), [])
            return context.get_dummy_value()

        return types.void(), generate
