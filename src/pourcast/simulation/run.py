"""From scenes to the engine's arrays and back: pours in, outcomes out."""

import threading
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from pourcast.engine.job import Job, Result, Stepping
from pourcast.engine.packing import (
    pack_cylinder,
    reference_density,
)
from pourcast.engine.polygons import Solids, pack_solids
from pourcast.errors import SimulationDivergedError
from pourcast.progress import Progress, no_progress
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import GRAVITY, Outcome, Pour
from pourcast.simulation.settings import EngineSettings, Kind
from pourcast.simulation.versions import code_version


def engine_version() -> str:
    """Name of the state of the code that a pour's outcome depends on, but for the goal's own.

    Results of two versions must not be mixed; that of a release never changes. What scenes and
    liquids hold stands in the names of results by itself: how they are read is of no account.
    """
    return code_version((__name__,), ("pourcast.scenes", "pourcast.simulation.versions"))


def simulate(
    pours: Sequence[Pour],
    *,
    settings: EngineSettings | None = None,
    record: bool = False,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> list[Outcome]:
    """Run simulations on all cores, as many in lockstep as fill its lanes.

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
        Called before the first simulation, and after each.

    Returns
    -------
    list of Outcome
        In the order of `pours`.

    Raises
    ------
    SimulationDivergedError
        If a pour breaks: the message names scene, liquid and settings.
    """
    # The engine loads Numba: when something is simulated, and not for what only names it.
    from pourcast.engine.batch import Batch, run_batches  # noqa: PLC0415

    settings = settings or EngineSettings()
    groups: dict[tuple[Kind, int, Stepping], list[int]] = defaultdict(list)
    for index, pour in enumerate(pours):
        spacing = settings.spacing_in(pour.scene, pour.n_particles)
        stepping = settings.stepping(pour.kind, spacing, pour.liquid.viscosity_alpha)
        groups[pour.kind, pour.n_particles, stepping].append(index)
    done, lock = 0, threading.Lock()
    progress(0, len(pours))

    def count_one(_index: int, _result: Result) -> None:
        nonlocal done
        with lock:
            done += 1
            progress(done, len(pours))

    batches = []
    for (kind, _, stepping), members in groups.items():
        chosen = [pours[index] for index in members]
        solids, scene_index = _solids_of(chosen)
        jobs = [_job(p, s, settings) for p, s in zip(chosen, scene_index, strict=True)]
        batches.append(Batch(jobs, solids, stepping, kind))
    order = [index for members in groups.values() for index in members]
    try:
        results = run_batches(batches, record=record, threads=threads, on_done=count_one)
    except SimulationDivergedError as error:
        number = order[error.number]
        raise SimulationDivergedError(
            f"{_name(pours[number], settings)}: {error}", number=number
        ) from None
    solids_and_jobs = [(batch.solids, job) for batch in batches for job in batch.jobs]
    outcomes = {
        index: _outcome(pours[index], job, result, solids)
        for index, (solids, job), result in zip(order, solids_and_jobs, results, strict=True)
    }
    return [outcomes[index] for index in range(len(pours))]


def _name(pour: Pour, settings: EngineSettings) -> str:
    """A pour in words: scene, liquid and settings."""
    changed = [
        f"{field.name}={_in_words(getattr(settings, field.name))}"
        for field in fields(settings)
        if getattr(settings, field.name) != field.default
    ]
    return (
        f"scene {pour.scene.id!r}, {pour.n_particles} particles of {pour.liquid.name!r} "
        f"({pour.kind}, damping {pour.damping_zeta:g}/s, engine settings "
        f"{', '.join(changed) or 'as they come'})"
    )


def _in_words(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _solids_of(pours: Sequence[Pour]) -> tuple[Solids, list[int]]:
    """Polygons of all different scenes, and each pour's scene among them."""
    index_of: dict[int, int] = {}
    scenes: list[Scene] = []
    indices = []
    for pour in pours:
        key = id(pour.scene)
        if key not in index_of:
            index_of[key] = len(scenes)
            scenes.append(pour.scene)
        indices.append(index_of[key])
    polygons = [
        [(np.array(p), False) for p in scene.obstacles]
        + [(np.array(p), True) for p in scene.goal.solids]
        for scene in scenes
    ]
    return pack_solids(polygons), indices


def _job(pour: Pour, scene_index: int, settings: EngineSettings) -> Job:
    box, start, count = pour.scene.box, pour.scene.liquid, pour.n_particles
    depth = settings.depth_in(pour.scene, count)
    radius = start.diameter / 2
    support = settings.support_in_spacings * settings.spacing_in(pour.scene, count)
    contact_radius = settings.contact_radius_in(pour.scene, count, pour.kind)
    cohesive = pour.kind == "liquid"  # marbles feel nothing but contact
    centre = (start.centre[0] + pour.offset[0], start.centre[1] + pour.offset[1])
    origin = pack_cylinder(count, (0.0, 0.0), radius, depth)
    return Job(
        position=pack_cylinder(count, centre, radius, depth),
        scene=scene_index,
        width=box.width,
        height=box.height,
        depth=depth,
        radius=contact_radius,
        support_radius=support,
        reference_density=reference_density(origin, support, depth),
        sound_speed=settings.sound_speed,
        viscosity_alpha=pour.liquid.viscosity_alpha,
        damping=settings.damping_scale * pour.damping_zeta,
        duration=settings.max_duration,
        gravity=GRAVITY,
        adhesion_normal=pour.liquid.adhesion_normal,
        adhesion_tangential=pour.liquid.adhesion_tangential,
        contact_layer=settings.contact_layer * contact_radius,
        support_in_spacings=settings.support_in_spacings,
        cohesion=pour.liquid.cohesion if cohesive else 0.0,
        tension=pour.liquid.tension if cohesive else 0.0,
        viscosity_of_all_pairs=settings.viscous_pairs == "all",
        rim=pour.scene.goal.rim,
    )


def _outcome(pour: Pour, job: Job, result: Result, solids: Solids) -> Outcome:
    from pourcast.engine.solids import obstacle_distances  # noqa: PLC0415

    goal, position = pour.scene.goal, result.position.astype(np.float64)
    held = [goal.holds(x, y) for x, y in position[:, :2]]
    gap = obstacle_distances(position[:, :2], job.scene, solids)
    on_obstacle = gap < job.touch
    return Outcome(
        judgment=float(np.mean(held)),
        stranded=float(np.mean(on_obstacle | (position[:, 1] > goal.rim))),
        touched=float(np.mean(result.touched)),
        time=result.time,
        settled=result.settled,
        position=result.position,
        frames=result.frames,
    )
