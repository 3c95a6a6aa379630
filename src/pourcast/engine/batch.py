"""Many simulations at once: 16 in lockstep in a block, one block a thread.

A block holds simulations of one particle count. A simulation that has come to
rest leaves its lane, and the next one in the queue takes it, so that lanes
are never idle for long. Lanes don't influence one another: a simulation's
result has the same bits alone, in any batch and on any number of threads.
"""

import math
import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pourcast.engine import neighbours, rigid, sph
from pourcast.engine.contact import LIST_SKIN, TOUCH_SKIN
from pourcast.engine.diagnostics import (
    GAINS_ENERGY,
    NOT_FINITE,
    OUTSIDE,
    SOUND,
    Diagnostics,
    allowed_gain,
    empty_diagnostics,
    measure,
    measure_and_check,
)
from pourcast.engine.polygons import Solids
from pourcast.engine.simd import LANES, flush_denormals
from pourcast.engine.smoothing import GRADIENT_FACTOR
from pourcast.engine.solids import BroadPhase, build_broad_phase, join_broad_phases
from pourcast.engine.state import LaneParameters, State, empty_parameters, empty_state
from pourcast.errors import InputError, SimulationDivergedError

REST_SPEED = 0.02
"""A simulation rests when no particle is faster than this [m/s] ..."""

REST_FRAMES = 6
"""... in this many frames in a row."""

HEAD_MARGIN = 0.9
"""It also ends when the outcome is decided: for REST_FRAMES frames in a row no
particle's head reaches this share of the height of the rim."""


@dataclass(frozen=True)
class Job:
    """One simulation, in numbers.

    Lengths in m, times in s. `damping` is zeta [1/s]; `adhesion_normal` and
    `adhesion_tangential` are decay rates [1/s] of the speed while in contact.
    """

    position: NDArray[np.float32]
    """Starting positions [m], shape [count, 3]."""
    scene: int
    """Index of the scene in the `Solids` of the batch."""
    width: float
    height: float
    depth: float
    radius: float
    """Contact radius of a particle [m]."""
    support_radius: float
    reference_density: float
    sound_speed: float
    viscosity_alpha: float
    damping: float
    duration: float
    """Cap on the simulated time [s]."""
    gravity: float = 9.81
    adhesion_normal: float = 0.0
    adhesion_tangential: float = 0.0
    ceiling: float = np.inf
    """Height of a lid [m]; none by default."""
    rim: float = 0.0
    """Height [m] that a particle must climb to change the outcome; 0 to wait for rest."""
    velocity: NDArray[np.float32] | None = None
    """Starting velocities [m/s], shape [count, 3]; at rest by default."""

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            _check("job", name, getattr(self, name), "more than 0", getattr(self, name) > 0.0)
        for name in _NOT_NEGATIVE:
            _check("job", name, getattr(self, name), "at least 0", getattr(self, name) >= 0.0)
        if not (self.ceiling > 0.0):
            raise InputError(f"job: ceiling: expected more than 0, found {self.ceiling}")


_POSITIVE = (
    "width", "height", "depth", "radius", "support_radius", "reference_density", "sound_speed",
    "duration",
)  # fmt: skip
_NOT_NEGATIVE = (
    "viscosity_alpha", "damping", "gravity", "adhesion_normal", "adhesion_tangential",
)  # fmt: skip


def _check(owner: str, field: str, value: float, expected: str, right: bool) -> None:
    if not (right and math.isfinite(value)):
        raise InputError(f"{owner}: {field}: expected {expected}, found {value}")


@dataclass
class Result:
    """Where a simulation ended."""

    position: NDArray[np.float32]
    """Positions at the end [m], shape [count, 3]."""
    velocity: NDArray[np.float32]
    """Velocities at the end [m/s], shape [count, 3]."""
    touched: NDArray[np.bool_]
    """Whether each particle ever met an obstacle, shape [count]."""
    time: float
    """Simulated time [s]."""
    settled: bool
    """Whether it came to rest, or its outcome was decided, before the cap."""
    frames: NDArray[np.float32] | None
    """Positions frame by frame [m], shape [frame_count, count, 3], if recorded."""


@dataclass(frozen=True)
class Stepping:
    """How a batch is stepped: `steps_per_frame` steps of `step` seconds make a frame."""

    step: float
    steps_per_frame: int

    def __post_init__(self) -> None:
        _check("stepping", "step", self.step, "more than 0 s", self.step > 0.0)
        count = self.steps_per_frame
        _check("stepping", "steps_per_frame", count, "at least 1", count >= 1)

    @property
    def frame(self) -> float:
        """Simulated time between two looks at the state [s]."""
        return self.step * self.steps_per_frame


def _lane_values() -> NDArray[np.float64]:
    return np.full(LANES, np.inf)


def _lane_counts() -> NDArray[np.int64]:
    return np.zeros(LANES, np.int64)


@dataclass
class _Block:
    """A state, its lanes' parameters, and which job is in which lane."""

    state: State
    parameters: LaneParameters
    count: int
    jobs: dict[int, int] = field(default_factory=dict)
    """Lane -> index of the job in it."""
    duration: NDArray[np.float64] = field(default_factory=_lane_values)
    """Cap on each lane's simulated time [s]; void in an empty lane, as are those below."""
    decided_below: NDArray[np.float64] = field(default_factory=_lane_values)
    """Head [m] below which each lane's outcome is decided."""
    frames_done: NDArray[np.int64] = field(default_factory=_lane_counts)
    still_frames: NDArray[np.int64] = field(default_factory=_lane_counts)
    diagnostics: Diagnostics = field(default_factory=empty_diagnostics)
    recorded: dict[int, list[NDArray[np.float32]]] = field(default_factory=dict)


def fill_lane(parameters: LaneParameters, lane: int | slice, job: Job, step: float) -> None:
    """Write a job's parameters into a lane, in the form in which the kernels want them."""
    h = 0.5 * job.support_radius
    gradient = GRADIENT_FACTOR / (job.support_radius**2 * job.reference_density)
    values = {
        "scene": job.scene,
        "width": job.width,
        "depth": job.depth,
        "ceiling": job.ceiling,
        "radius": job.radius,
        "inverse_support": 1.0 / job.support_radius,
        "reference_density": job.reference_density,
        "pressure_factor": gradient * job.sound_speed**2,
        "viscosity_factor": 2.0 * gradient * job.viscosity_alpha * job.sound_speed * h,
        "separation_floor": 0.01 * h**2,
        "gravity": job.gravity,
        "damping": job.damping,
        "keep_normal": np.exp(-job.adhesion_normal * step),
        "keep_tangential": np.exp(-job.adhesion_tangential * step),
    }
    for name, value in values.items():
        getattr(parameters, name)[lane] = value


def run_batch(
    jobs: Sequence[Job],
    solids: Solids,
    stepping: Stepping,
    *,
    kind: Literal["liquid", "marbles"] = "liquid",
    record: bool = False,
    threads: int | None = None,
    on_done: Callable[[int, Result], None] | None = None,
) -> list[Result]:
    """Run simulations of one particle count, and return where each ended.

    Parameters
    ----------
    jobs
        The simulations; all with the same number of particles.
    solids
        Polygons of the scenes that the jobs name.
    stepping
        Step and frame.
    kind
        SPH liquid, or rigid spheres.
    record
        Keep the positions of every frame.
    threads
        Worker threads; all cores by default. Results don't depend on it.
    on_done
        Called from a worker thread with index and result of each job that ended.

    Returns
    -------
    list of Result
        In the order of the jobs.

    Raises
    ------
    SimulationDivergedError
        If a simulation breaks (`diagnostics`); its `number` is the job's index.
    """
    if not jobs:
        return []
    results: list[Result | None] = [None] * len(jobs)
    queue = deque(range(len(jobs)))
    stop = threading.Event()
    worker_count = min(threads or available_cores(), len(jobs))
    large = kind == "liquid" and len(jobs[0].position) > neighbours.ALL_PAIRS_LIMIT
    width = 1 if large else min(LANES, -(-len(jobs) // worker_count))

    def work(broad_phase: BroadPhase) -> None:
        block = _new_block(len(jobs[0].position), large=large)
        while not stop.is_set():
            fresh = _take_jobs(block, queue, jobs, stepping.step, width, record=record, large=large)
            if not block.jobs:
                return
            if fresh:
                _measure_start(block, [(k, jobs[block.jobs[k]]) for k in fresh], kind, large=large)
            _advance(block, solids, broad_phase, stepping, kind=kind, large=large)
            for index, result in _finished(block, stepping, large=large):
                results[index] = result
                if on_done is not None:
                    on_done(index, result)

    with ThreadPoolExecutor(worker_count, initializer=flush_denormals) as pool:
        try:
            broad_phase = _broad_phase_of(jobs, solids, pool, worker_count)
            futures = [pool.submit(work, broad_phase) for _ in range(worker_count)]
            for future in as_completed(futures):  # the first that fails ends the others
                future.result()
        finally:
            stop.set()
    return [result for result in results if result is not None]


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _broad_phase_of(
    jobs: Sequence[Job], solids: Solids, pool: Executor, worker_count: int
) -> BroadPhase:
    """Broad phase of all scenes, a share of them a worker."""
    scene_count = len(solids.scene_start) - 1
    extents = np.ones((scene_count, 2))
    for job in jobs:
        extents[job.scene] = job.width, job.height
    reach = (1.0 + TOUCH_SKIN + LIST_SKIN) * max(job.radius for job in jobs)
    edges = np.linspace(0, scene_count, worker_count + 1).astype(int)
    shares = pool.map(partial(build_broad_phase, solids, extents, reach), edges[:-1], edges[1:])
    return join_broad_phases([BroadPhase(*share) for share in shares])


def _new_block(count: int, *, large: bool) -> _Block:
    return _Block(empty_state(-(-count // LANES) if large else count), empty_parameters(), count)


def _particles(
    array: NDArray[np.float32], count: int, lane: int, *, large: bool
) -> NDArray[np.float32]:
    """Positions or velocities [count, 3] of one simulation, as a copy."""
    rows = array.reshape(3, -1)[:, :count] if large else array[:, :, lane]
    return np.ascontiguousarray(rows.T)


def _take_jobs(
    block: _Block,
    queue: deque[int],
    jobs: Sequence[Job],
    step: float,
    width: int,
    *,
    record: bool,
    large: bool,
) -> list[int]:
    """Fill empty lanes from the queue; returns which."""
    fresh: list[int] = []
    for lane in range(width):
        if lane in block.jobs:
            continue
        try:
            index = queue.popleft()
        except IndexError:
            break
        job = jobs[index]
        _write_start(block, lane, job, large=large)
        fill_lane(block.parameters, slice(None) if large else lane, job, step)
        block.jobs[lane] = index
        block.frames_done[lane] = block.still_frames[lane] = 0
        block.duration[lane], block.decided_below[lane] = job.duration, HEAD_MARGIN * job.rim
        if record:
            block.recorded[lane] = [job.position.copy()]
        fresh.append(lane)
    return fresh


def _measure_start(
    block: _Block, fresh: Sequence[tuple[int, Job]], kind: str, *, large: bool
) -> None:
    """Measure the energy at the start of the jobs in some lanes."""
    if kind == "liquid" and large:
        neighbours.find_density(block.state, block.parameters, block.count)
    elif kind == "liquid":
        sph.find_density(block.state, block.parameters)
    found = block.diagnostics
    measure(block.state, block.parameters, 0.0, block.count, large, found)
    for lane, job in fresh:
        energy, lanes = float(found.energy[lane]), slice(None) if large else lane
        found.least_energy[lanes] = energy
        found.allowed_gain[lanes] = allowed_gain(
            energy, block.count, job.gravity, job.radius, job.sound_speed
        )
        block.state.squared_top_speed[lanes] = 0.0


def _write_start(block: _Block, lane: int, job: Job, *, large: bool) -> None:
    velocity = np.zeros_like(job.position) if job.velocity is None else job.velocity
    state = block.state
    if not large:
        state.position[:, :, lane] = job.position.T
        state.velocity[:, :, lane] = velocity.T
        state.touched[:, lane] = 0.0
        state.squared_slack[:, lane] = -1.0
        return
    # Padding rests on the floor; it is left out of every sum over pairs.
    state.position.reshape(3, -1)[:] = np.array([[job.width / 2], [job.radius], [job.depth / 2]])
    state.position.reshape(3, -1)[:, : block.count] = job.position.T
    state.velocity[:] = 0.0
    state.velocity.reshape(3, -1)[:, : block.count] = velocity.T
    state.touched[:] = 0.0
    state.squared_slack[:] = -1.0


def _advance(
    block: _Block,
    solids: Solids,
    broad_phase: BroadPhase,
    stepping: Stepping,
    *,
    kind: str,
    large: bool,
) -> None:
    arguments = (
        block.state,
        block.parameters,
        solids,
        broad_phase,
        stepping.step,
        stepping.steps_per_frame,
    )
    if kind == "marbles":
        rigid.advance(*arguments)
    elif large:
        neighbours.advance_one(*arguments, block.count)
    else:
        sph.advance(*arguments)


def _finished(block: _Block, stepping: Stepping, *, large: bool) -> list[tuple[int, Result]]:
    """Count the frame, record it, and empty the lanes whose simulation is over."""
    found = block.diagnostics
    sound = measure_and_check(
        block.state, block.parameters, stepping.step, block.count, large, found
    )
    block.frames_done += 1
    if not sound:
        raise _diverged(block, stepping)
    for lane in block.recorded:
        frame = _particles(block.state.position, block.count, lane, large=large)
        block.recorded[lane].append(frame)
    still = (np.sqrt(found.squared_speed) < REST_SPEED) | (found.head < block.decided_below)
    block.still_frames = np.where(still, block.still_frames + 1, 0)
    settled = block.still_frames >= REST_FRAMES
    time = block.frames_done * stepping.frame
    over = settled | (time >= block.duration - 1e-9)
    done = []
    for lane, index in list(block.jobs.items()):
        if over[lane]:
            end = _take_out(
                block, lane, float(time[lane]), settled=bool(settled[lane]), large=large
            )
            done.append((index, end))
    return done


def _diverged(block: _Block, stepping: Stepping) -> SimulationDivergedError:
    """What is wrong with the first broken simulation of a block."""
    found = block.diagnostics
    lane = int(np.flatnonzero(found.verdict != SOUND)[0])
    verdict, step = found.verdict[lane], f"{stepping.step:g} s"
    if verdict == NOT_FINITE:
        fault = "a speed is no finite number"
    elif verdict == OUTSIDE:
        fault = f"{found.outside[lane]:g} of {block.count} particles are not inside the box"
    elif verdict == GAINS_ENERGY:
        fault = (
            f"the liquid has gained {found.energy[lane] - found.least_energy[lane]:.3g} J/kg of "
            f"energy, where errors explain {found.allowed_gain[lane]:.3g} J/kg"
        )
    else:
        fault = (
            f"a particle has moved by more than its radius, "
            f"{block.parameters.radius[lane]:.3g} m, in one step"
        )
    return SimulationDivergedError(
        f"diverged after {block.frames_done[lane] * stepping.frame:.3g} s of its time: {fault}; "
        f"the time step {step} is too long, or a particle wider than the box",
        number=block.jobs.get(lane, next(iter(block.jobs.values()))),
    )


def _take_out(block: _Block, lane: int, time: float, *, settled: bool, large: bool) -> Result:
    state, count = block.state, block.count
    touched = state.touched.reshape(-1)[:count] if large else state.touched[:, lane]
    frames = block.recorded.pop(lane, None)
    del block.jobs[lane]
    block.parameters.scene[slice(None) if large else lane] = -1
    return Result(
        position=_particles(state.position, count, lane, large=large),
        velocity=_particles(state.velocity, count, lane, large=large),
        touched=touched.astype(bool),
        time=time,
        settled=settled,
        frames=None if frames is None else np.stack(frames),
    )
