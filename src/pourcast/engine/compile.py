"""The one place that owns compiler options and the cache of compiled kernels."""

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])


def digest_of_sources(paths: Iterable[Path]) -> str:
    """Short name of a state of source files."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


@cache
def kernel_cache_dir() -> Path:
    """Folder of compiled kernels, named by a hash of every kernel source.

    Numba notices an edit of the file that defines a function, but not of the
    functions that it calls in other files. A folder per state of the sources
    rules stale machine code out. `NUMBA_CACHE_DIR` is honoured as the parent;
    where no cache folder can be written, a private temporary one serves.
    """
    package = Path(__file__).parents[1]
    kernels = ("engine/*.py", "models/*.py", "stimuli/lattice_boltzmann/*.py")
    digest = digest_of_sources(path for pattern in kernels for path in package.glob(pattern))
    parent = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("pourcast")
    folder = Path(parent) / f"kernels-{digest}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    return folder if writable else Path(tempfile.mkdtemp(prefix="pourcast-kernels-"))


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
    dispatcher = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if not numba.config.DISABLE_JIT:
        users_dir, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(kernel_cache_dir())
        try:
            dispatcher.enable_caching()
        finally:
            numba.config.CACHE_DIR = users_dir
    return dispatcher  # type: ignore[no-any-return]
