"""Free-surface lattice Boltzmann, as the paper's stimuli; independent of the particle engine."""

import numpy as np
from numpy.typing import NDArray

from pourcast.progress import Report
from pourcast.scene import Scene
from pourcast.stimuli.lattice_boltzmann.solver import LatticeFlow, LatticeSettings
from pourcast.stimuli.lattice_boltzmann.voxels import Voxels, voxelise
from pourcast.stimuli.poured import FULL, Moment, Poured
from pourcast.stimuli.recipe import LatticeRecipe
from pourcast.video import FRAME_RATE

WATER_VISCOSITY = 1e-6
"""Kinematic viscosity [m^2/s] of 1 cP; the densities of all liquids are water's here."""

HONEY_VISCOSITY = {"basins": 1e-4, "cup": 2e-6}
"""100 cP in Experiment 1, 2 cP in Experiment 2 (paper, section "Stimuli")."""


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
    scale = recipe.real_size / max(scene.box.width, scene.box.height, scene.box.depth)
    flow = start_flow(scene, liquid, recipe, voxels, threads)
    count = max(1, round(seconds * FRAME_RATE))
    moments = [_moment(flow, voxels, scale)]
    for k in range(1, count):
        flow.advance(k / FRAME_RATE)
        moments.append(_moment(flow, voxels, scale))
        if report is not None:
            report("pouring", k + 1, count)
    outcome, stranded = shares(flow, voxels, scene, scale)
    return Poured(tuple(moments), voxels.cell, voxels.origin, voxels.solid, outcome, stranded)


def start_flow(
    scene: Scene, liquid: str, recipe: LatticeRecipe, voxels: Voxels, threads: int = 1
) -> LatticeFlow:
    """The liquid at its start, in its real size."""
    honey = liquid == "honey"
    scale = recipe.real_size / max(scene.box.width, scene.box.height, scene.box.depth)
    return LatticeFlow(
        fill=voxels.fill,
        solid=voxels.solid,
        cell=voxels.cell * scale,
        viscosity=HONEY_VISCOSITY[scene.goal.kind] if honey else WATER_VISCOSITY,
        normal=voxels.normal,
        slip=recipe.honey_slip if honey else 1.0,
        adhesion=recipe.honey_adhesion if honey else 0.0,
        settings=LatticeSettings(threads=threads),
    )


def shares(flow: LatticeFlow, voxels: Voxels, scene: Scene, scale: float) -> tuple[float, float]:
    """Share of the liquid that the goal holds, and share that is still above its rim.

    Measured from the liquid itself: the mass of every cell and drop.
    """
    mass = np.clip(flow.grid("mass"), 0.0, None)
    drops = flow.droplets
    x, y = _placed(drops, voxels, scale)[:2]
    volumes = drops[6] / flow.cell**3
    held = np.array([scene.goal.holds(*place) for place in zip(x, y, strict=True)], dtype=float)
    heights = (np.arange(mass.shape[1]) + 0.5) * voxels.cell
    total = mass.sum() + volumes.sum()
    inside = (mass.sum(axis=2) * voxels.goal).sum() + volumes @ held
    above = mass[:, heights > scene.goal.rim].sum() + volumes[y > scene.goal.rim].sum()
    return float(inside / total), float(above / total)


def _placed(drops: NDArray[np.float64], voxels: Voxels, scale: float) -> NDArray[np.float64]:
    """Positions of drops in the scene [m], shape [3, count]."""
    return drops[:3] / scale + np.array(voxels.origin)[:, None]


def _moment(flow: LatticeFlow, voxels: Voxels, scale: float) -> Moment:
    drops = flow.droplets
    points = np.vstack([_placed(drops, voxels, scale), drops[6] / scale**3])
    fill = np.round(FULL * flow.grid("fill")).astype(np.uint8)
    return Moment(fill, points.T.astype(np.float32))
