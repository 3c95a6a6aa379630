"""Cells that are solid in part: they hold, let pass and hold back what polygons do."""

import numpy as np
import pytest
import shapely

from pourcast.stimuli.lattice_boltzmann.lattice import OPPOSITE, VELOCITY
from pourcast.stimuli.lattice_boltzmann.solver import (
    GRAVITY,
    LatticeFlow,
    LatticeSettings,
    slip_of,
    wall_normals,
)
from pourcast.stimuli.lattice_boltzmann.voxels import SUBCELLS, cut_cells, voxelise
from tests.make import random_scenes
from tests.stimuli.test_lattice_boltzmann import (
    WATER,
    centre_of_mass,
    energy,
    mean_velocity,
    step_for,
)

DEPTH = 3
LAMINAR = LatticeSettings(smagorinsky=0.0)


def points(shape, inside):
    """What holds at `SUBCELLS` points along each side of each cell of a plane."""
    x, y = ((np.arange(side * SUBCELLS) + 0.5) / SUBCELLS for side in shape)
    return inside(*np.meshgrid(x, y, indexing="ij"))


def shares(held):
    width, height = (side // SUBCELLS for side in held.shape)
    return held.reshape(width, SUBCELLS, height, SUBCELLS).mean(axis=(1, 3))


def through(plane):
    return np.repeat(plane[..., None], DEPTH, axis=2)


def cut_flow(shape, is_solid, is_liquid, direction, slip=1.0, **changes):
    """A flow beside one surface that cuts cells, across a direction."""
    solid, liquid = points(shape, is_solid), points(shape, is_liquid)
    cut = cut_cells(solid)
    room = np.maximum(cut.room, 0.05)
    closed = cut.room < 0.05
    wall = np.pad(through(cut.room < 1.0), 1)
    normal = wall_normals((*shape, DEPTH), periodic=(False, False, True))
    normal[2, 1:-1, 1:-1, [0, -1]] = 1.0
    normal[:, wall] = np.array([[direction[0]], [direction[1]], [0.0]])
    fill = np.where(closed, 0.0, np.minimum(shares(liquid & ~solid) / room, 1.0))
    return LatticeFlow(
        through(fill), through(closed), cell=0.01, normal=normal, cut=cut,
        slip=np.where(wall, slip, 1.0).astype(np.float32), **{"viscosity": WATER} | changes,
    )  # fmt: skip


def slope_flow(degrees, depth, length, phase, **changes):
    """A layer on a slope: the flow, and how far down the slope each cell lies."""
    angle = np.radians(degrees)
    top = int(1.5 * length * np.sin(angle)) + 4
    shape = (int(1.5 * length * np.cos(angle)) + 14, top + 2 * depth + 10)

    def above(x, y):
        return (y - top - phase + np.tan(angle) * x) * np.cos(angle)

    def along(x, y):
        return x * np.cos(angle) - (y - top - phase) * np.sin(angle)

    def is_liquid(x, y):
        return (above(x, y) < depth) & (along(x, y) > 6) & (along(x, y) < length)

    direction = (np.sin(angle), np.cos(angle))
    flow = cut_flow(shape, lambda x, y: above(x, y) < 0, is_liquid, direction, **changes)
    return flow, along(*(np.indices(shape) + 0.5))[..., None]


def test_room_is_what_polygons_leave_and_passages_are_the_same_from_both_ends():
    for scene in random_scenes(6):
        voxels = voxelise(scene, 60)
        room, passage = voxels.cut.room, voxels.cut.passage
        solid = shapely.union_all([shapely.Polygon(p) for p in scene.solids])
        inside = solid.intersection(shapely.box(0.0, 0.0, scene.box.width, scene.box.height))
        # Of cells that are split by solids only the largest part is open.
        assert (1.0 - room).sum() * voxels.cell**2 == pytest.approx(inside.area, rel=0.02)
        assert (passage <= room + 1e-6).all()
        for i, (dx, dy, _) in enumerate(VELOCITY):
            there = np.roll(passage[OPPOSITE[i]], (-dx, -dy), axis=(0, 1))
            inner = (slice(1, -1), slice(1, -1))
            assert passage[i][inner] == pytest.approx(there[inner])


@pytest.mark.parametrize("thickness", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("phase", [0.1, 0.3, 0.5, 0.8])
def test_no_liquid_seeps_through_a_wall_that_is_thinner_than_a_cell(thickness, phase):
    left = 15 + phase
    flow = cut_flow(
        (30, 20),
        lambda x, y: (x > left) & (x < left + thickness) & (y < 16),
        lambda x, y: (x < 15) & (y < 10),
        (1.0, 0.0),
    )
    flow.advance(2.0)
    mass, drops = flow.grid("mass"), flow.droplets
    x = np.arange(30)[:, None, None] + 0.5
    beyond = mass[np.broadcast_to(x > left + 1.5, mass.shape)].sum() * flow.cell**3
    beyond += drops[6] @ (drops[0] / flow.cell > left + 1.5)
    assert beyond < 1e-3 * flow.mass


@pytest.mark.parametrize("phase", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("depth", [2, 6])
@pytest.mark.parametrize("degrees", [15, 30, 45, 60])
def test_liquid_slides_down_a_slope(degrees, depth, phase):
    # u = g sin(angle) t, wherever the slope cuts the cells.
    flow, _ = slope_flow(degrees, depth, 25, phase)
    flow.advance(0.12)
    u, v, _ = mean_velocity(flow)
    angle = np.radians(degrees)
    speed = u * np.cos(angle) - v * np.sin(angle)
    error = 0.09 if degrees == 15 else 0.06
    assert speed == pytest.approx(GRAVITY * np.sin(angle) * flow.time, rel=error)


@pytest.mark.parametrize("phase", [0.0, 0.3])
@pytest.mark.parametrize("slip_length", [0.0, 0.02])
@pytest.mark.parametrize("degrees", [15, 30, 60])
def test_thick_liquid_runs_down_a_slope_as_nusselts(degrees, slip_length, phase):
    # Mean speed g sin(angle) (h^2 / 3 + h L) / nu, four cells deep.
    cell, viscosity, thickness, angle = 0.01, 0.1, 0.04, np.radians(degrees)
    step = step_for(1.5, cell, viscosity)
    wanted = 0.02 * cell / step
    mobility = thickness**2 / 3 + thickness * slip_length
    gravity = wanted * viscosity / (np.sin(angle) * mobility)
    flow, along = slope_flow(
        degrees, 4, 60, phase, slip=slip_of(slip_length, cell),
        viscosity=viscosity, time_step=step, settings=LAMINAR, gravity=(0.0, -gravity, 0.0),
    )  # fmt: skip
    flow.advance(3.0 * thickness / wanted)
    mass, velocity = flow.grid("mass") * ((along > 30) & (along < 45)), flow.grid("velocity")
    found = mass.sum() / (DEPTH * 15) * cell
    speed = (mass * (velocity[0] * np.cos(angle) - velocity[1] * np.sin(angle))).sum() / mass.sum()
    exact = gravity * np.sin(angle) * (found**2 / 3 + found * slip_length) / viscosity
    assert speed == pytest.approx(exact, rel=0.2)


@pytest.mark.parametrize("phase", [0.2, 0.5, 0.8])
def test_a_pool_rests_on_a_floor_that_cuts_cells(phase):
    floor, level = 2.0 + phase, 12.0
    flow = cut_flow(
        (20, 18), lambda x, y: y + 0 * x < floor, lambda x, y: y + 0 * x < level, (0.0, 1.0)
    )
    volume = flow.mass
    assert volume == pytest.approx(20 * DEPTH * (level - floor) * flow.cell**3, rel=0.01)
    flow.advance(3.0)  # until its weight has pressed it together
    middle = centre_of_mass(flow)
    flow.advance(6.0)
    assert flow.mass == pytest.approx(volume, rel=1e-5)
    assert centre_of_mass(flow) == pytest.approx(middle, rel=0.02)
    assert np.linalg.norm(mean_velocity(flow)) < 0.01 * np.sqrt(2 * GRAVITY * 0.1)


@pytest.mark.parametrize("degrees", [30, 75, 90])
def test_a_blow_makes_no_energy(degrees):
    # A sheet slides on the floor into a face that cuts cells.
    angle, foot = np.radians(degrees), 60.4
    flow = cut_flow(
        (100, 60),
        lambda x, y: (x - foot) * np.sin(angle) > y * np.cos(angle),
        lambda x, y: (x > 5) & (x < 55) & (y < 6),
        (np.sin(angle), -np.cos(angle)),
        velocity=np.array([1.5, 0.0, 0.0])[:, None, None, None] * np.ones((3, 100, 60, DEPTH)),
    )
    start = energy(flow)
    for time in (0.05, 0.1, 0.2, 0.3):
        flow.advance(time)
        assert energy(flow) < 1.02 * start


def split_by_a_wedge(phase):
    """Share of a falling column that ends right of a wedge whose tip is off its middle."""
    tip, top = 40.0 + phase, 40.0
    flow = cut_flow(
        (80, 70),
        lambda x, y: (np.abs(x - tip) < 0.5 * (top - y)) & (y > 20),
        lambda x, y: (np.abs(x - tip - 2.0) < 6) & (y > 50) & (y < 65),
        (1.0, 0.0),
    )
    flow.advance(0.28)  # before it is thrown back by the box
    mass, drops = flow.grid("mass"), flow.droplets
    x = np.arange(80)[:, None, None] + 0.5
    right = mass[np.broadcast_to(x > tip, mass.shape)].sum()
    right += (drops[6] * (drops[0] / flow.cell > tip)).sum() / flow.cell**3
    return right / (flow.mass / flow.cell**3)


def test_it_does_not_matter_where_the_cells_lie():
    # Moved by parts of a cell together with the liquid, a wedge divides it alike.
    found = [split_by_a_wedge(phase) for phase in (0.0, 0.25, 0.5, 0.75)]
    assert np.ptp(found) < 0.06
    assert np.mean(found) == pytest.approx(8 / 12, abs=0.08)
