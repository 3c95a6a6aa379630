"""Free-surface lattice Boltzmann, as the paper's stimuli; independent of the particle engine."""

import numpy as np
from numpy.typing import NDArray

from pourcast.pictures.video import FRAME_RATE
from pourcast.progress import Report
from pourcast.scenes.scene import Scene
from pourcast.stimuli.lattice_boltzmann.solver import LatticeFlow, LatticeSettings
from pourcast.stimuli.lattice_boltzmann.voxels import Voxels, voxelise
from pourcast.stimuli.poured import FULL, Moment, Poured
from pourcast.stimuli.recipe import LatticeRecipe

WATER_VISCOSITY = 1e-3
"""[Pa s] (paper, section "Stimuli": 1 cP)."""

HONEY_VISCOSITY = {"basins": 0.1, "cup": 0.002}
"""[Pa s], by the goal: 100 cP in Experiment 1, 2 cP in Experiment 2 (likewise)."""

DENSITY = 1000.0
"""Of all liquids [kg/m^3]; only their ratio of viscosity to density counts."""


def pour(
    scene: Scene,
    liquid: str,
    recipe: LatticeRecipe,
    seconds: float,
    *,
    threads: int = 1,
    report: Report | None = None,
) -> Poured:
    """Pour a liquid into a scene.

    Parameters
    ----------
    scene
        The scene.
    liquid
        `water` or `honey`.
    recipe
        Settings of the solver.
    seconds
        Length of the film [s], in the real size's time.
    threads
        Threads; the result doesn't depend on them.
    report
        Told of the pictures that are done.
    """
    voxels = voxelise(scene, recipe.resolution)
    flow = start_flow(scene, liquid, recipe, voxels, threads)
    count = max(1, round(seconds * FRAME_RATE))
    moments = [_moment(flow, voxels)]
    for k in range(1, count):
        flow.advance(k / FRAME_RATE)
        moments.append(_moment(flow, voxels))
        if report is not None:
            report("pouring", k + 1, count)
    outcome, stranded = shares(flow, voxels, scene)
    return Poured(tuple(moments), voxels.cell, voxels.origin, voxels.solid, outcome, stranded)


def pour_to_end(
    scene: Scene, liquid: str, recipe: LatticeRecipe, seconds: float
) -> tuple[float, float]:
    """Pour without pictures; see `shares` for what is returned."""
    voxels = voxelise(scene, recipe.resolution)
    flow = start_flow(scene, liquid, recipe, voxels)
    flow.advance(seconds)
    return shares(flow, voxels, scene)


def start_flow(
    scene: Scene, liquid: str, recipe: LatticeRecipe, voxels: Voxels, threads: int = 1
) -> LatticeFlow:
    """The liquid at its start, in its real size."""
    honey = liquid == "honey"
    thick = recipe.honey_viscosity or HONEY_VISCOSITY[scene.goal.kind]
    scale = recipe.real_size / max(scene.box.width, scene.box.height, scene.box.depth)
    return LatticeFlow(
        fill=voxels.fill,
        solid=voxels.solid,
        cell=voxels.cell * scale,
        viscosity=(thick if honey else WATER_VISCOSITY) / DENSITY,
        normal=voxels.normal,
        slip=recipe.honey_slip if honey else 1.0,
        adhesion=recipe.honey_adhesion if honey else 0.0,
        settings=LatticeSettings(threads=threads),
        name=f"scene {scene.id!r}, {liquid}",
    )


def shares(flow: LatticeFlow, voxels: Voxels, scene: Scene) -> tuple[float, float]:
    """Share of the liquid that the goal holds, and share that is still above its rim.

    Measured from the liquid itself: the mass of every cell and drop.
    """
    mass = np.clip(flow.grid("mass"), 0.0, None)
    drops = flow.droplets
    x, y = _placed(drops, flow, voxels)[:2]
    volumes = drops[6] / flow.cell**3
    held = np.array([scene.goal.holds(*place) for place in zip(x, y, strict=True)], dtype=float)
    heights = (np.arange(mass.shape[1]) + 0.5) * voxels.cell
    total = mass.sum() + volumes.sum()
    inside = (mass.sum(axis=2) * voxels.goal).sum() + volumes @ held
    above = mass[:, heights > scene.goal.rim].sum() + volumes[y > scene.goal.rim].sum()
    return float(inside / total), float(above / total)


def _placed(drops: NDArray[np.float64], flow: LatticeFlow, voxels: Voxels) -> NDArray[np.float64]:
    """Positions of drops in the scene [m], shape [3, count]."""
    places: NDArray[np.float64] = drops[:3] / flow.cell * voxels.cell
    places += np.array(voxels.origin)[:, None]
    return places


def _moment(flow: LatticeFlow, voxels: Voxels) -> Moment:
    drops = flow.droplets
    volumes = drops[6] * (voxels.cell / flow.cell) ** 3
    points = np.vstack([_placed(drops, flow, voxels), volumes])
    fill = np.round(FULL * flow.grid("fill")).astype(np.uint8)
    return Moment(fill, points.T.astype(np.float32))
