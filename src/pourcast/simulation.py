"""From scenes to the end of a pour: scenes and liquids in, judgments and positions out.

This is the only place where scenes become the engine's arrays.
"""

import threading
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pourcast.engine.batch import Job, Result, Stepping, run_batch
from pourcast.engine.compile import digest_of_sources
from pourcast.engine.contact import TOUCH_SKIN
from pourcast.engine.packing import (
    SUPPORT_IN_SPACINGS,
    pack_cylinder,
    reference_density,
    spacing_of,
)
from pourcast.engine.solids import Solids, obstacle_distances, pack_solids
from pourcast.errors import InputError
from pourcast.liquid import Liquid
from pourcast.scene import Scene

GRAVITY = 9.81
"""Acceleration of free fall [m/s^2]."""

MAX_PARTICLES = 2000

Kind = Literal["liquid", "marbles"]
"""SPH liquid, or rigid spheres."""

Progress = Callable[[int, int], None]
"""Called with the number of simulations done and the number in all."""


@cache
def engine_version() -> str:
    """Name of the state of all code that a pour's outcome depends on.

    Results of two versions must not be mixed; that of a release never changes.
    """
    package = Path(__file__).parent
    files = ("simulation.py", "scene.py", "liquid.py")
    return digest_of_sources([*package.glob("engine/*.py"), *(package / name for name in files)])


@dataclass(frozen=True)
class EngineSettings:
    """How we compute. None of it is in the world, and none in anybody's head.

    Parameters
    ----------
    step
        Longest time step [s]. It is shortened so that a whole number of steps
        makes a frame, and by `courant`. The paper's was 0.0002; twice as long
        steps change judgments by no more than a start moved by 0.1 mm does
        (`docs/explanation/physics.md`).
    marble_step
        The same for rigid spheres [s].
    sound_speed
        Artificial speed of sound c [m/s]; the fastest flow (5 m/s) should stay
        well below it.
    support_in_spacings
        Support radius of the kernel over the particle spacing.
    courant
        The step stays below ``courant * h / (c (1 + 0.6 alpha))`` (Monaghan
        1992, section 5.3), h being half the support radius.
    frame_rate
        Frames per simulated second: of films, and of the test for rest.
    max_duration
        Cap on the simulated time [s].
    """

    step: float = 4e-4
    marble_step: float = 5e-4
    sound_speed: float = 30.0
    support_in_spacings: float = SUPPORT_IN_SPACINGS
    courant: float = 0.4
    frame_rate: float = 30.0
    max_duration: float = 10.0

    def stepping(self, kind: Kind, spacing: float, viscosity_alpha: float) -> Stepping:
        """Step and number of steps a frame for particles of a given spacing [m]."""
        step = self.marble_step
        if kind == "liquid":
            smoothing_length = 0.5 * self.support_in_spacings * spacing
            signal_speed = self.sound_speed * (1.0 + 0.6 * viscosity_alpha)
            step = min(self.step, self.courant * smoothing_length / signal_speed)
        steps = int(np.ceil(1.0 / (self.frame_rate * step) - 1e-9))
        return Stepping(step=1.0 / (self.frame_rate * steps), steps_per_frame=steps)


def spacing_in(scene: Scene, n_particles: int) -> float:
    """Particle spacing [m] of a scene's liquid."""
    return spacing_of(n_particles, scene.liquid.diameter / 2, scene.box.depth)


@dataclass(frozen=True)
class Pour:
    """One simulation to be run.

    Parameters
    ----------
    scene
        Where.
    liquid
        What flows. Marbles take only its adhesion.
    n_particles
        Number of particles, 1 to 2000.
    damping_zeta
        Damping zeta [1/s].
    offset
        Displacement of the liquid's start in x and y [m].
    kind
        SPH liquid or rigid marbles.
    """

    scene: Scene
    liquid: Liquid
    n_particles: int = 50
    damping_zeta: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)
    kind: Kind = "liquid"

    @property
    def spacing(self) -> float:
        """Particle spacing [m]."""
        return spacing_in(self.scene, self.n_particles)


@dataclass(frozen=True)
class Outcome:
    """How a pour ended."""

    judgment: float
    """Share of the particles that the goal holds, 0..1."""
    stranded: float
    """Share above the goal's rim or still touching an obstacle."""
    touched: float
    """Share that ever met an obstacle."""
    time: float
    """Simulated time [s]."""
    settled: bool
    """Whether it ended by itself, before the cap."""
    position: NDArray[np.float32]
    """Positions at the end [m], shape [n_particles, 3]."""
    frames: NDArray[np.float32] | None
    """Positions at `EngineSettings.frame_rate` [m], shape [frame_count, n_particles, 3]."""


def simulate(
    pours: Sequence[Pour],
    *,
    settings: EngineSettings | None = None,
    record: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> list[Outcome]:
    """Run simulations, in lockstep batches, on all cores.

    Parameters
    ----------
    pours
        What to run. Scenes may repeat.
    settings
        How to compute.
    record
        Keep the positions of every frame.
    threads
        Worker threads; all cores by default. The result has the same bits for
        any number, and for any company in which a pour is run.
    progress
        Called after each simulation.

    Returns
    -------
    list of Outcome
        In the order of `pours`.

    Raises
    ------
    InputError
        If a number of particles is out of range.
    """
    settings = settings or EngineSettings()
    groups: dict[tuple[Kind, int, Stepping], list[int]] = defaultdict(list)
    for index, pour in enumerate(pours):
        if not 1 <= pour.n_particles <= MAX_PARTICLES:
            raise InputError(
                f"n_particles must be from 1 to {MAX_PARTICLES}, not {pour.n_particles}"
            )
        stepping = settings.stepping(pour.kind, pour.spacing, pour.liquid.viscosity_alpha)
        groups[pour.kind, pour.n_particles, stepping].append(index)
    done, lock = 0, threading.Lock()

    def count_one(_index: int, _result: Result) -> None:
        nonlocal done
        with lock:
            done += 1
            if progress is not None:
                progress(done, len(pours))

    outcomes: dict[int, Outcome] = {}
    for (kind, _, stepping), members in groups.items():
        chosen = [pours[index] for index in members]
        solids, scene_index = _solids_of(chosen)
        jobs = [_job(p, s, settings) for p, s in zip(chosen, scene_index, strict=True)]
        results = run_batch(
            jobs,
            solids,
            stepping,
            kind=kind,
            record=record,
            threads=threads,
            on_done=count_one,
        )
        for index, job, result in zip(members, jobs, results, strict=True):
            outcomes[index] = _outcome(pours[index], job, result, solids)
    return [outcomes[index] for index in range(len(pours))]


def _solids_of(pours: Sequence[Pour]) -> tuple[Solids, list[int]]:
    """Polygons of all different scenes, and each pour's scene among them."""
    place: dict[int, int] = {}
    scenes: list[Scene] = []
    indices = []
    for pour in pours:
        key = id(pour.scene)
        if key not in place:
            place[key] = len(scenes)
            scenes.append(pour.scene)
        indices.append(place[key])
    polygons = [
        [(np.array(p), False) for p in scene.obstacles]
        + [(np.array(p), True) for p in scene.goal.solids]
        for scene in scenes
    ]
    return pack_solids(polygons), indices


def _job(pour: Pour, scene_index: int, settings: EngineSettings) -> Job:
    box, start = pour.scene.box, pour.scene.liquid
    radius, support = start.diameter / 2, settings.support_in_spacings * pour.spacing
    centre = (start.centre[0] + pour.offset[0], start.centre[1] + pour.offset[1])
    origin = pack_cylinder(pour.n_particles, (0.0, 0.0), radius, box.depth)
    position = pack_cylinder(pour.n_particles, centre, radius, box.depth)
    return Job(
        position=position,
        scene=scene_index,
        width=box.width,
        height=box.height,
        depth=box.depth,
        radius=0.5 * pour.spacing,
        support_radius=support,
        reference_density=reference_density(origin, support, box.depth),
        sound_speed=settings.sound_speed,
        viscosity_alpha=pour.liquid.viscosity_alpha,
        damping=pour.damping_zeta,
        duration=settings.max_duration,
        gravity=GRAVITY,
        adhesion_normal=pour.liquid.adhesion_normal,
        adhesion_tangential=pour.liquid.adhesion_tangential,
        rim=pour.scene.goal.rim,
    )


def _outcome(pour: Pour, job: Job, result: Result, solids: Solids) -> Outcome:
    goal, place = pour.scene.goal, result.position.astype(np.float64)
    held = [goal.holds(x, y) for x, y in place[:, :2]]
    gap = obstacle_distances(place[:, :2], job.scene, solids)
    on_obstacle = gap < job.radius * (1.0 + TOUCH_SKIN)
    return Outcome(
        judgment=float(np.mean(held)),
        stranded=float(np.mean(on_obstacle | (place[:, 1] > goal.rim))),
        touched=float(np.mean(result.touched)),
        time=result.time,
        settled=result.settled,
        position=result.position,
        frames=result.frames,
    )
