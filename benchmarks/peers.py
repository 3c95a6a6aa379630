"""The same work on general engines: Warp, Taichi, JAX, SPlisHSPlasH; MuJoCo for marbles.

They are given less to do than ours: the liquid meets the walls only, no
polygons; and MuJoCo takes steps of 1 ms. A batch runs on one core where they let us
say so (Warp's CPU device is serial; JAX takes what it wants). In Warp and Taichi a thread
takes one simulation through all its steps: nothing is launched at every step. A peer that
is not installed is left out: ``pip install -e '.[peers]'``.
"""

import time
from collections.abc import Callable

import numpy as np

from benchmarks import splishsplash
from pourcast.engine.block import fill_lane
from pourcast.engine.job import Job
from pourcast.engine.state import empty_parameters
from pourcast.sweep.bench import DURATION, PAPER_STEP, undamped_jobs

STEPS = round(DURATION / PAPER_STEP)
MARBLE_STEP = 1e-3

_MEASURED_PAIRS = 1e7
"""Pairs, or thereabouts, that a run looks at: a fraction of a second."""
_RUNS = 3

Seconds = Callable[[int, int], float]
"""Seconds that a simulation of `DURATION` takes, by number of particles and of simulations at
once; without what is compiled or loaded at the start."""

Peer = tuple[str, Seconds]
"""The module that a peer needs, and what it takes."""


def constants(job: Job) -> dict[str, float]:
    """Factors of the pair forces, the engine's own."""
    lanes = empty_parameters()
    fill_lane(lanes, 0, job, PAPER_STEP)
    fields = {
        "inverse": lanes.inverse_support,
        "rest": lanes.reference_density,
        "push": lanes.pressure_factor,
        "friction": lanes.viscosity_factor,
        "least": lanes.separation_floor,
        "radius": lanes.radius,
    }
    return {name: float(field[0]) for name, field in fields.items()}


def measured_steps(count: int, batch: int) -> int:
    """Number of steps that a measurement takes."""
    return int(np.clip(_MEASURED_PAIRS / (batch * count**2), 5, STEPS))


def timed(run: Callable[[int], None], count: int, batch: int) -> float:
    """Seconds of all steps of a simulation, from those that some take, once warm: the least."""
    steps = measured_steps(count, batch)
    run(steps)
    taken = []
    for _ in range(_RUNS):
        start = time.perf_counter()
        run(steps)
        taken.append(time.perf_counter() - start)
    return min(taken) / steps * STEPS / batch


def warp_seconds(count: int, batch: int) -> float:
    """What a simulation takes in NVIDIA Warp on the CPU."""
    import warp as wp

    wp.config.quiet = True
    job = undamped_jobs(count)[0]
    c = constants(job)
    inverse, rest, push_factor = wp.float32(c["inverse"]), c["rest"], c["push"]
    friction_factor, least, radius = c["friction"], c["least"], c["radius"]
    n, dt = count, PAPER_STEP

    @wp.kernel
    def advance(
        x: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        v: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        rate: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        density: wp.array(dtype=float),  # type: ignore[valid-type]
        steps: int,
    ):
        first = wp.tid() * n
        for _ in range(steps):
            for k in range(first, first + n):
                weights = float(0.0)  # noqa: UP018 (a variable in Warp, where a literal is a constant)
                for j in range(first, first + n):
                    t = wp.max(1.0 - wp.length(x[k] - x[j]) * inverse, 0.0)
                    weights += t * t * t * t * (5.0 - 4.0 * t)
                density[k] = weights / rest
            for k in range(first, first + n):
                total = wp.vec3(0.0, -9.81, 0.0)
                dk = density[k]
                pk = wp.max(dk - 1.0, 0.0) / (dk * dk)
                for j in range(first, first + n):
                    r = x[k] - x[j]
                    r2 = wp.dot(r, r)
                    t = wp.max(1.0 - wp.sqrt(r2) * inverse, 0.0)
                    dj = density[j]
                    pj = wp.max(dj - 1.0, 0.0) / (dj * dj)
                    approach = wp.min(wp.dot(v[k] - v[j], r), 0.0)
                    friction = approach / ((r2 + least) * (dk + dj))
                    total += (push_factor * (pk + pj) - friction_factor * friction) * t * t * t * r
                rate[k] = total
            for k in range(first, first + n):
                speed = v[k] + dt * rate[k]
                place = x[k] + dt * speed
                v[k] = speed
                x[k] = wp.vec3(
                    wp.clamp(place[0], radius, 1.0 - radius),
                    wp.max(place[1], radius),
                    wp.clamp(place[2], radius, 0.148 - radius),
                )

    size = batch * count
    x = wp.array(np.tile(job.position, (batch, 1)), dtype=wp.vec3, device="cpu")
    v, rate = (wp.zeros(size, dtype=wp.vec3, device="cpu") for _ in range(2))
    density = wp.zeros(size, dtype=float, device="cpu")

    def run(steps: int) -> None:
        wp.launch(advance, batch, [x, v, rate, density, steps], device="cpu")

    return timed(run, count, batch)


def taichi_seconds(count: int, batch: int) -> float:
    """What a simulation takes in Taichi on one core of the CPU."""
    import taichi as ti

    ti.init(arch=ti.cpu, cpu_max_num_threads=1, log_level=ti.WARN)
    job = undamped_jobs(count)[0]
    c = constants(job)
    inverse, rest, push_factor = c["inverse"], c["rest"], c["push"]
    friction_factor, least, radius = c["friction"], c["least"], c["radius"]
    n, dt, size = count, PAPER_STEP, batch * count
    x, v, rate = (ti.Vector.field(3, ti.f32, size) for _ in range(3))
    density = ti.field(ti.f32, size)
    x.from_numpy(np.tile(job.position, (batch, 1)))

    @ti.kernel
    def advance(steps: int):
        for simulation in range(batch):
            first = simulation * n
            for _ in range(steps):
                for k in range(first, first + n):
                    weights = 0.0
                    for j in range(first, first + n):
                        t = ti.max(1.0 - (x[k] - x[j]).norm() * inverse, 0.0)
                        weights += t * t * t * t * (5.0 - 4.0 * t)
                    density[k] = weights / rest
                for k in range(first, first + n):
                    total = ti.Vector([0.0, -9.81, 0.0])
                    dk = density[k]
                    pk = ti.max(dk - 1.0, 0.0) / (dk * dk)
                    for j in range(first, first + n):
                        r = x[k] - x[j]
                        r2 = r.dot(r)
                        t = ti.max(1.0 - ti.sqrt(r2) * inverse, 0.0)
                        dj = density[j]
                        pj = ti.max(dj - 1.0, 0.0) / (dj * dj)
                        approach = ti.min((v[k] - v[j]).dot(r), 0.0)
                        friction = approach / ((r2 + least) * (dk + dj))
                        push = push_factor * (pk + pj) - friction_factor * friction
                        total += push * t * t * t * r
                    rate[k] = total
                for k in range(first, first + n):
                    v[k] += dt * rate[k]
                    place = x[k] + dt * v[k]
                    x[k] = ti.Vector(
                        [
                            ti.math.clamp(place[0], radius, 1.0 - radius),
                            ti.max(place[1], radius),
                            ti.math.clamp(place[2], radius, 0.148 - radius),
                        ]
                    )

    def run(steps: int) -> None:
        advance(steps)
        ti.sync()

    return timed(run, count, batch)


def jax_seconds(count: int, batch: int) -> float:
    """What a simulation takes in JAX on the CPU; vmap over simulations."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_platforms", "cpu")
    job = undamped_jobs(count)[0]
    c = constants(job)
    low = c["radius"]
    high = jnp.array([1.0 - low, 1e9, 0.148 - low])

    def step(state, _):
        x, v = state
        r = x[:, None] - x[None]
        r2 = (r**2).sum(axis=2)
        t = jnp.maximum(1.0 - jnp.sqrt(r2) * c["inverse"], 0.0)
        density = (t**4 * (5.0 - 4.0 * t)).sum(axis=1) / c["rest"]
        pressure = jnp.maximum(density - 1.0, 0.0) / density**2
        approach = jnp.minimum(((v[:, None] - v[None]) * r).sum(axis=2), 0.0)
        friction = approach / ((r2 + c["least"]) * (density[:, None] + density[None]))
        push = c["push"] * (pressure[:, None] + pressure[None]) - c["friction"] * friction
        rate = ((push * t**3)[:, :, None] * r).sum(axis=1) - jnp.array([0.0, 9.81, 0.0])
        v = v + PAPER_STEP * rate
        return (jnp.clip(x + PAPER_STEP * v, low, high), v), None

    length = measured_steps(count, batch)
    advance = jax.jit(jax.vmap(lambda x, v: jax.lax.scan(step, (x, v), None, length=length)[0]))
    start = jnp.array(np.tile(job.position[None], (batch, 1, 1)))
    state = (start, jnp.zeros_like(start))

    def run(_steps: int) -> None:
        nonlocal state
        state = jax.block_until_ready(advance(*state))

    return timed(run, count, batch)


def mujoco_seconds(count: int, batch: int) -> float:  # noqa: ARG001 (one after the other)
    """What a simulation of marbles takes in MuJoCo, seven tilted planks below."""
    import mujoco

    job = undamped_jobs(count)[0]
    rng = np.random.default_rng(0)
    planks = "".join(
        f'<geom type="box" size=".08 .015 .074" pos="{x:.3f} {y:.3f} .074" '
        f'euler="0 0 {angle:.0f}"/>'
        for x, y, angle in rng.uniform((0.1, 0.4, -60), (0.9, 1.1, 60), (7, 3))
    )
    walls = "".join(
        f'<geom type="plane" size="2 2 .1" pos="{place}" zaxis="{normal}"/>'
        for place, normal in (
            ("0 0 0", "0 1 0"),
            ("0 0 0", "1 0 0"),
            ("1 0 0", "-1 0 0"),
            ("0 0 0", "0 0 1"),
            ("0 0 .148", "0 0 -1"),
        )
    )
    spheres = "".join(
        f'<body pos="{x:.4f} {y:.4f} {z:.4f}"><freejoint/>'
        f'<geom type="sphere" size="{job.radius:.5f}" mass=".01"/></body>'
        for x, y, z in job.position
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{MARBLE_STEP}" gravity="0 -9.81 0"/>'
        f'<default><geom friction="0 0 0" condim="1"/></default>'
        f"<worldbody>{walls}{planks}{spheres}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    start = time.perf_counter()
    for _ in range(round(DURATION / MARBLE_STEP)):
        mujoco.mj_step(model, data)
    return time.perf_counter() - start


LIQUID_PEERS: dict[str, Peer] = {
    "Warp (CPU)": ("warp", warp_seconds),
    "Taichi (CPU)": ("taichi", taichi_seconds),
    "JAX (CPU)": ("jax", jax_seconds),
    "SPlisHSPlasH": ("pysplishsplash", splishsplash.seconds),
}
MARBLE_PEERS: dict[str, Peer] = {"MuJoCo": ("mujoco", mujoco_seconds)}
