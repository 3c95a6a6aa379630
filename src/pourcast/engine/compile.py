"""The one place that owns compiler options.

Kernels are compiled where they run. Shipped in wheels they would need one for each system, kind of
processor, Python and Numba (whose cache is bound to all four, and to the folder), and would be made
for the least of a kind of processor.
"""

import functools
import gc
import hashlib
import pickle
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.serialize import dumps

from pourcast.engine.cache_folder import cache_folder
from pourcast.progress import meanwhile

F = TypeVar("F", bound=Callable[..., Any])


class _CodeForCallers(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel that other kernels call: machine code is made of it only within theirs.

    Numba makes machine code of every function by itself, and once more where it is called. The
    first is a third of the time that compiling takes, and nobody runs it.
    """

    def finalize(self) -> None:
        """Take in what the kernel calls, and leave the rest to the callers."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Nothing can be called: there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """What Numba gives a function's environment to, which is Python's side of it: not here."""
        return SimpleNamespace(set_env=lambda _name, _environment: None)


class _CompilerForCallers(Compiler):  # type: ignore[misc]
    """Numba's compiler, into `_CodeForCallers`."""

    def __init__(self, typingctx: Any, targetctx: Any, library: Any, *rest: Any) -> None:
        library = _CodeForCallers(targetctx.codegen(), "code for callers")
        super().__init__(typingctx, targetctx, library, *rest)


class _CompilerForPython(Compiler):  # type: ignore[misc]
    """Numba's compiler without the search for garbage: a seventh of the time, and next to none."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function and what it calls."""
        was_on = gc.isenabled()
        gc.disable()
        try:
            with meanwhile("compiling, the first time on this machine"):
                return super().compile_extra(func)
        finally:
            if was_on:
                gc.enable()


class _CheckedCode(CompileResultCacheImpl):  # type: ignore[misc]
    """What is kept of a compiled kernel, with a digest: LLVM ends the process on damaged code."""

    def reduce(self, data: Any) -> Any:
        """What is written of a kernel."""
        content = dumps(super().reduce(data))
        return hashlib.sha256(content).digest(), content

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """A kernel of what was read; raises `ValueError` if that isn't what was written."""
        digest, content = payload
        if hashlib.sha256(content).digest() != digest:
            raise ValueError("damaged")
        return super().rebuild(target_context, pickle.loads(content))


class _KernelCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache on disk, in which what is damaged or can't be written costs time only."""

    _impl_class = _CheckedCode

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """A kernel; None if it must be compiled."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever a damaged pickle can raise
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel, if that can be written."""
        with suppress(OSError):
            try:
                super().save_overload(sig, data)
            except (EOFError, pickle.UnpicklingError, ValueError, TypeError):
                self.flush()  # the index is damaged
                super().save_overload(sig, data)


class Kernel:
    """A function that is compiled when it is first called.

    Called from Python, it is made machine code with all kernels that it calls, which is kept on
    disk; from another kernel, it becomes a part of that one.
    """

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        functools.update_wrapper(self, function)
        options |= {"nogil": True, "no_cfunc_wrapper": True}
        compiled = functools.partial(numba.njit, error_model="numpy", **options)
        self.for_python = compiled(pipeline_class=_CompilerForPython)(function)
        """Numba's dispatcher of what Python calls: shows types, LLVM's code and assembly."""
        # Always inlined: a call would hand on all fields of all arrays by the stack.
        self._for_kernels = compiled(
            pipeline_class=_CompilerForCallers, no_cpython_wrapper=True, forceinline=True
        )(function)
        users_dir, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(cache_folder())
        try:
            self.for_python._cache = _KernelCache(function)
        finally:
            numba.config.CACHE_DIR = users_dir

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call the kernel from Python."""
        return self.for_python(*arguments, **named)

    @property
    def _numba_type_(self) -> Any:
        """What Numba takes the kernel for where another one calls it."""
        return self._for_kernels._numba_type_


def kernel(function: F) -> F:
    """Compile a function to machine code, cached on disk, without the GIL.

    No `fastmath`: every sum is taken in the order in which it is written, so
    that a simulation has the same bits alone and in any batch. No reference
    counts either (`_nrt`): they are atomic operations on every array that is
    handed on, and cost more than the arithmetic of a contact. Hence a kernel
    can't make arrays; what does is an `allocating_kernel`.

    Parameters
    ----------
    function
        A function in Numba's subset of Python.

    Returns
    -------
    callable
        The compiled function, called like the original one.
    """
    return _compiled(function, _nrt=False)


def allocating_kernel(function: F) -> F:
    """Compile a function like `kernel`, but let it make arrays."""
    return _compiled(function)


def _compiled(function: F, **options: bool) -> F:
    return function if numba.config.DISABLE_JIT else Kernel(function, **options)  # type: ignore[return-value]
