"""Pours of several models together: each different one is run once, and its outcome remembered."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Iterator, Sequence
from dataclasses import astuple, replace
from typing import TypeVar

from pourcast.progress import Progress, no_progress
from pourcast.simulation.pour import Outcome, Pour
from pourcast.simulation.settings import EngineSettings

MOST_REMEMBERED = 64 * 2**20
"""Outcomes of so much are remembered in a process [bytes]."""

PIECE = 32 * 2**20
"""Of pours that are run together, so much is held at once [bytes]."""

_POUR_BYTES = 2048
"""What a pour and its outcome take beside the particles [bytes]."""

_PARTICLE_BYTES = 40
"""What a particle takes while its pour is run: start, end, velocity, marks [bytes]."""

_POSITION_BYTES = 12
"""A particle's position in a frame [bytes]."""

Identity = tuple[Hashable, ...]
"""All that a pour's outcome depends on."""

Taken = TypeVar("Taken")


class OutcomeMemory:
    """Outcomes of pours by what decides them; what was not used for longest is forgotten first.

    It changes no result, only the time: a pour has the same bits whenever it is run.

    Parameters
    ----------
    most
        Outcomes of so much are remembered [bytes].
    """

    def __init__(self, most: int = MOST_REMEMBERED) -> None:
        self._most = most
        self._bytes = 0
        self._outcomes: OrderedDict[Identity, Outcome] = OrderedDict()
        self._lock = threading.Lock()

    def find(self, identity: Identity, *, frames: bool = False) -> Outcome | None:
        """A pour's outcome, with its frames if they are wanted; None if it isn't known.

        Nobody can write into its arrays.
        """
        with self._lock:
            known = self._outcomes.get(identity)
            if known is None or (frames and known.frames is None):
                return None
            self._outcomes.move_to_end(identity)
            return known

    def keep(self, identity: Identity, outcome: Outcome) -> None:
        """Remember a pour's outcome."""
        for array in (outcome.position, outcome.frames):
            if array is not None:
                array.flags.writeable = False
        with self._lock:
            self._forget(identity)
            self._outcomes[identity] = outcome
            self._bytes += _bytes_of(outcome)
            while self._bytes > self._most:
                self._forget(next(iter(self._outcomes)))

    def forget_all(self) -> None:
        """Forget everything."""
        with self._lock:
            self._outcomes.clear()
            self._bytes = 0

    def _forget(self, identity: Identity) -> None:
        known = self._outcomes.pop(identity, None)
        self._bytes -= 0 if known is None else _bytes_of(known)


REMEMBERED = OutcomeMemory()
"""What this process remembers: pictures of models need not run again what judgments just did."""


def outcomes_of(
    pours: Sequence[Pour],
    take: Callable[[Outcome], Taken],
    *,
    settings: EngineSettings | None = None,
    record: Collection[int] = (),
    memory: OutcomeMemory | None = None,
    progress: Progress = no_progress,
) -> list[Taken]:
    """Run pours, each different one once, and take from each outcome what is needed of it.

    Two pours are the same if nothing that decides their outcomes differs: scenes may have other
    ids, and liquids other names. Of the positions of many pours only those of some are held at a
    time: `PIECE`, and what `memory` keeps.

    Parameters
    ----------
    pours
        What to run, of any models and scenes.
    take
        What is taken from an outcome.
    settings
        How to compute.
    record
        Which of the pours, by their numbers, are recorded: their outcomes have frames.
    memory
        Where outcomes are looked up and kept; by default nothing is remembered.
    progress
        Called with the pours that were run, and how many are.

    Returns
    -------
    list
        What was taken, in the order of `pours`.

    Raises
    ------
    SimulationDivergedError
        If a pour breaks: the message names scene, liquid and settings.
    """
    settings = settings or EngineSettings()
    memory = OutcomeMemory(0) if memory is None else memory
    identities = _identities(pours, settings)
    recorded = {identities[number] for number in record}
    taken: dict[Identity, Taken] = {}
    left: dict[Identity, Pour] = {}
    for identity, pour in zip(identities, pours, strict=True):
        if identity in taken or identity in left:
            continue
        known = memory.find(identity, frames=identity in recorded)
        if known is None:
            left[identity] = pour
        else:
            taken[identity] = take(known)
    record_some = not recorded.isdisjoint(left)
    for identity, outcome in _run(left, settings, progress, record=record_some):
        if identity not in recorded and outcome.frames is not None:
            outcome = replace(outcome, frames=None)  # noqa: PLW2901
        memory.keep(identity, outcome)
        taken[identity] = take(outcome)
    return [taken[identity] for identity in identities]


def _run(
    pours: dict[Identity, Pour], settings: EngineSettings, progress: Progress, *, record: bool
) -> Iterator[tuple[Identity, Outcome]]:
    """Run pours, piece by piece."""
    if not pours:
        return
    # The engine is loaded when something is to be run.
    from pourcast.simulation.run import simulate  # noqa: PLC0415

    done = 0

    def count(done_here: int, _total: int) -> None:
        progress(done + done_here, len(pours))

    progress(0, len(pours))
    for piece in _pieces(pours, settings, record=record):
        here = [pours[identity] for identity in piece]
        # Nothing else holds the outcomes: they can go while the next piece is run.
        yield from zip(
            piece, simulate(here, settings=settings, record=record, progress=count), strict=True
        )
        done += len(piece)


def _identities(pours: Sequence[Pour], settings: EngineSettings) -> list[Identity]:
    # A scene's digest takes longer than all else, and most scenes are poured many times.
    scenes = {id(pour.scene): pour.scene for pour in pours}
    digests = {key: scene.digest for key, scene in scenes.items()}
    computed = astuple(settings)
    return [
        (
            digests[id(pour.scene)],
            type(pour.scene.goal),
            tuple(pour.liquid.engine_identity.values()),
            pour.n_particles,
            pour.damping_zeta,
            tuple(pour.offset),
            pour.kind,
            computed,
        )
        for pour in pours
    ]


def _pieces(
    pours: dict[Identity, Pour], settings: EngineSettings, *, record: bool
) -> Iterator[list[Identity]]:
    """Pours that are run together, such that no more than `PIECE` is held at once."""
    frames = settings.max_duration * settings.frame_rate if record else 0.0
    each = _PARTICLE_BYTES + _POSITION_BYTES * frames
    piece: list[Identity] = []
    held = 0.0
    for identity, pour in pours.items():
        size = _POUR_BYTES + each * pour.n_particles
        if piece and held + size > PIECE:
            yield piece
            piece, held = [], 0.0
        piece.append(identity)
        held += size
    if piece:
        yield piece


def _bytes_of(outcome: Outcome) -> int:
    frames = 0 if outcome.frames is None else outcome.frames.nbytes
    return _POUR_BYTES + outcome.position.nbytes + frames
