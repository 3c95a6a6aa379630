"""Free-surface lattice Boltzmann, as the paper's stimuli; independent of the particle engine."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pourcast.pictures.video import FRAME_RATE
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.lattice_boltzmann.solver import (
    GRAVITY,
    SUBLAYER,
    LatticeFlow,
    LatticeSettings,
    slip_of,
)
from pourcast.stimuli.lattice_boltzmann.voxels import Voxels, voxelise
from pourcast.stimuli.recording import FULL, Moment, RecordedPour
from pourcast.stimuli.solvers.base import Solver


class LatticeBoltzmann(Solver):
    """The lattice-Boltzmann solver.

    Parameters
    ----------
    resolution
        Cells along the box's longest side (paper: 300).
    real_size
        Real length of that side [m]. Water in a small box falls and comes to rest sooner; paper:
        0.5.
    layers
        Cells through the depth, at least 3; all of the box's by default. With few, the liquid
        moves as in a plane, and fine cells take minutes; front and back are planes of symmetry,
        so that films show the layers and their mirror images until the box is full.
    """

    name: ClassVar[str] = "lbm"
    fidelity: ClassVar[int] = 1
    independent: ClassVar[bool] = True

    resolution: int = Field(default=100, ge=20, le=600)
    real_size: float = Field(default=0.5, gt=0.0, le=20.0)
    layers: int | None = Field(default=None, ge=3, le=600)

    def pour(
        self,
        scene: Scene,
        liquid: Liquid,
        seconds: float,
        *,
        threads: int = 1,
        report: Report = no_report,
    ) -> RecordedPour:
        """Pour a liquid, `seconds` in the real size's time. See `Solver.pour`."""
        voxels = voxelise(scene, self.resolution, self.layers)
        flow = start_flow(scene, liquid, self, voxels, threads)
        count = max(1, round(seconds * FRAME_RATE))
        moments = [_moment(flow, voxels)]
        for k in range(1, count):
            flow.advance(k / FRAME_RATE)
            moments.append(_moment(flow, voxels))
            report("pouring", k + 1, count)
        outcome, stranded = shares(flow, voxels, scene)
        pour = RecordedPour(
            tuple(moments), voxels.cell, voxels.origin, _room(voxels), outcome, stranded
        )
        return pour if self.layers is None else mirrored_through(pour, scene.box.depth)

    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """Viscosity, and what walls do. See `Solver.liquid_identity`."""
        return {
            "kinematic_viscosity": liquid.kinematic_viscosity,
            "slip": liquid.slip,
            "slip_length": liquid.slip_length,
            "wall_pull": liquid.wall_pull,
        }


def pour_to_end(
    scene: Scene, liquid: Liquid, solver: LatticeBoltzmann, seconds: float
) -> tuple[float, float]:
    """Pour without pictures, in the steps of a film; see `shares` for what is returned."""
    voxels = voxelise(scene, solver.resolution, solver.layers)
    flow = start_flow(scene, liquid, solver, voxels)
    for k in range(1, round(seconds * FRAME_RATE) + 1):
        flow.advance(k / FRAME_RATE)
    return shares(flow, voxels, scene)


def start_flow(
    scene: Scene, liquid: Liquid, solver: LatticeBoltzmann, voxels: Voxels, threads: int = 1
) -> LatticeFlow:
    """The liquid at its start, in its real size."""
    scale = solver.real_size / max(scene.box.width, scene.box.height, scene.box.depth)
    cell = voxels.cell * scale
    slip = max(liquid.slip, slip_of(liquid.slip_length, cell))
    # A boundary layer that is thinner than half a cell is not resolved, but drags.
    fastest = (2.0 * GRAVITY * solver.real_size) ** 0.5
    unresolved = 0.5 * cell * fastest / liquid.kinematic_viscosity > SUBLAYER**2
    rough = ~voxels.plane if slip < 1.0 and unresolved else None
    if rough is not None:
        slip = 1.0
    return LatticeFlow(
        fill=voxels.fill,
        solid=voxels.solid,
        cut=voxels.cut,
        cell=cell,
        viscosity=liquid.kinematic_viscosity,
        normal=voxels.normal,
        slip=np.where(voxels.plane, 1.0, slip).astype(np.float32),
        rough=rough,
        adhesion=liquid.wall_pull,
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
    return min(1.0, float(inside / total)), min(1.0, float(above / total))


def mirrored_through(pour: RecordedPour, depth: float) -> RecordedPour:
    """A pour and its mirror images in front and behind, by turns, through a box's depth.

    Parameters
    ----------
    pour
        A pour in a layer whose front and back are planes of symmetry.
    depth
        Of the box [m].
    """
    layers = pour.room.shape[2]
    count = max(layers, round(depth / pour.cell))
    period = np.concatenate([np.arange(layers), np.arange(layers)[::-1]])
    shown = np.resize(period, count)
    start, thickness = (depth - count * pour.cell) / 2, layers * pour.cell

    def through(moment: Moment) -> Moment:
        points = moment.points
        inside = points[:, 2] - pour.origin[2]
        images = []
        for image in range(-(-count // layers)):
            place = image * thickness + (thickness - inside if image % 2 else inside)
            seen = place < count * pour.cell
            images.append(np.column_stack([points[seen, :2], start + place[seen], points[seen, 3]]))
        return Moment(moment.fill[:, :, shown], np.concatenate(images).astype(np.float32))

    return replace(
        pour,
        moments=tuple(through(moment) for moment in pour.moments),
        origin=(*pour.origin[:2], start),
        room=pour.room[:, :, shown],
    )


def _placed(drops: NDArray[np.float64], flow: LatticeFlow, voxels: Voxels) -> NDArray[np.float64]:
    """Positions of drops in the scene [m], shape [3, count]."""
    places: NDArray[np.float64] = drops[:3] / flow.cell * voxels.cell
    places += np.array(voxels.origin)[:, None]
    return places


def _room(voxels: Voxels) -> NDArray[np.float32]:
    room: NDArray[np.float32] = np.where(voxels.solid, 0.0, voxels.cut.room[:, :, None])
    return room.astype(np.float32)


def _moment(flow: LatticeFlow, voxels: Voxels) -> Moment:
    drops = flow.droplets
    volumes = drops[6] * (voxels.cell / flow.cell) ** 3
    points = np.vstack([_placed(drops, flow, voxels), volumes])
    fill = np.round(FULL * flow.grid("fill")).astype(np.uint8)
    return Moment(fill, points.T.astype(np.float32))


SOLVER = LatticeBoltzmann
