"""Small things that tests are made of: scenes, blocks of particles, jobs, plain-loop oracles."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_simpson

from pourcast.engine import sph
from pourcast.engine.batch import run_batch
from pourcast.engine.block import fill_lane
from pourcast.engine.cohesion import cohesion_factor
from pourcast.engine.job import Job, Result, Stepping
from pourcast.engine.pairs import empty_pairs, list_pairs
from pourcast.engine.polygons import Solids, pack_solids
from pourcast.engine.smoothing import GRADIENT_FACTOR
from pourcast.engine.state import LaneParameters, State, empty_parameters, empty_state
from pourcast.scenes.families.shapes import ShapesFamily
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene import LiquidStart, Scene
from pourcast.simulation.settings import EngineSettings
from pourcast.study.selection import drawn_scene

Array = npt.NDArray[np.float64]

NO_SOLIDS = pack_solids([[]])


OPEN_CHOICES = {
    "cohesion": (replace(HONEY_EXP1, cohesion=0.06), EngineSettings()),
    "tension": (replace(HONEY_EXP1, cohesion=0.0, tension=0.02), EngineSettings()),
    "viscosity of all pairs": (HONEY_EXP1, EngineSettings(viscous_pairs="all")),
    "contact": (HONEY_EXP1, EngineSettings(contact_radius=0.6, contact_layer=0.6)),
    "damping": (WATER, EngineSettings(damping_scale=0.5)),
    "slab": (WATER, EngineSettings(dimensions=2, contact_radius=0.5)),
    "sound and support": (WATER, EngineSettings(sound_speed=20, support_in_spacings=1.9)),
}
"""What the paper leaves open: a liquid and settings each."""


def ramp_scene() -> Scene:
    return Scene(
        id="ramp",
        obstacles=(((0.25, 0.7), (0.65, 0.7), (0.25, 0.95)),),
        liquid=LiquidStart(centre=(0.4, 1.3)),
        goal=Basins(),
    )


def random_scenes(count: int, seed: int = 0) -> list[Scene]:
    """Unfiltered draws of both families, half and half."""
    scenes: list[Scene] = []
    index = 0
    while len(scenes) < count:
        for family in (VoronoiFamily(), ShapesFamily()):
            scene = drawn_scene(family, seed, index)
            if scene is not None:
                scenes.append(scene)
        index += 1
    return scenes[:count]


def block(shape: tuple[int, int, int], spacing: float) -> npt.NDArray[np.float32]:
    """A regular block of particles, half a spacing off the walls x = y = z = 0."""
    cells = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1)
    return ((cells.reshape(-1, 3) + 0.5) * spacing).astype(np.float32)


def lattice_density(support_in_spacings: float) -> float:
    """Kernel sum inside an endless cubic lattice."""
    reach = int(np.ceil(support_in_spacings))
    axis = np.arange(-reach, reach + 1)
    gaps = np.sqrt(sum(g**2 for g in np.meshgrid(axis, axis, axis)))
    near = np.maximum(1.0 - gaps / support_in_spacings, 0.0)
    return float(np.sum(near**4 * (5.0 - 4.0 * near)))


def job(position: npt.NDArray[np.float32], **changes: object) -> Job:
    """A job in a box of 1 m x 1.5 m x 0.148 m with the paper's particles at N = 50."""
    values = {
        "position": np.asarray(position, np.float32),
        "scene": 0,
        "width": 1.0,
        "height": 1.5,
        "depth": 0.148,
        "radius": 0.0185,
        "contact_layer": 0.00185,
        "support_radius": 0.085,
        "reference_density": 3.7,
        "sound_speed": 30.0,
        "viscosity_alpha": 0.0,
        "damping": 0.0,
        "duration": 1.0,
    }
    return Job(**(values | changes))  # type: ignore[arg-type]


def run_one(one: Job, step: float, duration: float, solids: Solids = NO_SOLIDS, **kwargs) -> Result:
    """Run a job for exactly `duration`, as a single frame, in which it can't be found at rest."""
    steps = round(duration / step)
    jobs = [Job(**{**vars(one), "duration": steps * step})]
    return run_batch(jobs, solids, Stepping(step, steps), threads=1, **kwargs)[0]


def loaded_block(jobs: list[Job], step: float) -> tuple[State, LaneParameters]:
    """State and lanes of up to `LANES` jobs, ready for the kernels."""
    state, lanes = empty_state(len(jobs[0].position)), empty_parameters()
    for lane, one in enumerate(jobs):
        state.position[:, :, lane] = one.position.T
        if one.velocity is not None:
            state.velocity[:, :, lane] = one.velocity.T
        fill_lane(lanes, lane, one, step)
    return state, lanes


def forces_of(one: Job) -> tuple[Array, Array]:
    """Accelerations [count, 3] and densities over rest density by the lockstep kernels."""
    state, lanes = loaded_block([one], 1e-4)
    pairs = empty_pairs(len(one.position))
    list_pairs(state, lanes, pairs)
    sph.find_forces(state, lanes, pairs)
    return state.acceleration[:, :, 0].T.astype(float), state.density[:, 0].astype(float)


def oracle_density(one: Job) -> Array:
    """Densities over rest density by plain loops in float64, mirror images included."""
    place, support = one.position.astype(float), one.support_radius

    def share(gap: float) -> float:
        near = max(1.0 - gap / support, 0.0)
        return near**4 * (5.0 - 4.0 * near)

    sums = np.zeros(len(place))
    for i, (x, y, z) in enumerate(place):
        for other in place:
            sums[i] += share(float(np.linalg.norm(place[i] - other)))
        walls = (min(x, one.width - x), min(y, one.ceiling - y), min(z, one.depth - z))
        sums[i] += sum(share(2.0 * gap) for gap in walls)
    return sums / one.reference_density


def oracle_forces(one: Job) -> Array:
    """Accelerations by plain loops in float64: Monaghan (1992), the formulas of `engine.sph`."""
    place, support = one.position.astype(float), one.support_radius
    speed = np.zeros_like(place) if one.velocity is None else one.velocity.astype(float)
    density = oracle_density(one)
    pressure = one.sound_speed**2 * np.maximum(density - 1.0, 0.0) / density**2
    gradient = GRADIENT_FACTOR / (support**2 * one.reference_density)
    h = support / 2
    rate = np.zeros_like(place)
    for i in range(len(place)):
        for j in range(len(place)):
            if i == j:
                continue
            apart = place[i] - place[j]
            near = max(1.0 - np.linalg.norm(apart) / support, 0.0)
            approach = min(float(apart @ (speed[i] - speed[j])), 0.0)
            mean = (density[i] + density[j]) / 2
            mu = h * approach / (apart @ apart + 0.01 * h**2)
            viscous = -one.viscosity_alpha * one.sound_speed * mu / mean
            rate[i] += gradient * (pressure[i] + pressure[j] + viscous) * near**3 * apart
        for axis, size in ((0, one.width), (1, one.ceiling), (2, one.depth)):
            for gap, side in ((place[i, axis], 1.0), (size - place[i, axis], -1.0)):
                if gap == min(place[i, axis], size - place[i, axis]):
                    near = max(1.0 - 2.0 * gap / support, 0.0)
                    rate[i, axis] += side * gradient * 4.0 * pressure[i] * gap * near**3
    return rate


def cohesive_energy(one: Job, position: Array) -> float:
    """Energy of all pairs over a particle's mass [J/kg]: work against the force, by Simpson."""
    gaps = np.linalg.norm(position[:, None] - position[None], axis=2)[
        np.triu_indices(len(position), 1)
    ]
    r = np.linspace(0.0, one.support_radius, 2001)
    slope = (1.0 - r / one.support_radius) ** 3
    factor = cohesion_factor(one.cohesion, one.spacing, one.support_radius)
    neutral = (1.0 - one.spacing / one.support_radius) ** 3
    force = factor * (slope - neutral) * slope * r
    work = cumulative_simpson(force, x=r, initial=0.0)
    return float(np.sum(np.interp(gaps, r, work[-1] - work, right=0.0)))


def energy_of(one: Job, position: Array, velocity: Array) -> float:
    """Kinetic, potential and elastic energy per particle mass [J/kg], by plain arrays.

    The elastic energy of p = c^2 rho0 (d - 1), d = rho / rho0 >= 1 - tension, is
    c^2 (ln d + 1 / d - 1); below, pressure is constant. That of cohesion is by quadrature.
    """
    moved = Job(**{**vars(one), "position": position.astype(np.float32)})
    density = forces_of(moved)[1]
    followed = np.maximum(density, 1.0 - one.tension)
    elastic = np.log(followed) + 1.0 / followed - 1.0
    elastic += one.tension * (1.0 / density - 1.0 / followed)
    elastic *= one.sound_speed**2
    elastic += cohesive_energy(one, position) / len(position)
    kinetic = 0.5 * np.sum(velocity.astype(float) ** 2, axis=1)
    return float(np.mean(kinetic + one.gravity * position[:, 1] + elastic))
