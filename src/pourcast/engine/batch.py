"""Many simulations at once: 16 in lockstep in a block, one block a thread.

A block holds simulations of one particle count. A simulation that has come to
rest leaves its lane, and the next one in the queue takes it, so that lanes
are never idle for long. Lanes don't influence one another: a simulation's
result has the same bits alone, in any batch and on any number of threads.
"""

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
from pourcast.engine.kernel import GRADIENT_FACTOR
from pourcast.engine.simd import LANES, flush_denormals
from pourcast.engine.solids import Cells, Solids, build_cells, join_cells
from pourcast.engine.state import Lanes, State, empty_lanes, empty_state

REST_SPEED = 0.02
"""A simulation rests when no particle is faster than this [m/s] ..."""

REST_FRAMES = 6
"""... in this many frames in a row."""

HEAD_MARGIN = 0.9
"""It also ends when the outcome is decided: for REST_FRAMES frames in a row no
particle's head reaches this share of the height of the rim."""


class SimulationDivergedError(RuntimeError):
    """A simulation left the range of finite numbers."""


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
    lanes: Lanes
    count: int
    jobs: dict[int, int] = field(default_factory=dict)
    """Lane -> index of the job in it."""
    duration: NDArray[np.float64] = field(default_factory=_lane_values)
    """Cap on each lane's simulated time [s]; void in an empty lane, as are those below."""
    decided_below: NDArray[np.float64] = field(default_factory=_lane_values)
    """Head [m] below which each lane's outcome is decided."""
    frames_done: NDArray[np.int64] = field(default_factory=_lane_counts)
    still_frames: NDArray[np.int64] = field(default_factory=_lane_counts)
    recorded: dict[int, list[NDArray[np.float32]]] = field(default_factory=dict)


def fill_lane(lanes: Lanes, lane: int | slice, job: Job, step: float) -> None:
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
        getattr(lanes, name)[lane] = value


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
        If a simulation's speeds are no longer finite.
    """
    if not jobs:
        return []
    results: list[Result | None] = [None] * len(jobs)
    queue = deque(range(len(jobs)))
    stop = threading.Event()
    worker_count = min(threads or available_cores(), len(jobs))
    large = kind == "liquid" and len(jobs[0].position) > neighbours.ALL_PAIRS_LIMIT
    width = 1 if large else min(LANES, -(-len(jobs) // worker_count))

    def work(cells: Cells) -> None:
        block = _new_block(len(jobs[0].position), large=large)
        while not stop.is_set():
            _take_jobs(block, queue, jobs, stepping.step, width, record=record, large=large)
            if not block.jobs:
                return
            _advance(block, solids, cells, stepping, kind=kind, large=large)
            for index, result in _finished(block, stepping, large=large):
                results[index] = result
                if on_done is not None:
                    on_done(index, result)

    with ThreadPoolExecutor(worker_count, initializer=flush_denormals) as pool:
        try:
            cells = _cells_of(jobs, solids, pool, worker_count)
            futures = [pool.submit(work, cells) for _ in range(worker_count)]
            for future in as_completed(futures):  # the first that fails ends the others
                future.result()
        finally:
            stop.set()
    return [result for result in results if result is not None]


def available_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _cells_of(jobs: Sequence[Job], solids: Solids, pool: Executor, worker_count: int) -> Cells:
    """Broad phase of all scenes, a share of them a worker."""
    scene_count = len(solids.scene_start) - 1
    extents = np.ones((scene_count, 2))
    for job in jobs:
        extents[job.scene] = job.width, job.height
    reach = (1.0 + TOUCH_SKIN + LIST_SKIN) * max(job.radius for job in jobs)
    edges = np.linspace(0, scene_count, worker_count + 1).astype(int)
    shares = pool.map(partial(build_cells, solids, extents, reach), edges[:-1], edges[1:])
    return join_cells([Cells(*share) for share in shares])


def _new_block(count: int, *, large: bool) -> _Block:
    return _Block(empty_state(-(-count // LANES) if large else count), empty_lanes(), count)


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
) -> None:
    """Fill empty lanes from the queue."""
    for lane in range(width):
        if lane in block.jobs:
            continue
        try:
            index = queue.popleft()
        except IndexError:
            return
        job = jobs[index]
        _place(block, lane, job, large=large)
        fill_lane(block.lanes, slice(None) if large else lane, job, step)
        block.jobs[lane] = index
        block.frames_done[lane] = block.still_frames[lane] = 0
        block.duration[lane], block.decided_below[lane] = job.duration, HEAD_MARGIN * job.rim
        if record:
            block.recorded[lane] = [job.position.copy()]


def _place(block: _Block, lane: int, job: Job, *, large: bool) -> None:
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
    block: _Block, solids: Solids, cells: Cells, stepping: Stepping, *, kind: str, large: bool
) -> None:
    arguments = (block.state, block.lanes, solids, cells, stepping.step, stepping.steps_per_frame)
    if kind == "marbles":
        rigid.advance(*arguments)
    elif large:
        neighbours.advance_one(*arguments, block.count)
    else:
        sph.advance(*arguments)


def _finished(block: _Block, stepping: Stepping, *, large: bool) -> list[tuple[int, Result]]:
    """Count the frame, record it, and empty the lanes whose simulation is over."""
    squared_speed, head = np.empty(LANES, np.float32), np.empty(LANES, np.float32)
    sph.measure(block.state, block.lanes, squared_speed, head)
    speed = np.sqrt(squared_speed)
    if large:
        speed[:], head[:] = speed.max(), head.max()
    for lane in block.recorded:
        frame = _particles(block.state.position, block.count, lane, large=large)
        block.recorded[lane].append(frame)
    block.frames_done += 1
    still = (speed < REST_SPEED) | (head < block.decided_below)
    block.still_frames = np.where(still, block.still_frames + 1, 0)
    settled = block.still_frames >= REST_FRAMES
    time = block.frames_done * stepping.frame
    over = settled | (time >= block.duration - 1e-9) | ~np.isfinite(speed)
    done = []
    for lane, index in list(block.jobs.items()):
        if not over[lane]:
            continue
        if not np.isfinite(speed[lane]):
            raise SimulationDivergedError(
                f"simulation {index} diverged: the time step {stepping.step:g} s is too long"
            )
        result = _take_out(block, lane, float(time[lane]), settled=bool(settled[lane]), large=large)
        done.append((index, result))
    return done


def _take_out(block: _Block, lane: int, time: float, *, settled: bool, large: bool) -> Result:
    state, count = block.state, block.count
    touched = state.touched.reshape(-1)[:count] if large else state.touched[:, lane]
    frames = block.recorded.pop(lane, None)
    del block.jobs[lane]
    block.lanes.scene[slice(None) if large else lane] = -1
    return Result(
        position=_particles(state.position, count, lane, large=large),
        velocity=_particles(state.velocity, count, lane, large=large),
        touched=touched.astype(bool),
        time=time,
        settled=settled,
        frames=None if frames is None else np.stack(frames),
    )
