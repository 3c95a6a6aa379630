"""Blocks: simulations that are stepped together, in lockstep or one in rows of its particles.

Both keep their particles in the same arrays (`state`), and a simulation can be moved from one to
another between two frames: its bits don't depend on where it is computed.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pourcast.cores import available_cores
from pourcast.engine import clusters, rigid, sph
from pourcast.engine.cohesion import cohesion_factor
from pourcast.engine.diagnostics import (
    GAINS_ENERGY,
    NOT_FINITE,
    OUTSIDE,
    SOUND,
    allowed_gain,
    empty_diagnostics,
    measure,
    measure_and_check,
)
from pourcast.engine.job import Job, Result, Stepping
from pourcast.engine.pairs import empty_pairs
from pourcast.engine.polygons import Solids
from pourcast.engine.simd import LANES
from pourcast.engine.smoothing import GRADIENT_FACTOR
from pourcast.engine.solids import BroadPhase
from pourcast.engine.state import LaneParameters, State, empty_parameters, empty_state
from pourcast.engine.team import Helper
from pourcast.errors import SimulationDivergedError

Kind = Literal["liquid", "marbles"]
"""SPH liquid, or rigid spheres."""

Frame = tuple[State, LaneParameters, Solids, BroadPhase, float, int]
"""What the kernels are given to move a block on: its particles and their parameters, what they
meet, a step [s] and how many."""

REST_SPEED = 0.02
"""A simulation rests when no particle is faster than this [m/s] ..."""

REST_FRAMES = 6
"""... in this many frames in a row."""

HEAD_MARGIN = 0.9
"""It also ends when the outcome is decided: for REST_FRAMES frames in a row no
particle's head reaches this share of the height of the rim."""

_MOST_SLOW_FRAMES = 3
"""Frames that may take a team longer than its leader alone, before that goes on alone."""

_OF_A_BLOCK = ("squared_top_speed", "most_near")
"""Fields of `State` that are no particle's own; both are found anew."""


@dataclass(frozen=True)
class Simulation:
    """One simulation between two frames: a job, and how far it has come."""

    number: int
    """The job's number among all that are run."""
    job: Job
    particles: dict[str, NDArray[Any]] | None = None
    """Fields of `State`, of its particles alone, shape [..., count]; none at the start."""
    frames_done: int = 0
    still_frames: int = 0
    least_energy: float = np.inf
    allowed_gain: float = 0.0
    recorded: tuple[NDArray[np.float32], ...] | None = None
    """Positions of each frame so far [m], shape [count, 3] each, if they are recorded."""


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
        "least_pressure": -job.tension,
        "fastest_parting": np.inf if job.viscosity_of_all_pairs else 0.0,
        "cohesion_factor": cohesion_factor(job.cohesion, job.spacing, job.support_radius),
        "neutral_slope": (1.0 - job.spacing / job.support_radius) ** 3,
        "touch": job.touch,
        "gravity": job.gravity,
        "damping": job.damping,
        "keep_normal": np.exp(-job.adhesion_normal * step),
        "keep_tangential": np.exp(-job.adhesion_tangential * step),
    }
    for name, value in values.items():
        getattr(parameters, name)[lane] = value


class Block(ABC):
    """Particles of some simulations, their parameters, and which simulation is where."""

    def __init__(self, count: int, rows: int, kind: Kind) -> None:
        self.count, self.kind = count, kind
        self.state, self.parameters = empty_state(rows), empty_parameters()
        self.diagnostics = empty_diagnostics()
        self.simulations: dict[int, Simulation] = {}
        """By lane, as they were put in."""
        self.recorded: dict[int, list[NDArray[np.float32]]] = {}
        # Void in an empty lane.
        self._duration, self._decided_below = np.full(LANES, np.inf), np.full(LANES, np.inf)
        self._frames_done, self._still_frames = (np.zeros(LANES, np.int64) for _ in range(2))

    lanes: int
    """How many simulations there is room for."""
    rows_are_one: bool
    """Whether all lanes are one simulation."""

    @abstractmethod
    def particles_of(self, array: NDArray[Any], lane: int) -> NDArray[Any]:
        """View of a field of `State` [..., row_count, LANES] for one simulation: [..., slots].

        There may be more slots than particles, for copies of the last one.
        """

    @abstractmethod
    def _find_density(self) -> None: ...

    @abstractmethod
    def _advance(self, frame: Frame) -> None: ...

    def _lanes_of(self, lane: int) -> int | slice:
        return slice(None) if self.rows_are_one else lane

    def put(self, simulations: Sequence[Simulation], step: float) -> None:
        """Put simulations into empty lanes.

        Parameters
        ----------
        simulations
            As many as there are empty lanes, or fewer.
        step
            Time step [s].
        """
        empty = [lane for lane in range(self.lanes) if lane not in self.simulations]
        fresh = []
        for lane, simulation in zip(empty, simulations, strict=False):
            self.simulations[lane] = simulation
            fill_lane(self.parameters, self._lanes_of(lane), simulation.job, step)
            self._write_particles(lane, simulation)
            self._duration[lane] = simulation.job.duration
            self._decided_below[lane] = HEAD_MARGIN * simulation.job.rim
            self._frames_done[lane] = simulation.frames_done
            self._still_frames[lane] = simulation.still_frames
            lanes = self._lanes_of(lane)
            self.state.squared_top_speed[lanes] = 0.0
            self.diagnostics.least_energy[lanes] = simulation.least_energy
            self.diagnostics.allowed_gain[lanes] = simulation.allowed_gain
            if simulation.recorded is not None:
                self.recorded[lane] = list(simulation.recorded)
            if simulation.particles is None:
                fresh.append(lane)
        if fresh:
            self._measure_start(fresh)

    def _write_particles(self, lane: int, simulation: Simulation) -> None:
        job, given = simulation.job, simulation.particles
        if given is None:
            rest = np.zeros_like(job.position)
            velocity = rest if job.velocity is None else job.velocity
            given = {"position": job.position.T, "velocity": velocity.T}
            self.particles_of(self.state.touched, lane)[:] = 0.0
            self.particles_of(self.state.squared_slack, lane)[:] = -1.0
        for name, values in given.items():
            slots = self.particles_of(getattr(self.state, name), lane)
            slots[..., : self.count] = values
            slots[..., self.count :] = values[..., -1:]
        self.state.most_near[:] = self.state.near_count.max(axis=1)

    def _measure_start(self, fresh: Sequence[int]) -> None:
        """Measure the energy at the start of the simulations in some lanes."""
        if self.kind == "liquid":
            self._find_density()
        found = self.diagnostics
        measure(self.state, self.parameters, 0.0, self.count, self.rows_are_one, found)
        for lane in fresh:
            job, energy = self.simulations[lane].job, float(found.energy[lane])
            found.least_energy[self._lanes_of(lane)] = energy
            # Cohesion's energy is below 0: two that cancel would allow no error at all.
            scale = max(abs(energy), job.gravity * float(job.position[:, 1].mean()))
            found.allowed_gain[self._lanes_of(lane)] = allowed_gain(
                scale, self.count, job.gravity, job.radius, job.sound_speed
            )

    def advance(self, solids: Solids, broad_phase: BroadPhase, stepping: Stepping) -> None:
        """Move all simulations on by a frame.

        Raises
        ------
        SimulationDivergedError
            If one breaks (`diagnostics`); its `number` is the job's.
        """
        step, steps = stepping.step, stepping.steps_per_frame
        self._advance((self.state, self.parameters, solids, broad_phase, step, steps))
        found = self.diagnostics
        sound = measure_and_check(
            self.state, self.parameters, stepping.step, self.count, self.rows_are_one, found
        )
        self._frames_done += 1
        if not sound:
            raise self._diverged(stepping)
        for lane, frames in self.recorded.items():
            frames.append(self._positions(self.state.position, lane))
        still = (np.sqrt(found.squared_speed) < REST_SPEED) | (found.head < self._decided_below)
        self._still_frames = np.where(still, self._still_frames + 1, 0)

    def take_finished(self, stepping: Stepping) -> list[tuple[int, Result]]:
        """Take out the simulations that are over; returns numbers of jobs and where they ended."""
        settled = self._still_frames >= REST_FRAMES
        time = self._frames_done * stepping.frame
        over = settled | (time >= self._duration - 1e-9)
        done = []
        for lane in [lane for lane in self.simulations if over[lane]]:
            end = self._end_of(lane, float(time[lane]), settled=bool(settled[lane]))
            done.append((self.simulations[lane].number, end))
            self._empty(lane)
        return done

    def take_all(self) -> list[Simulation]:
        """Take out all simulations, to be put into other blocks."""
        taken = []
        for lane, simulation in list(self.simulations.items()):
            particles = {
                name: self.particles_of(getattr(self.state, name), lane)[..., : self.count].copy()
                for name in self.state._fields
                if name not in _OF_A_BLOCK
            }
            taken.append(
                replace(
                    simulation,
                    particles=particles,
                    frames_done=int(self._frames_done[lane]),
                    still_frames=int(self._still_frames[lane]),
                    least_energy=float(self.diagnostics.least_energy[lane]),
                    allowed_gain=float(self.diagnostics.allowed_gain[lane]),
                    recorded=tuple(self.recorded[lane]) if lane in self.recorded else None,
                )
            )
            self._empty(lane)
        return taken

    def _empty(self, lane: int) -> None:
        del self.simulations[lane]
        self.recorded.pop(lane, None)
        self.parameters.scene[self._lanes_of(lane)] = -1

    def _positions(self, array: NDArray[np.float32], lane: int) -> NDArray[np.float32]:
        """Positions or velocities [count, 3] of one simulation, as a copy."""
        return np.ascontiguousarray(self.particles_of(array, lane)[:, : self.count].T)

    def _end_of(self, lane: int, time: float, *, settled: bool) -> Result:
        return Result(
            position=self._positions(self.state.position, lane),
            velocity=self._positions(self.state.velocity, lane),
            touched=self.particles_of(self.state.touched, lane)[: self.count].astype(bool),
            time=time,
            settled=settled,
            frames=np.stack(self.recorded[lane]) if lane in self.recorded else None,
        )

    def _diverged(self, stepping: Stepping) -> SimulationDivergedError:
        """What is wrong with the first broken simulation."""
        found = self.diagnostics
        broken = int(np.flatnonzero(found.verdict != SOUND)[0])
        verdict = found.verdict[broken]
        lane = 0 if self.rows_are_one else broken
        if verdict == NOT_FINITE:
            fault = "a speed is no finite number"
        elif verdict == OUTSIDE:
            fault = f"{found.outside[lane]:g} of {self.count} particles are not inside the box"
        elif verdict == GAINS_ENERGY:
            fault = (
                f"the liquid has gained {found.energy[lane] - found.least_energy[lane]:.3g} J/kg "
                f"of energy, where errors explain {found.allowed_gain[lane]:.3g} J/kg"
            )
        else:
            fault = (
                f"a particle has moved by more than its radius, "
                f"{self.parameters.radius[lane]:.3g} m, in one step"
            )
        return SimulationDivergedError(
            f"diverged after {self._frames_done[lane] * stepping.frame:.3g} s of its time: {fault};"
            f" {self._causes(stepping, lane)}",
            number=self.simulations[lane].number,
        )

    def _causes(self, stepping: Stepping, lane: int) -> str:
        """What it can come from, in words."""
        causes = [f"the time step {stepping.step:g} s is too long", "a particle wider than the box"]
        if self.kind == "liquid":
            causes.append("a contact radius above 0.5 spacings too large")
        if self.parameters.cohesion_factor[lane] > 0.0:
            causes.append("the liquid's cohesion too strong for that step")
        return f"{', '.join(causes[:-1])}, or {causes[-1]}"


class Lockstep(Block):
    """`LANES` simulations: row = particle, lane = simulation."""

    lanes, rows_are_one = LANES, False

    def __init__(self, count: int, kind: Kind) -> None:
        super().__init__(count, count, kind)
        self._pairs = empty_pairs(count if kind == "liquid" else 0)
        self._left = set(range(LANES))
        """Lanes whose particles are nobody's, and may be anywhere."""

    def particles_of(self, array: NDArray[Any], lane: int) -> NDArray[Any]:
        """View of a field of `State` for the simulation in a lane."""
        return array[..., lane]

    def _empty(self, lane: int) -> None:
        super()._empty(lane)
        self._left.add(lane)

    def _clear_empty_lanes(self) -> None:
        """Leave the particles of empty lanes far from one another and still.

        What is near in any lane costs time in all.
        """
        lanes = [lane for lane in self._left if lane not in self.simulations]
        self._left.clear()
        if not lanes:
            return
        harmless = empty_parameters()._replace(
            gravity=np.zeros(LANES, np.float32),
            width=np.full(LANES, 4.0 * (self.count + 1), np.float32),
        )
        for name in harmless._fields:
            getattr(self.parameters, name)[lanes] = getattr(harmless, name)[lanes]
        self.state.position[..., lanes] = 1.0
        self.state.position[0][..., lanes] = 4.0 * np.arange(self.count)[:, None] + 2.0
        self.state.velocity[..., lanes] = 0.0
        self.state.acceleration[..., lanes] = 0.0
        self.state.squared_slack[..., lanes] = -1.0

    def _find_density(self) -> None:
        self._clear_empty_lanes()
        sph.find_density(self.state, self.parameters, self._pairs)

    def _advance(self, frame: Frame) -> None:
        self._clear_empty_lanes()
        if self.kind == "marbles":
            rigid.advance(*frame)
        else:
            sph.advance(*frame, self._pairs)


class Single(Block):
    """One simulation: particle i in row i // LANES, lane i % LANES."""

    lanes, rows_are_one = 1, True

    def __init__(self, count: int, kind: Kind) -> None:
        super().__init__(count, -(-count // LANES), kind)

    def particles_of(self, array: NDArray[Any], lane: int) -> NDArray[Any]:
        """View of a field of `State` for the one simulation, copies of the last particle too."""
        return array.reshape(*array.shape[:-2], -1)


class SingleMarbles(Single):
    """One simulation of rigid spheres."""

    def __init__(self, count: int) -> None:
        super().__init__(count, "marbles")

    def _find_density(self) -> None:
        """Spheres have none."""

    def _advance(self, frame: Frame) -> None:
        rigid.advance_one(*frame, self.count)


class SingleLiquid(Single):
    """One simulation of a liquid, by clusters of its particles; threads can share it."""

    def __init__(self, count: int) -> None:
        super().__init__(count, "liquid")
        self._clusters = clusters.empty_clusters(count)
        self.helpers: list[Helper] = []
        """Threads that share the simulation."""
        self._joining: list[Helper] = []
        self._seconds_alone = np.inf
        self._slow_frames = 0

    def _find_density(self) -> None:
        clusters.find_density(self.state, self.parameters, self._clusters)

    def _advance(self, frame: Frame) -> None:
        state, rest = frame[0], frame[1:]
        members = 1 + len(self.helpers)
        self._clusters.arrived[0] = 0
        # Each notes the greatest speed of its own particles.
        speeds = np.zeros((members, LANES), np.float32)
        calls = [
            partial(
                clusters.advance_one, state._replace(squared_top_speed=speed), *rest,
                self._clusters, member, members,
            )
            for member, speed in enumerate(speeds)
        ]  # fmt: skip
        start = time.perf_counter()
        for helper, call in zip(self.helpers, calls[1:], strict=True):
            helper.begin(call)
        calls[0]()
        for helper in self.helpers:
            helper.wait()
        seconds = time.perf_counter() - start
        state.squared_top_speed[:] = speeds.max(axis=0)
        if members == 1:
            self._seconds_alone = min(self._seconds_alone, seconds)
        else:
            self._slow_frames += seconds > self._seconds_alone

    @property
    def wants_help(self) -> bool:
        """Whether a further thread would be worth its while.

        It isn't where other programs keep the processor from threads that the others wait for.
        """
        members = 1 + len(self.helpers) + len(self._joining)
        most = min(clusters.most_members(self.count), available_cores())
        return members < most and not self._is_slowed

    @property
    def _is_slowed(self) -> bool:
        return self._slow_frames >= _MOST_SLOW_FRAMES

    def join(self) -> Callable[[], None]:
        """Let another thread share the simulation, from the next frame on.

        Returns
        -------
        callable
            What that thread has to call; it returns when the help is over.
        """
        self._joining.append(helper := Helper())
        return helper.help

    def regroup(self, *, alone: bool) -> None:
        """Let in who has joined, or all helpers go; between two frames."""
        self.helpers += self._joining
        self._joining.clear()
        if alone or self._is_slowed:
            for helper in self.helpers:
                helper.let_go()
            self.helpers.clear()


_LANES_WORTH = {16: 7.0, 8: 3.7, 4: 2.2}
"""Measured, by the machine's lanes: in lockstep 7 simulations take as long as one after the other
with AVX-512, 3.7 with AVX2, 2.2 with SSE. From N = 15 to 200, of liquid and marbles, from 6.2 to
8.9, 3.5 to 4.2 and 2.0 to 2.5. (One by one, each pair is looked at twice; in lockstep, every pair
that is near in any lane.)"""

MOST_IN_LOCKSTEP = 300
"""Particles of a simulation in lockstep: lists of pairs, of all lanes, grow with their square."""


def lanes_worth(count: int) -> float:
    """Simulations from which on lockstep is faster than one after the other.

    Parameters
    ----------
    count
        Number of particles of each.
    """
    return _LANES_WORTH[LANES] if count <= MOST_IN_LOCKSTEP else np.inf
