"""Paths of all particles, in Zarr: one array a shard, in one file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pourcast.extras import optional_module
from pourcast.files import replacing
from pourcast.simulation.pour import Outcome
from pourcast.sweep.store import Store, named_by_content, store_errors

CHUNK_BYTES = 8e6
"""Size of a chunk before compression, roughly."""


def write_trajectories(
    store: Store, shard: str, outcomes: Sequence[Outcome | None], frame_rate: float
) -> None:
    """Keep a shard's paths.

    The array `position` [m] has the shape [rows of the shard, frames, particles, 3];
    where there are fewer frames or particles, or no pour, it is not a number.

    Parameters
    ----------
    store
        The store.
    shard
        The shard's id.
    outcomes
        One for each row of the shard's table; recorded.
    frame_rate
        Frames per simulated second.
    """
    zarr = optional_module("zarr", "trajectories")
    frames = [None if outcome is None else outcome.frames for outcome in outcomes]
    recorded = [frame for frame in frames if frame is not None]
    size = (max(len(f) for f in recorded), max(f.shape[1] for f in recorded), 3)
    together = max(1, min(len(frames), int(CHUNK_BYTES / (4 * np.prod(size)))))
    path = store.trajectories / f"{shard}.zarr.zip"
    for leftover in store.trajectories.glob(f"{shard}-*"):
        leftover.unlink()
    named = named_by_content(shard, ".zarr.zip")
    with store_errors(path), replacing(path, named) as temporary, _zip(temporary, "w") as file:
        array = zarr.create_array(
            file,
            shape=(len(frames), *size),
            chunks=(together, *size),
            dtype="float32",
            fill_value=np.nan,
            attributes={"shard": shard, "unit": "m", "frame_rate": frame_rate},
        )
        for first in range(0, len(frames), together):
            batch = frames[first : first + together]
            block = np.full((len(batch), *size), np.nan, np.float32)
            for row, frame in enumerate(batch):
                if frame is not None:
                    block[row, : len(frame), : frame.shape[1]] = frame
            array[first : first + together] = block


def read_trajectories(path: Path) -> Any:
    """A shard's array, to be read piece by piece.

    Parameters
    ----------
    path
        A file of `sweep/trajectories`.
    """
    zarr = optional_module("zarr", "trajectories")
    return zarr.open_array(_zip(path, "r"), mode="r")


def _zip(path: Path, mode: str) -> Any:
    return optional_module("zarr.storage", "trajectories").ZipStore(path, mode=mode)
