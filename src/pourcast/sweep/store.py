"""What is done: one Parquet file a shard, in a folder that many processes share.

    sweep/shards/<2 hex digits>/<shard>-<checksum>.parquet    results
    sweep/trajectories/<shard>-<checksum>.zarr.zip            paths, on request
    sweep/grids/<name>.toml                                   what was asked
    sweep/failures/<shard>.json                               what went wrong, till it is mended
    sweep/locks/<shard>.lock                                  held by the worker on the shard

A file is written under a temporary name, synced and renamed; it carries its
checksum in its name. Done means: a file is there, and its checksum is right.
"""

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from filelock import FileLock, Timeout

from pourcast.errors import InputError, StoreError
from pourcast.files import check_writable, replacing, write_text

_CHECKSUM_DIGITS = 16
_READERS = 8
_READ_AT_ONCE = 200
_BLOCK_BYTES = 2**20
_NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)

SCHEMA = pa.schema(
    [
        pa.field("scene", pa.dictionary(pa.int32(), pa.string())),
        pa.field("setting", pa.dictionary(pa.int32(), pa.string())),
        pa.field("engine", pa.dictionary(pa.int32(), pa.string())),
        pa.field("draw", pa.int32()),
        pa.field("judgment", pa.float64()),
        pa.field("stranded", pa.float64()),
        pa.field("touched", pa.float64()),
        pa.field("time", pa.float64()),
        pa.field("settled", pa.bool_()),
    ]
)
"""A shard's table, one row a simulation: digest of the scene, setting (JSON, what
`sweep.settings` calls its identity), state of the code (`version_of_row`), number among the
draws of a noisy model, judgment, and, if it was a pour: shares stranded and touched, simulated
time [s], and whether it came to rest. Row k of a shard with trajectories is element k of their
array."""


def version_of_row(setting: str, goal: str) -> str:
    """State of all code that a row depends on: its setting's and its goal's."""
    return f"{setting}+{goal}"


@dataclass(frozen=True)
class Failure:
    """A shard that failed as often as it was tried."""

    shard: str
    attempts: int
    message: str


@dataclass(frozen=True)
class Damage:
    """A file whose content is not what was written."""

    shard: str
    path: Path
    reason: str

    def __str__(self) -> str:
        return f"{self.path}: damaged ({self.reason})"


class Store:
    """A study's results.

    Parameters
    ----------
    folder
        Where they are kept; made when something is written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.shards = folder / "shards"
        self.trajectories = folder / "trajectories"
        self._grids = folder / "grids"
        self._failures = folder / "failures"
        self._locks = folder / "locks"

    def prepare(self) -> None:
        """Make sure that something can be written.

        Raises
        ------
        InputError
            If nothing can be written there.
        """
        for folder in (self.folder, self._locks, self.shards):
            check_writable(folder / "store")

    def tidy(self) -> None:
        """Remove what a crash left half written."""
        for half in [*self.shards.glob("*/.*"), *self.trajectories.glob(".*")]:
            shard = half.name[1:].partition("-")[0].partition(".")[0]
            with self.locked(shard) as mine, suppress(OSError):
                if mine:
                    half.unlink()

    # Shards --------------------------------------------------------------------------

    def paths(self) -> dict[str, Path]:
        """Files of all shards, by the shard's id; not looked into."""
        files: dict[str, Path] = {}
        with suppress(FileNotFoundError):
            for folder in _entries(self.shards):
                if folder.is_dir():
                    files.update(_files(_entries(Path(folder.path)), ".parquet"))
        return files

    def path_of(self, shard: str) -> Path | None:
        """File of one shard, if it is there; not looked into."""
        folder = self.shards / shard[:2]
        with suppress(FileNotFoundError):
            return _files(_entries(folder), ".parquet").get(shard)
        return None

    def trajectory_paths(self) -> dict[str, Path]:
        """Files of all trajectories, by the shard's id; not looked into."""
        with suppress(FileNotFoundError):
            return _files(_entries(self.trajectories), ".zarr.zip")
        return {}

    def damaged(self, paths: dict[str, Path]) -> list[Damage]:
        """Files among these, or of their trajectories, whose checksum is wrong."""
        trajectories = self.trajectory_paths()
        files = [
            *paths.items(),
            *((shard, trajectories[shard]) for shard in trajectories.keys() & paths.keys()),
        ]
        batches = (files[k : k + _READ_AT_ONCE] for k in range(0, len(files), _READ_AT_ONCE))
        with ThreadPoolExecutor(_READERS) as pool:
            return [damage for batch in pool.map(_damaged, batches) for damage in batch]

    def discard(self, damage: Damage) -> None:
        """Remove a damaged file, and its shard's table, so that the shard is done again."""
        with store_errors(damage.path):
            damage.path.unlink(missing_ok=True)
            table = self.path_of(damage.shard)
            if table is not None:
                table.unlink(missing_ok=True)

    def read(self, path: Path) -> pa.Table | None:
        """A shard's table; None if the file is damaged or gone."""
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StoreError(f"{path}: cannot be read ({error.strerror})") from None
        if _checksum(content) != _checksum_in(path):
            return None
        # On this thread alone: threads of Arrow's that hand memory back to Python while the
        # interpreter ends would abort the process.
        return pq.read_table(pa.BufferReader(content), use_threads=False, pre_buffer=False)

    def write(self, shard: str, table: pa.Table) -> None:
        """Keep a shard's table."""
        path = self.shards / shard[:2] / f"{shard}.parquet"
        named = named_by_content(shard, ".parquet")
        with store_errors(path), replacing(path, named) as temporary:
            pq.write_table(table, temporary, compression="zstd")

    @contextmanager
    def locked(self, shard: str) -> Iterator[bool]:
        """Hold a shard's lock, so that no two workers do it at once; yields whether we hold it.

        The lock dies with its process. Where the file system has no locks, all get it: at
        worst work is done twice, with the same result.
        """
        lock = FileLock(self._locks / f"{shard}.lock")
        try:
            with store_errors(Path(lock.lock_file)):
                self._locks.mkdir(parents=True, exist_ok=True)
            lock.acquire(blocking=False)
        except Timeout:
            yield False
            return
        except (NotImplementedError, OSError) as error:
            if isinstance(error, OSError) and error.errno not in _NO_LOCKS:
                raise StoreError(f"{lock.lock_file}: cannot be locked ({error})") from None
            yield True
            return
        try:
            yield True
        finally:
            with suppress(OSError):
                os.unlink(lock.lock_file)
            lock.release()

    def locks_held(self) -> list[str]:
        """Shards that some process works on now."""
        held = []
        for path in self._locks.glob("*.lock"):
            with self.locked(path.stem) as mine:
                if not mine:
                    held.append(path.stem)
        return held

    # Grids and failures --------------------------------------------------------------

    def keep_grid(self, name: str, text: str) -> None:
        """Keep a grid's text, for `status` and for the record."""
        with store_errors(self._grids):
            write_text(self._grids / f"{name}.toml", text)

    def grids(self) -> list[Path]:
        """Files of the grids that were swept."""
        return sorted(self._grids.glob("*.toml"))

    def keep_failure(self, failure: Failure) -> None:
        """Keep what went wrong with a shard."""
        path = self._failures / f"{failure.shard}.json"
        with store_errors(path):
            write_text(path, json.dumps(asdict(failure), indent=2) + "\n")

    def forget_failure(self, shard: str) -> None:
        """Forget a failure, once the shard is done."""
        with suppress(OSError):
            (self._failures / f"{shard}.json").unlink(missing_ok=True)

    def failures(self, shards: Iterable[str]) -> list[Failure]:
        """Failures of these shards."""
        wanted = set(shards)
        failures = []
        for path in sorted(self._failures.glob("*.json")):
            if path.stem in wanted:
                with suppress(OSError, ValueError, TypeError):
                    failures.append(Failure(**json.loads(path.read_text(encoding="utf-8"))))
        return failures


def named_by_content(shard: str, suffix: str) -> Callable[[Path], str]:
    """How a shard's file gets its final name, once it is written; see `files.replacing`."""
    return lambda temporary: f"{shard}-{_checksum(temporary.read_bytes())}{suffix}"


def _entries(folder: Path) -> list["os.DirEntry[str]"]:
    with os.scandir(folder) as entries:
        return list(entries)


def _files(entries: Iterable["os.DirEntry[str]"], suffix: str) -> dict[str, Path]:
    return {
        entry.name.partition("-")[0]: Path(entry.path)
        for entry in entries
        if entry.name.endswith(suffix) and not entry.name.startswith(".")
    }


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:_CHECKSUM_DIGITS]


def _checksum_in(path: Path) -> str:
    return path.name.partition("-")[2].partition(".")[0]


def _damaged(files: Iterable[tuple[str, Path]]) -> list[Damage]:
    wrong = ((shard, path, _what_is_wrong(path)) for shard, path in files)
    return [Damage(shard, path, reason) for shard, path, reason in wrong if reason]


def _what_is_wrong(path: Path) -> str:
    """What is wrong with a file; nothing, if its checksum is right."""
    checksum = hashlib.sha256()
    try:
        with path.open("rb", buffering=0) as stream:
            while block := stream.read(_BLOCK_BYTES):
                checksum.update(block)
        if checksum.hexdigest()[:_CHECKSUM_DIGITS] == _checksum_in(path):
            return ""
        return "its checksum is wrong" if path.stat().st_size else "empty"
    except FileNotFoundError:
        return ""  # Another process found it damaged, and removed it.
    except OSError as error:
        return error.strerror or str(error)


@contextmanager
def store_errors(path: Path) -> Iterator[None]:
    """Turn what the file system complains about into one line."""
    try:
        yield
    except InputError as error:
        raise StoreError(str(error)) from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise StoreError(f"{path}: cannot be written ({reason})") from None
