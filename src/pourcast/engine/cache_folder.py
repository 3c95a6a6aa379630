"""The user's cache folder: what takes long to make and is the same each time.

Compiled kernels, and arrays such as the packings that liquids start from. Whoever deletes it loses
time, and nothing else.
"""

import hashlib
import io
import os
import tempfile
import uuid
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import platformdirs
from numpy.typing import NDArray

_DIGEST_SIZE = hashlib.sha256().digest_size


@cache
def cache_folder() -> Path:
    """Folder of this state of the engine, named by a hash of the kernels' sources.

    Numba notices an edit of the file that defines a function, but not of the
    functions that it calls in other files. A folder per state of the sources
    rules stale machine code out. `NUMBA_CACHE_DIR` is honoured as the parent;
    where no cache folder can be written, a private temporary one serves.
    """
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for pattern in ("engine/*.py", "stimuli/lattice_boltzmann/*.py"):
        for path in sorted(package.glob(pattern)):
            digest.update(path.name.encode() + path.read_bytes())
    parent = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("pourcast")
    folder = Path(parent) / f"kernels-{digest.hexdigest()[:12]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    return folder if writable else Path(tempfile.mkdtemp(prefix="pourcast-kernels-"))


def kept_array(name: str, make: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
    """An array from the cache folder, or a new one, which is put there if that can be written.

    Parameters
    ----------
    name
        Says all that the array depends on, but for the engine's code.
    make
        Makes the array.

    Returns
    -------
    ndarray
        Read-only.
    """
    path = cache_folder() / f"{name}.npy"
    array = _read_array(path)
    if array is None:
        array = make()
        _write_array(path, array)
    array.setflags(write=False)
    return array


def _read_array(path: Path) -> NDArray[np.float64] | None:
    """An array of `_write_array`; None if there is none, or not all of it."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    digest, data = content[:_DIGEST_SIZE], content[_DIGEST_SIZE:]
    if hashlib.sha256(data).digest() != digest:
        return None
    array: NDArray[np.float64] = np.load(io.BytesIO(data), allow_pickle=False)
    return array


def _write_array(path: Path, array: NDArray[np.float64]) -> None:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    data = stream.getvalue()
    # Under a name of its own first: other processes may read or write it at the same time.
    own = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        own.write_bytes(hashlib.sha256(data).digest() + data)
        os.replace(own, path)
    except OSError:  # a full disk, a folder that is gone: it is made again the next time
        with suppress(OSError):
            own.unlink()
