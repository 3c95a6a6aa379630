"""A recorded pour, for pictures: cells that the liquid fills, drops that fly, moment by moment."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from pourcast.files import replacing

FULL = 255
"""Value of a full cell."""


@dataclass(frozen=True)
class Moment:
    """A liquid at one moment.

    Parameters
    ----------
    fill
        How full each cell is, 0 to `FULL`, uint8, shape [nx, ny, nz]; all sides 0 if the liquid is
        made of particles alone.
    points
        Position [m] and volume [m^3] of particles or drops, shape [count, 4].
    """

    fill: NDArray[np.uint8]
    points: NDArray[np.float32]


@dataclass(frozen=True)
class RecordedPour:
    """A pour as it was recorded, in the scene's measure.

    Parameters
    ----------
    moments
        One for each picture of the film.
    cell
        Width of a cell [m].
    origin
        Corner of the first cell [m].
    room
        Share of each cell that is not solid, shape [nx, ny, nz].
    outcome
        Share that the goal holds at the end.
    stranded
        Share that is still above the goal's rim at the end.
    """

    moments: tuple[Moment, ...]
    cell: float
    origin: tuple[float, float, float]
    room: NDArray[np.float32]
    outcome: float
    stranded: float

    @property
    def volume(self) -> float:
        """Volume of the liquid at the start [m^3]."""
        return self.volume_at(0)

    def volume_at(self, number: int) -> float:
        """Volume of the liquid at a moment [m^3]; thick where it is compressed by its weight."""
        moment = self.moments[number]
        held = float((moment.fill * self.room).sum(dtype=np.float64)) / FULL * self.cell**3
        return held + float(moment.points[:, 3].sum(dtype=np.float64))


def save_pour(path: Path, pour: RecordedPour) -> None:
    """Keep a pour as an .npz file."""
    counts = [len(moment.points) for moment in pour.moments]
    with replacing(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream,
            fill=np.stack([moment.fill for moment in pour.moments]),
            points=np.concatenate([moment.points for moment in pour.moments]),
            ends=np.cumsum(counts),
            cell=pour.cell,
            origin=pour.origin,
            room=pour.room,
            outcome=pour.outcome,
            stranded=pour.stranded,
        )


def load_pour(path: Path) -> RecordedPour | None:
    """Read what `save_pour` kept; None if that isn't there, or damaged."""
    try:
        return _read(path)
    except (OSError, EOFError, ValueError, KeyError, BadZipFile, zlib.error):
        return None


def _read(path: Path) -> RecordedPour:
    with path.open("rb") as stream, np.load(stream) as file:
        fill, ends = file["fill"], file["ends"]
        points = np.split(file["points"], ends[:-1])
        x, y, z = (float(value) for value in file["origin"])
        return RecordedPour(
            moments=moments_of(fill, points),
            cell=float(file["cell"]),
            origin=(x, y, z),
            room=file["room"],
            outcome=float(file["outcome"]),
            stranded=float(file["stranded"]),
        )


def moments_of(
    fill: Sequence[NDArray[np.uint8]] | NDArray[np.uint8], points: Sequence[NDArray[np.float32]]
) -> tuple[Moment, ...]:
    """Moments from their parts."""
    return tuple(Moment(cells, drops) for cells, drops in zip(fill, points, strict=True))
