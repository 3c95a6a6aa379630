"""The same work on general engines: Warp, Taichi, JAX, SPlisHSPlasH; MuJoCo for marbles.

They are given less to do than ours: the liquid meets the walls only, no
polygons; and MuJoCo takes steps of 1 ms. Each runs on one core where it lets us
say so (Warp's CPU device is serial; JAX takes what it wants). A peer that is not
installed is left out: ``pip install -e '.[peers]'``.
"""

import time
from collections.abc import Callable

import numpy as np

from benchmarks import splishsplash
from pourcast.engine.batch import Job, fill_lane
from pourcast.engine.state import empty_parameters
from pourcast.sweep.bench import BATCH, DURATION, PAPER_STEP, undamped_jobs

STEPS = round(DURATION / PAPER_STEP)
MARBLE_STEP = 1e-3


Speed = Callable[[int], float]
"""Simulations of `DURATION` per second at a number of particles."""

Peer = tuple[str, Speed]
"""The module that a peer needs, and its speed."""


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


def timed(run: Callable[[int], None], steps: int) -> float:
    """Seconds per step, once warm."""
    run(2)
    start = time.perf_counter()
    run(steps)
    return (time.perf_counter() - start) / steps


def warp_speed(count: int) -> float:
    """Simulations of `DURATION` per second in NVIDIA Warp on the CPU."""
    import warp as wp

    wp.config.quiet = True
    job = undamped_jobs(count)[0]
    c = constants(job)
    inverse, rest, push_factor = wp.float32(c["inverse"]), c["rest"], c["push"]
    friction_factor, least, radius = c["friction"], c["least"], c["radius"]
    n, dt = count, PAPER_STEP

    @wp.kernel
    def densities(x: wp.array(dtype=wp.vec3), density: wp.array(dtype=float)):  # type: ignore[valid-type]
        k = wp.tid()
        first = (k // n) * n
        total = float(0.0)  # noqa: UP018 (a variable in Warp, where a literal is a constant)
        for j in range(first, first + n):
            t = wp.max(1.0 - wp.length(x[k] - x[j]) * inverse, 0.0)
            total += t * t * t * t * (5.0 - 4.0 * t)
        density[k] = total / rest

    @wp.kernel
    def forces(
        x: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        v: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        density: wp.array(dtype=float),  # type: ignore[valid-type]
        rate: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
    ):
        k = wp.tid()
        first = (k // n) * n
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

    @wp.kernel
    def integrate(
        x: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        v: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
        rate: wp.array(dtype=wp.vec3),  # type: ignore[valid-type]
    ):
        k = wp.tid()
        speed = v[k] + dt * rate[k]
        place = x[k] + dt * speed
        v[k] = speed
        x[k] = wp.vec3(
            wp.clamp(place[0], radius, 1.0 - radius),
            wp.max(place[1], radius),
            wp.clamp(place[2], radius, 0.148 - radius),
        )

    size = BATCH * count
    x = wp.array(np.tile(job.position, (BATCH, 1)), dtype=wp.vec3, device="cpu")
    v, rate = (wp.zeros(size, dtype=wp.vec3, device="cpu") for _ in range(2))
    density = wp.zeros(size, dtype=float, device="cpu")

    def run(steps: int) -> None:
        for _ in range(steps):
            wp.launch(densities, size, [x, density], device="cpu")
            wp.launch(forces, size, [x, v, density, rate], device="cpu")
            wp.launch(integrate, size, [x, v, rate], device="cpu")

    return BATCH / (timed(run, max(10, 20_000 // count)) * STEPS)


def taichi_speed(count: int) -> float:
    """Simulations of `DURATION` per second in Taichi on one core of the CPU."""
    import taichi as ti

    ti.init(arch=ti.cpu, cpu_max_num_threads=1, log_level=ti.WARN)
    job = undamped_jobs(count)[0]
    c = constants(job)
    inverse, rest, push_factor = c["inverse"], c["rest"], c["push"]
    friction_factor, least, radius = c["friction"], c["least"], c["radius"]
    n, dt, size = count, PAPER_STEP, BATCH * count
    x, v, rate = (ti.Vector.field(3, ti.f32, size) for _ in range(3))
    density = ti.field(ti.f32, size)
    x.from_numpy(np.tile(job.position, (BATCH, 1)))

    @ti.kernel
    def densities():
        for k in range(size):
            first = (k // n) * n
            total = 0.0
            for j in range(first, first + n):
                t = ti.max(1.0 - (x[k] - x[j]).norm() * inverse, 0.0)
                total += t * t * t * t * (5.0 - 4.0 * t)
            density[k] = total / rest

    @ti.kernel
    def forces():
        for k in range(size):
            first = (k // n) * n
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
                total += (push_factor * (pk + pj) - friction_factor * friction) * t * t * t * r
            rate[k] = total

    @ti.kernel
    def integrate():
        for k in range(size):
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
        for _ in range(steps):
            densities()
            forces()
            integrate()
        ti.sync()

    return BATCH / (timed(run, max(10, 20_000 // count)) * STEPS)


def jax_speed(count: int) -> float:
    """Simulations of `DURATION` per second in JAX on the CPU; vmap over simulations."""
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

    def steps_of(length):
        return jax.jit(jax.vmap(lambda x, v: jax.lax.scan(step, (x, v), None, length=length)[0]))

    chunk = max(5, 2_000 // count)
    advance = steps_of(chunk)
    x = jnp.array(np.tile(job.position[None], (BATCH, 1, 1)))
    state = (x, jnp.zeros_like(x))
    jax.block_until_ready(advance(*state))
    start = time.perf_counter()
    for _ in range(3):
        state = jax.block_until_ready(advance(*state))
    return BATCH / ((time.perf_counter() - start) / (3 * chunk) * STEPS)


def mujoco_speed(count: int) -> float:
    """Simulations of `DURATION` per second of marbles in MuJoCo, seven tilted planks below."""
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
    return 1.0 / (time.perf_counter() - start)


LIQUID_PEERS: dict[str, Peer] = {
    "Warp (CPU)": ("warp", warp_speed),
    "Taichi (CPU)": ("taichi", taichi_speed),
    "JAX (CPU)": ("jax", jax_speed),
    "SPlisHSPlasH": ("pysplishsplash", splishsplash.speed),
}
MARBLE_PEERS: dict[str, Peer] = {"MuJoCo": ("mujoco", mujoco_speed)}
