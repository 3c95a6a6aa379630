"""The one place that owns compiler options and the cache of compiled kernels."""

import hashlib
import io
import os
import tempfile
import tokenize
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])


def digest_of_sources(paths: Iterable[Path]) -> str:
    """Short name of what source files do: comments, docstrings and blank lines don't count."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.name.encode() + code_of(path.read_text(encoding="utf-8")).encode())
    return digest.hexdigest()[:12]


def code_of(source: str) -> str:
    r"""Source code without comments, docstrings and blank lines.

    Examples
    --------
    >>> code_of('def f(x):\n    "Twice."\n    return 2 * x  # see g\n').split("\n")
    ['def f ( x ) :', '{', 'return 2 * x', '}']
    """
    code: list[str] = []
    statement: list[tokenize.TokenInfo] = []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.INDENT, tokenize.DEDENT):
            code.append("{" if token.type == tokenize.INDENT else "}")
        elif token.type == tokenize.NEWLINE:
            # What consists of strings alone is a docstring.
            if any(part.type != tokenize.STRING for part in statement):
                code.append(" ".join(part.string for part in statement))
            statement = []
        elif token.type not in (tokenize.COMMENT, tokenize.NL):
            statement.append(token)
    return "\n".join(code)


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
