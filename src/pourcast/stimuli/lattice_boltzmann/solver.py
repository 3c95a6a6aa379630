"""A liquid on a lattice: from a start, step by step, with a time step that follows its speed."""

import math
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.simd import LANES
from pourcast.errors import InputError, SimulationDivergedError
from pourcast.stimuli.lattice_boltzmann.cells import CutCells, Flow, new_cells, new_parts
from pourcast.stimuli.lattice_boltzmann.collide import SCRATCH_ROWS, update
from pourcast.stimuli.lattice_boltzmann.droplets import fly
from pourcast.stimuli.lattice_boltzmann.interface import convert, settle
from pourcast.stimuli.lattice_boltzmann.lattice import (
    FLUID,
    INTERFACE,
    N_DIRECTIONS,
    QUADRATIC,
    VELOCITY,
    WEIGHT,
)
from pourcast.stimuli.lattice_boltzmann.rescale import rescale

GRAVITY = 9.81
"""Standard gravity [m/s^2]."""

SUBLAYER = 11.81
"""Thickness of the viscous sublayer in wall units (Werner & Wengle 1991)."""

_MAGIC = 3.0 / 16.0
"""Product of both relaxation times, each less 1/2, with which walls stand half-way between cells
(Ginzburg, Verhaeghe & d'Humieres 2008, Commun. Comput. Phys. 3)."""
_LONGEST_RELAXATION = 5.0
"""Bound on the relaxation time: with it, momentum spreads over 1.7 cells a step. Steady flow does
not depend on it, thanks to `_MAGIC`; thick liquid follows a change some steps late."""
_EVERY = 16
"""Steps between looks at the liquid's speed."""
_LOST_SHARE = 1e-3
"""Share of its mass that a liquid may lose or gain by rounding: measured, 5e-7 in 4 s."""
_CAUTION = 0.85
"""Share of the longest step that is taken, so that another is not needed at once."""
_THREAD_WORTH = 2048
"""Cells that pay for another thread."""


@dataclass(frozen=True)
class LatticeSettings:
    """How a flow is computed.

    Parameters
    ----------
    courant
        Speed that the fastest liquid has at most [cells per step]; errors grow with its square.
    compressibility
        Bound on gravity [cells per step^2], as Blender's fluid solver had it: the share by which a
        layer of one cell is compressed by its weight is three times as much. Paper: 0.005.
    smagorinsky
        Constant of the sub-grid turbulence model.
    threads
        Worker threads; results don't depend on it.
    """

    courant: float = 0.15
    compressibility: float = 0.005
    smagorinsky: float = 0.1
    threads: int = 1

    def __post_init__(self) -> None:
        if not 0.0 < self.courant <= 0.25:
            raise InputError(f"courant must be in (0, 0.25], not {self.courant}")
        if not 0.0 < self.compressibility <= 0.05:
            raise InputError(f"compressibility must be in (0, 0.05], not {self.compressibility}")
        if not 0.0 <= self.smagorinsky < math.inf:
            raise InputError(f"smagorinsky must be at least 0, not {self.smagorinsky}")
        if self.threads < 1:
            raise InputError(f"threads must be at least 1, not {self.threads}")


@dataclass
class LatticeFlow:
    """A liquid on a lattice.

    Parameters
    ----------
    fill
        Share of each cell's room that liquid fills at the start, shape [nx, ny, nz].
    solid
        Which cells are solid, shape [nx, ny, nz]. Outside of the grid all is solid.
    cell
        Width of a cell [m].
    viscosity
        Kinematic viscosity [m^2/s].
    gravity
        Acceleration [m/s^2].
    adhesion
        Acceleration of liquid at a wall towards it [m/s^2].
    normal
        Direction across the surface of solid cells, shape [3, nx + 2, ny + 2, nz + 2], with the
        margin outside of the grid; by default that of the grid's walls.
    slip
        1 where walls let the liquid slip, 0 where they hold it; of all walls, or of each cell with
        the margin, shape [nx + 2, ny + 2, nz + 2]. Between, the wall moves with this share of the
        velocity of the liquid beside it: see `slip_of`.
    rough
        Which solid cells drag at liquid that slips along them as a turbulent boundary layer does,
        with the margin, shape [nx + 2, ny + 2, nz + 2]; none by default.
    cut
        Cells that are solid in part; none by default.
    periodic
        Axes along which the grid goes on at its other end. Meant for grids that are full along
        them: a free surface that moves across such a seam loses mass, 1e-4 to 5e-3 of it was seen.
        No stimulus has one.
    velocity
        Of the liquid at the start [m/s], shape [3, nx, ny, nz]; at rest by default.
    time_step
        A fixed time step [s]; by default it follows the liquid's speed.
    settings
        How it is computed.
    name
        What errors call it.

    Raises
    ------
    InputError
        If a value is not finite or out of its range.
    """

    fill: NDArray[np.float64]
    solid: NDArray[np.bool_]
    cell: float
    viscosity: float
    gravity: Sequence[float] = (0.0, -GRAVITY, 0.0)
    adhesion: float = 0.0
    normal: NDArray[np.float32] | None = None
    slip: float | NDArray[np.float32] = 1.0
    rough: NDArray[np.bool_] | None = None
    cut: CutCells | None = None
    periodic: tuple[bool, bool, bool] = (False, False, False)
    velocity: NDArray[np.float64] | None = None
    time_step: float | None = None
    settings: LatticeSettings = LatticeSettings()
    name: str = "liquid on a lattice"

    time: float = field(default=0.0, init=False)
    """Since the start [s]."""
    steps: int = field(default=0, init=False)
    updates: int = field(default=0, init=False)
    """Cells stepped so far."""
    dt: float = field(init=False)
    """The current time step [s]."""

    def __post_init__(self) -> None:
        self._check_input()
        self.shape = self.solid.shape
        padded = np.pad(self.solid, 1, constant_values=True)
        normal = wall_normals(self.shape, self.periodic) if self.normal is None else self.normal
        slip = np.broadcast_to(np.asarray(self.slip, dtype=np.float32), padded.shape)
        rough = np.zeros_like(padded) if self.rough is None else self.rough
        self._cells = new_cells(padded, normal, slip, self._fallen(), rough, self.cut)
        self._parts = new_parts(padded.size)
        self._here = 0
        self._scratch = np.zeros((self.settings.threads, SCRATCH_ROWS, LANES), dtype=np.float32)
        fastest = 0.0
        if self.velocity is not None:
            fastest = float(np.linalg.norm(self.velocity, axis=0).max())
        self.dt = self.time_step or self._step_for(fastest)
        self._fill_cells()
        self._flow = self._lattice_flow()
        self._start_mass = self.mass

    def _check_input(self) -> None:
        ranges = {
            "cell": (self.cell, self.cell > 0.0, "more than 0 m"),
            "viscosity": (self.viscosity, self.viscosity >= 0.0, "at least 0 m^2/s"),
            "slip": (float(np.mean(self.slip)), bool(np.all(_within_1(self.slip))), "0 to 1"),
            "adhesion": (self.adhesion, self.adhesion >= 0.0, "at least 0 m/s^2"),
            "gravity": (math.hypot(*self.gravity), True, "finite numbers [m/s^2]"),
            "fill": (float(np.sum(self.fill)), True, "finite shares of the cells"),
        }
        if self.velocity is not None:
            total = float(np.abs(self.velocity).sum())
            ranges["velocity"] = (total, True, "finite numbers [m/s]")
        if self.time_step is not None:
            ranges["time_step"] = (self.time_step, self.time_step > 0.0, "more than 0 s")
        for field_name, (value, right, expected) in ranges.items():
            if not (right and math.isfinite(value)):
                raise InputError(f"{self.name}: {field_name}: expected {expected}, found {value}")

    @property
    def _longest_step(self) -> float:
        """Longest time step [s] that compressibility and viscosity allow."""
        pull = math.hypot(*self.gravity)
        steps = [3e-2]
        if pull > 0.0:
            steps.append(math.sqrt(self.settings.compressibility * self.cell / pull))
        if self.viscosity > 0.0:
            steps.append((_LONGEST_RELAXATION - 0.5) / 3.0 * self.cell**2 / self.viscosity)
        return min(steps)

    def _step_for(self, speed: float) -> float:
        """Time step [s] at which a speed [m/s] is as fast as settings allow."""
        reached = speed + math.hypot(*self.gravity) * _EVERY * self._longest_step
        return min(self._longest_step, self.settings.courant * self.cell / max(reached, 1e-9))

    def _lattice_flow(self) -> Flow:
        pull_x, pull_y, pull_z = (g * self.dt**2 / self.cell for g in self.gravity)
        viscosity = self.viscosity * self.dt / self.cell**2
        return Flow(
            gravity_x=pull_x,
            gravity_y=pull_y,
            gravity_z=pull_z,
            head=2.0 * math.hypot(pull_x, pull_y, pull_z),
            adhesion=self.adhesion * self.dt**2 / self.cell,
            viscosity=viscosity,
            relaxation_time=0.5 + 3.0 * viscosity,
            odd_kept=_odd_kept(3.0 * viscosity),
            smagorinsky=18.0 * math.sqrt(2.0) * self.settings.smagorinsky**2,
        )

    def _fallen(self) -> NDArray[np.float32]:
        """How far [cells] each cell lies below the highest liquid; without bound if it moves."""
        pull = np.array(self.gravity)
        padded = tuple(side + 2 for side in self.shape)
        if self.velocity is not None or not pull.any() or any(self.periodic):
            return np.full(padded, np.inf, dtype=np.float32)
        down = np.tensordot(pull / np.linalg.norm(pull), np.indices(padded), axes=1)
        top = down[1:-1, 1:-1, 1:-1][self.fill > 0.0].min(initial=np.inf)
        fallen: NDArray[np.float32] = np.maximum(down - top, 0.0).astype(np.float32)
        return fallen

    def _fill_cells(self) -> None:
        """Put the liquid in: full cells next to empty ones are the surface."""
        fill = np.pad(np.where(self.solid, 0.0, np.clip(self.fill, 0.0, 1.0)), 1)
        fill[fill < 1e-3] = 0.0
        empty = np.pad(~self.solid, 1) & (fill == 0.0)
        beside = np.zeros_like(empty)
        for shift in VELOCITY[1:]:
            beside |= np.roll(empty, tuple(shift), axis=(0, 1, 2))
        cells, parts = self._cells, self._parts
        partly = (fill > 0.0) & ((fill < 1.0) | beside)
        cells.flags[partly.ravel()] = INTERFACE
        cells.flags[((fill == 1.0) & ~beside).ravel()] = FLUID
        active = np.flatnonzero(fill.ravel() > 0.0)
        parts.active[: len(active)] = active
        parts.counts[0] = len(active)
        cells.mass[active] = fill.ravel()[active] * cells.room[active]
        if self.velocity is not None:
            moving = np.pad(self.velocity, ((0, 0), (1, 1), (1, 1), (1, 1))) * self.dt / self.cell
            cells.velocity[:] = moving.reshape(3, -1)
        # As after a step, whose second half of the push is still to be felt.
        gravity = np.array(self._lattice_flow()[:3])[:, None]
        u = cells.velocity[:, active].astype(np.float64) + 0.5 * gravity
        second = u[:, None] * u[None]
        shape = 3.0 * VELOCITY @ u + 4.5 * np.einsum("iab,abn->in", QUADRATIC, second)
        cells.populations[0, active] = (WEIGHT[:, None] * shape).T
        settle(cells, parts)

    def advance(self, until: float) -> None:
        """Let the liquid flow until a time [s] since the start, or a step beyond it.

        Raises
        ------
        SimulationDivergedError
            If a speed is no finite number, or the liquid's mass is not what it was.
        """
        with ThreadPoolExecutor(self.settings.threads) as pool:
            while self.time < until - 1e-9:
                # Neighbours side by side in memory are read faster.
                self.active.sort()
                count = min(_EVERY, math.ceil((until - self.time) / self.dt - 1e-9))
                for _ in range(count):
                    self._step(pool)
                self.time += count * self.dt
                self.steps += count
                top_speed = self.top_speed
                self._check_sound(top_speed)
                if self.time_step is None:
                    self._choose_step(top_speed)

    def _check_sound(self, top_speed: float) -> None:
        mass = self.mass
        if not math.isfinite(top_speed):
            fault = "a speed is no finite number"
        elif not abs(mass - self._start_mass) <= _LOST_SHARE * self._start_mass:
            fault = f"its volume was {self._start_mass:g} m^3, and is {mass:g} m^3"
        else:
            return
        raise SimulationDivergedError(
            f"{self.name}: diverged after {self.time:.3g} s of its time: {fault} (cells of "
            f"{self.cell:g} m, time step {self.dt:g} s, viscosity {self.viscosity:g} m^2/s, "
            f"{self.settings})"
        )

    def _step(self, pool: Executor) -> None:
        cells, parts, flow = self._cells, self._parts, self._flow
        self._wrap()
        count = int(parts.counts[0])
        threads = max(1, min(self.settings.threads, count // _THREAD_WORTH))
        bounds = np.linspace(0, count, threads + 1).astype(int)
        bounds[1:-1] -= bounds[1:-1] % LANES

        def part(k: int) -> None:
            first, last = int(bounds[k]), int(bounds[k + 1])
            update(first, last, parts.active, cells, self._here, self._scratch[k], flow)

        if threads == 1:
            part(0)
        else:
            list(pool.map(part, range(threads)))
        self._here = 1 - self._here
        fly(cells, parts, self._here, flow)
        convert(cells, parts, self._here, flow)
        self.updates += count

    def _wrap(self) -> None:
        """Copy what is at one end of a periodic axis to the margin at the other."""
        shape = tuple(side + 2 for side in self.shape)
        flags = self._cells.flags.reshape(shape)
        populations = self._cells.populations[self._here].reshape(*shape, N_DIRECTIONS)
        for axis in np.flatnonzero(self.periodic):
            for grid in (flags, populations):
                ends = np.moveaxis(grid, axis, 0)
                ends[0], ends[-1] = ends[-2], ends[1]

    def _choose_step(self, top_speed: float) -> None:
        """Take another time step if the liquid has become too fast, or much slower."""
        best = self._step_for(top_speed)
        if self.dt <= best <= self.dt / _CAUTION**2:
            return
        wanted = _CAUTION * best  # with room to become faster
        ratio, before = wanted / self.dt, self._flow
        self.dt = wanted
        self._flow = self._lattice_flow()
        rescale(self._cells, self._parts, self._here, ratio, before, self._flow)

    @property
    def active(self) -> NDArray[np.int32]:
        """The cells that hold liquid, by their place in the padded grid."""
        return self._parts.active[: self._parts.counts[0]]  # type: ignore[no-any-return]

    @property
    def top_speed(self) -> float:
        """Speed of the fastest liquid [m/s]."""
        parts, scale = self._parts, self.cell / self.dt
        velocity = self._cells.velocity[:, self.active]
        flying = parts.droplets[3:6, : parts.counts[1]]
        squares = np.concatenate([(velocity**2).sum(axis=0), (flying**2).sum(axis=0), [0.0]])
        return float(np.sqrt(squares.max())) * scale

    @property
    def mass(self) -> float:
        """Volume of the liquid at rest density [m^3]."""
        parts = self._parts
        held = self._cells.mass[self.active].sum() + parts.droplets[6, : parts.counts[1]].sum()
        return float(held + parts.owed[0]) * self.cell**3

    def grid(self, name: str) -> NDArray[np.float64]:
        """A field of the cells in SI units, without the margin.

        Parameters
        ----------
        name
            `fill` and `mass` (share of a cell), `density` (over that at rest), or `velocity`.
        """
        values = np.array(getattr(self._cells, name), dtype=np.float64)
        liquid = np.zeros(values.shape[-1], dtype=bool)
        liquid[self.active] = True
        values[..., ~liquid] = 0.0
        padded = values.reshape(*values.shape[:-1], *(side + 2 for side in self.shape))
        scale = self.cell / self.dt if name == "velocity" else 1.0
        return padded[..., 1:-1, 1:-1, 1:-1] * scale

    @property
    def droplets(self) -> NDArray[np.float64]:
        """Position in the grid [m], velocity [m/s] and volume [m^3], shape [7, count]."""
        found = self._parts.droplets[:, : self._parts.counts[1]].copy()
        found[:3] = (found[:3] - 1.0) * self.cell
        found[3:6] *= self.cell / self.dt
        found[6] *= self.cell**3
        return found  # type: ignore[no-any-return]


def _odd_kept(excess: float) -> float:
    """Share of odd moments that a step keeps, for a relaxation time of 1/2 + `excess`.

    Thin liquid loses them at once, which is stable; thick liquid keeps the magic product.
    """
    return 1.0 - 1.0 / (0.5 + _MAGIC / max(excess, 2.0 * _MAGIC))


def slip_of(length: float, cell: float) -> float:
    """Share of the velocity beside it with which a wall moves, for Navier's slip length.

    Half a cell from a wall, a speed that vanishes `length` behind it is (length + cell / 2) times
    the shear; at the wall it is length times the shear.

    Parameters
    ----------
    length
        Slip length [m], at least 0.
    cell
        Width of a cell [m].
    """
    return length / (length + 0.5 * cell)


def _within_1(values: float | NDArray[np.float32]) -> NDArray[np.bool_]:
    return (np.asarray(values) >= 0.0) & (np.asarray(values) <= 1.0)


def wall_normals(
    shape: tuple[int, ...], periodic: tuple[bool, bool, bool] = (False, False, False)
) -> NDArray[np.float32]:
    """Directions across the walls of a grid, for the margin around it.

    Parameters
    ----------
    shape
        Of the grid.
    periodic
        Axes along which there are no walls.

    Returns
    -------
    ndarray
        Shape [3, nx + 2, ny + 2, nz + 2]; slanted in edges and corners, 0 inside.
    """
    normal = np.zeros((3, *(side + 2 for side in shape)), dtype=np.float32)
    for axis in np.flatnonzero(~np.array(periodic)):
        ends = np.moveaxis(normal[axis], axis, 0)
        ends[0], ends[-1] = 1.0, -1.0
    normal /= np.maximum(np.linalg.norm(normal, axis=0), 1.0)
    return normal
