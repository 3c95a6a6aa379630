"""The stimuli's solver against known answers: profiles, decay, rest, fall, slopes, a broken dam."""

from dataclasses import replace

import numpy as np
import pytest

from pourcast.errors import InputError, SimulationDivergedError
from pourcast.scenes.liquids import registry
from pourcast.stimuli.lattice_boltzmann.lattice import (
    INTERFACE,
    MIRRORED,
    OPPOSITE,
    VELOCITY,
    WEIGHT,
)
from pourcast.stimuli.lattice_boltzmann.solver import (
    GRAVITY,
    LatticeFlow,
    LatticeSettings,
    slip_of,
    wall_normals,
)
from pourcast.stimuli.lattice_boltzmann.voxels import voxelise
from pourcast.stimuli.recording import Moment, RecordedPour
from pourcast.stimuli.solvers import lbm
from tests.make import random_scenes

WATER = 1e-6
LAMINAR = LatticeSettings(smagorinsky=0.0)


def empty(*shape):
    return np.zeros(shape, dtype=bool)


def ball(shape, centre, radius):
    """Fill of a ball or, with two numbers as its centre, of a cylinder through the depth."""
    places = np.indices(shape)[: len(centre)] + 0.5
    gaps = places - np.array(centre).reshape(-1, *([1] * len(shape)))
    return np.clip(radius + 0.5 - np.linalg.norm(gaps, axis=0), 0.0, 1.0)


def centre_of_mass(flow, axis=1):
    mass, drops = flow.grid("mass"), flow.droplets
    places = (np.indices(mass.shape)[axis] + 0.5) * flow.cell
    held = (mass * places).sum() * flow.cell**3 + (drops[axis] * drops[6]).sum()
    return held / flow.mass


def mean_velocity(flow):
    mass = flow.grid("mass")
    return (mass * flow.grid("velocity")).sum(axis=(1, 2, 3)) / mass.sum()


def energy(flow):
    """Kinetic and potential, divided by the density [m^5/s^2]."""
    mass, velocity, drops = flow.grid("mass"), flow.grid("velocity"), flow.droplets
    height = (np.indices(mass.shape)[1] + 0.5) * flow.cell
    held = mass * (0.5 * (velocity**2).sum(axis=0) + GRAVITY * height)
    flying = drops[6] * (0.5 * (drops[3:6] ** 2).sum(axis=0) + GRAVITY * drops[1])
    return held.sum() * flow.cell**3 + flying.sum()


# The lattice --------------------------------------------------------------------------


def test_the_lattices_moments_are_those_of_a_gas_at_rest():
    # sum w = 1, sum w c = 0, sum w c c = I / 3, sum w c c c c = (dd + dd + dd) / 9
    d = np.eye(3)
    fourth = np.einsum("ij,kl->ijkl", d, d)
    fourth = fourth + np.einsum("ik,jl->ijkl", d, d) + np.einsum("il,jk->ijkl", d, d)
    c = VELOCITY
    assert WEIGHT.sum() == pytest.approx(1.0)
    assert WEIGHT @ c == pytest.approx(np.zeros(3))
    assert np.einsum("n,ni,nj->ij", WEIGHT, c, c) == pytest.approx(d / 3, abs=1e-15)
    assert np.einsum("n,ni,nj,nk,nl->ijkl", WEIGHT, c, c, c, c) == pytest.approx(fourth / 9)
    assert (VELOCITY[OPPOSITE] == -VELOCITY).all()
    for axis in range(3):
        flip = 1 - 2 * (np.arange(3) == axis)
        assert (VELOCITY[MIRRORED[axis]] == VELOCITY * flip).all()


# Viscous flow -------------------------------------------------------------------------


def poiseuille_error(n):
    """Largest error of a channel's profile u = g y (H - y) / (2 nu), over the largest speed."""
    height, viscosity, fastest = 1.0, 1e-2, 1e-2
    cell = height / n
    flow = LatticeFlow(
        fill=np.ones((3, n, 3)), solid=empty(3, n, 3), cell=cell, viscosity=viscosity,
        gravity=(8.0 * viscosity * fastest / height**2, 0.0, 0.0), slip=0.0,
        periodic=(True, False, True), time_step=0.1 * cell**2 / viscosity, settings=LAMINAR,
    )  # fmt: skip
    flow.advance(1.2 * height**2 / viscosity)
    y = (np.arange(n) + 0.5) * cell
    exact = 4.0 * fastest * y * (height - y) / height**2
    return np.abs(flow.grid("velocity")[0, 1, :, 1] - exact).max() / fastest


def test_a_channels_profile_converges_with_the_second_order():
    # Halving the cells divides the error by four.
    errors = [poiseuille_error(n) for n in (6, 12)]
    assert errors[0] < 0.04
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def step_for(relaxation_time, cell, viscosity):
    return (relaxation_time - 0.5) / 3.0 * cell**2 / viscosity


@pytest.mark.parametrize("slip_length", [0.0, 0.2])
@pytest.mark.parametrize("relaxation_time", [1.5, 5.0, 12.0])
def test_a_channels_profile_is_the_same_however_thick_the_liquid(relaxation_time, slip_length):
    # u = g (y (H - y) + L H) / (2 nu), with Navier's slip length L.
    n, height, viscosity = 8, 1.0, 1e-2
    cell = height / n
    step = step_for(relaxation_time, cell, viscosity)
    fastest = 0.02 * cell / step
    flow = LatticeFlow(
        fill=np.ones((3, n, 3)), solid=empty(3, n, 3), cell=cell, viscosity=viscosity,
        gravity=(8.0 * viscosity * fastest / height**2, 0.0, 0.0), slip=slip_of(slip_length, cell),
        periodic=(True, False, True), time_step=step, settings=LAMINAR,
    )  # fmt: skip
    flow.advance(max(2.0 * height**2 / viscosity, 500 * step))
    y = (np.arange(n) + 0.5) * cell
    exact = 4.0 * fastest * (y * (height - y) + slip_length * height) / height**2
    # Without slip exact; with it, the shear is measured over half a cell.
    allowed = 1e-3 if slip_length == 0.0 else 0.5 * cell / height * exact.max() / fastest
    assert np.abs(flow.grid("velocity")[0, 1, :, 1] - exact).max() / fastest < allowed


@pytest.mark.parametrize("relaxation_time", [0.6, 1.5, 5.0])
def test_a_shear_wave_decays_by_viscosity_alone(relaxation_time):
    # u ~ exp(-nu k^2 t)
    n, viscosity = 128, 1e-2
    step, k = step_for(relaxation_time, 1.0 / n, viscosity), 2.0 * np.pi
    velocity = np.zeros((3, 3, n, 3))
    velocity[0] = (1e-3 / n / step * np.sin(k * (np.arange(n) + 0.5) / n))[:, None]
    flow = LatticeFlow(
        fill=np.ones((3, n, 3)), solid=empty(3, n, 3), cell=1.0 / n, viscosity=viscosity,
        gravity=(0.0, 0.0, 0.0), velocity=velocity, periodic=(True, True, True), time_step=step,
        settings=LAMINAR,
    )  # fmt: skip
    flow.advance(0.3 / (viscosity * k**2))  # until the stress is there
    before, start = np.abs(flow.grid("velocity")[0]).max(), flow.time
    flow.advance(start + 0.7 / (viscosity * k**2))
    rate = -np.log(np.abs(flow.grid("velocity")[0]).max() / before) / (flow.time - start)
    assert rate == pytest.approx(viscosity * k**2, rel=0.03)


def vortex_decay(n):
    """Measured over exact rate of decay of a Taylor-Green vortex: E ~ exp(-4 nu t)."""
    cell, viscosity = 2 * np.pi / n, 0.05
    places = (np.arange(n) + 0.5) * cell
    x, y = np.meshgrid(places, places, indexing="ij")
    velocity = np.zeros((3, n, n, 2))
    velocity[0] = (np.cos(x) * np.sin(y))[..., None]
    velocity[1] = -(np.sin(x) * np.cos(y))[..., None]
    flow = LatticeFlow(
        fill=np.ones((n, n, 2)), solid=empty(n, n, 2), cell=cell, viscosity=viscosity,
        gravity=(0.0, 0.0, 0.0), velocity=velocity, periodic=(True, True, True),
        time_step=0.8 * cell / n, settings=LAMINAR,
    )  # fmt: skip
    before = (flow.grid("velocity") ** 2).sum()
    flow.advance(3.0)
    after = (flow.grid("velocity") ** 2).sum()
    return np.log(after / before) / (-4.0 * viscosity * flow.time)


def test_a_vortex_decays_by_viscosity_alone():
    coarse, fine = vortex_decay(16), vortex_decay(32)
    assert fine == pytest.approx(1.0, abs=0.025)
    assert abs(fine - 1.0) < 0.4 * abs(coarse - 1.0)


# The free surface ---------------------------------------------------------------------


@pytest.mark.parametrize("viscosity", [WATER, 1e-4])
def test_liquid_at_rest_stays_there_for_ten_thousand_steps(viscosity):
    fill = np.zeros((12, 14, 4))
    fill[:, :8] = 1.0
    flow = LatticeFlow(fill, empty(*fill.shape), cell=0.01, viscosity=viscosity)
    before = flow.mass
    flow.advance(5.0)  # until its weight has pressed it together
    middle, steps = centre_of_mass(flow), flow.steps
    while flow.steps < steps + 10_000:
        flow.advance(flow.time + 1.0)
    assert flow.mass == pytest.approx(before, rel=1e-4)
    assert centre_of_mass(flow) == pytest.approx(middle, rel=0.02)
    # Its speed is a small part of what falling through its depth would give.
    assert np.linalg.norm(mean_velocity(flow)) < 0.01 * np.sqrt(2 * GRAVITY * 0.08)
    # Pressure grows with depth: cs^2 d(rho) / dy = -rho g in lattice units.
    density = flow.grid("density")[6, 1:6, 2]
    slope = -np.diff(np.log(density)).mean()
    assert slope == pytest.approx(3.0 * GRAVITY * flow.dt**2 / flow.cell, rel=0.1)


def test_a_drop_falls_as_a_body_and_keeps_its_shape_and_mass():
    flow = LatticeFlow(
        ball((20, 50, 20), (10, 42, 10), 5.0), empty(20, 50, 20), cell=0.01, viscosity=WATER
    )
    start, volume = centre_of_mass(flow), flow.mass
    flow.advance(0.2)
    fallen = 0.5 * GRAVITY * flow.time**2
    assert start - centre_of_mass(flow) == pytest.approx(fallen, rel=0.02)
    assert -mean_velocity(flow)[1] == pytest.approx(GRAVITY * flow.time, rel=0.005)
    assert flow.mass == pytest.approx(volume, rel=1e-6)
    full = flow.grid("fill") > 0.5
    assert [full.any(axis=axes).sum() for axes in ((1, 2), (0, 2), (0, 1))] == [10, 10, 10]


def test_walls_that_let_it_slip_do_not_hold_a_falling_cylinder():
    # It touches front and back all the way down.
    fill = ball((20, 60, 6), (10, 52), 5.0)
    flow = LatticeFlow(fill, empty(*fill.shape), cell=0.01, viscosity=WATER)
    start = centre_of_mass(flow)
    flow.advance(0.25)
    assert start - centre_of_mass(flow) == pytest.approx(0.5 * GRAVITY * flow.time**2, rel=0.02)
    mass, velocity = flow.grid("mass"), flow.grid("velocity")[1]
    layers = (mass * velocity).sum(axis=(0, 1)) / mass.sum(axis=(0, 1))
    assert layers == pytest.approx(-GRAVITY * flow.time, rel=0.01)


def test_walls_that_hold_it_do():
    fill = ball((20, 60, 6), (10, 52), 5.0)
    flow = LatticeFlow(fill, empty(*fill.shape), cell=0.01, viscosity=1e-3, slip=0.0)
    start = centre_of_mass(flow)
    flow.advance(0.25)
    assert start - centre_of_mass(flow) < 0.7 * 0.5 * GRAVITY * flow.time**2


@pytest.mark.parametrize("degrees", [15, 30, 45])
def test_liquid_slides_down_a_staircase_as_down_a_slope(degrees):
    # u = g sin(angle) t without friction, for a layer of six cells.
    angle, shape = np.radians(degrees), (90, 70, 8)
    x, y = np.meshgrid(*(np.arange(side) + 0.5 for side in shape[:2]), indexing="ij")
    above = (y - 60 + np.tan(angle) * x) * np.cos(angle)
    along = x * np.cos(angle) - (y - 60) * np.sin(angle)
    solid = np.repeat((above < 0)[..., None], shape[2], axis=2)
    fill = np.repeat(
        ((above > 0) & (above < 6) & (along > 5) & (along < 25)).astype(float)[..., None],
        shape[2],
        axis=2,
    )
    normal = wall_normals(shape)
    inner = np.pad(solid, 1)
    for axis, part in enumerate((np.sin(angle), np.cos(angle), 0.0)):
        normal[axis][inner] = part
    flow = LatticeFlow(fill, solid, cell=0.01, viscosity=WATER, normal=normal)
    flow.advance(0.12)
    u, v, _ = mean_velocity(flow)
    speed = u * np.cos(angle) - v * np.sin(angle)
    assert speed == pytest.approx(GRAVITY * np.sin(angle) * flow.time, rel=0.06)


def held_floor(shape, slip):
    """Normals and slip of a grid whose floor holds liquid; all else lets it slip."""
    normal = wall_normals(shape, periodic=(False, False, True))
    normal[2, 1:-1, 1:-1, [0, -1]] = 1.0
    held = np.ones(normal.shape[1:], dtype=np.float32)
    held[:, 0] = slip
    return {"normal": normal, "slip": held}


@pytest.mark.parametrize("slip_length", [0.0, 0.03])
@pytest.mark.parametrize("relaxation_time", [1.5, 5.0])
def test_a_thick_film_runs_down_a_slope_as_nusselts(relaxation_time, slip_length):
    # Mean speed g sin(angle) (h^2 / 3 + h L) / nu, six cells deep, in the middle of a long film.
    cell, viscosity, angle = 0.01, 0.1, np.radians(30.0)
    fill = np.zeros((120, 12, 3))
    fill[12:72, :6] = 1.0
    step, depth = step_for(relaxation_time, cell, viscosity), 0.06
    wanted = 0.02 * cell / step
    gravity = wanted * viscosity / (np.sin(angle) * (depth**2 / 3 + depth * slip_length))
    flow = LatticeFlow(
        fill, empty(*fill.shape), cell=cell, viscosity=viscosity, time_step=step, settings=LAMINAR,
        gravity=(gravity * np.sin(angle), -gravity * np.cos(angle), 0.0),
        **held_floor(fill.shape, slip_of(slip_length, cell)),
    )  # fmt: skip
    flow.advance(3.0 * depth / wanted)
    mass, speed = flow.grid("mass")[36:42], flow.grid("velocity")[0, 36:42]
    found = mass.sum() / 18 * cell
    exact = gravity * np.sin(angle) * (found**2 / 3 + found * slip_length) / viscosity
    assert (mass * speed).sum() / mass.sum() == pytest.approx(exact, rel=0.12)


@pytest.mark.parametrize("cell", [0.005, 0.00125])
def test_water_between_rough_walls_is_slowed_by_the_power_law_of_the_wall(cell):
    # Two cells deep: u' = -u*^2 / cell, with u / u* = 8.3 (u* cell / (2 nu))^(1/7).
    rough = np.zeros((5, 4, 5), dtype=bool)
    rough[:, [0, -1]] = True
    velocity = np.zeros((3, 3, 2, 3))
    velocity[0] = 2.0
    flow = LatticeFlow(
        np.ones((3, 2, 3)), empty(3, 2, 3), cell=cell, viscosity=WATER, velocity=velocity,
        rough=rough, gravity=(0.0, 0.0, 0.0), periodic=(True, False, True), time_step=0.05 * cell,
    )  # fmt: skip
    flow.advance(50 * cell)
    u, count = 2.0, 10_000
    for _ in range(count):
        friction_speed = (u / 8.3) ** 0.875 * (2.0 * WATER / cell) ** 0.125
        u -= flow.time / count * friction_speed**2 / cell
    assert u < 1.8
    assert mean_velocity(flow)[0] == pytest.approx(u, rel=0.01)


@pytest.mark.parametrize("slip", [1.0, 0.0])
def test_liquid_is_let_go_by_a_wall_that_would_have_to_pull(slip):
    # Under a ceiling that is not along the lattice, where liquid would hang from its own suction.
    fill = np.zeros((9, 24, 9))
    fill[:, 14:20] = 1.0
    solid = empty(9, 24, 9)
    solid[:, 20:] = True
    normal = wall_normals(fill.shape)
    normal[:, 1:-1, 21:-1, 1:-1] = np.array([0.1, 0.995, 0.0]).reshape(3, 1, 1, 1)
    held = np.where(np.arange(26)[None, :, None] > 20, slip, 1.0) * np.ones((11, 26, 11))
    flow = LatticeFlow(fill, solid, cell=0.01, viscosity=1e-2, normal=normal, slip=held)
    start = centre_of_mass(flow)
    flow.advance(0.1)
    assert start - centre_of_mass(flow) == pytest.approx(0.5 * GRAVITY * flow.time**2, rel=0.1)


def slope(degrees, depth, length):
    """A layer of liquid on a staircase of cells: fill, solid, distance down the slope."""
    angle = np.radians(degrees)
    top = int(1.5 * length * np.sin(angle)) + 4
    shape = (int(1.5 * length * np.cos(angle)) + 14, top + 2 * depth + 10, 3)
    x, y = np.meshgrid(*(np.arange(side) + 0.5 for side in shape[:2]), indexing="ij")
    above = (y - top + np.tan(angle) * x) * np.cos(angle)
    along = x * np.cos(angle) - (y - top) * np.sin(angle)
    full = np.clip(depth + 0.5 - above, 0.0, 1.0) * ((above > 0) & (along > 6) & (along < length))
    return [np.repeat(plane[..., None], 3, axis=2) for plane in (full, above < 0, along)]


def with_margin(solid):
    """Solid cells with the margin, in front and behind of which they go on."""
    return np.pad(np.pad(solid, ((1, 1), (1, 1), (0, 0))), ((0, 0), (0, 0), (1, 1)), mode="edge")


@pytest.mark.parametrize("depth", [2, 4])
@pytest.mark.parametrize("degrees", [15, 30, 60])
def test_thick_liquid_runs_down_a_staircase_as_down_a_slope(degrees, depth):
    # Nusselt's film on a wall that holds but doesn't suck: a thin layer must not come off it. The
    # staircase's treads hold as roughness does: 5 to 20 % slow.
    cell, viscosity, slip_length, angle = 0.01, 0.1, 0.02, np.radians(degrees)
    fill, solid, along = slope(degrees, depth, 60)
    normal = wall_normals(fill.shape, periodic=(False, False, True))
    normal[2, 1:-1, 1:-1, [0, -1]] = 1.0
    inner = with_margin(solid)
    normal[:, inner] = np.array([[np.sin(angle)], [np.cos(angle)], [0.0]])
    step, thickness = step_for(1.5, cell, viscosity), depth * cell
    wanted = 0.02 * cell / step
    mobility = thickness**2 / 3 + thickness * slip_length
    gravity = wanted * viscosity / (np.sin(angle) * mobility)
    flow = LatticeFlow(
        fill, solid, cell=cell, viscosity=viscosity, time_step=step, settings=LAMINAR,
        gravity=(0.0, -gravity, 0.0), normal=normal,
        slip=np.where(inner, slip_of(slip_length, cell), 1.0).astype(np.float32),
    )  # fmt: skip
    flow.advance(3.0 * thickness / wanted)
    mass, velocity = flow.grid("mass") * ((along > 30) & (along < 45)), flow.grid("velocity")
    found = mass.sum() / (3 * 15) * cell
    speed = (mass * (velocity[0] * np.cos(angle) - velocity[1] * np.sin(angle))).sum() / mass.sum()
    exact = gravity * np.sin(angle) * (found**2 / 3 + found * slip_length) / viscosity
    assert 0.75 * exact < speed < 1.05 * exact


def test_honey_on_a_floor_spreads_as_a_gravity_current():
    # Huppert (1982), J. Fluid Mech. 121: a volume q of a thick liquid in two dimensions reaches
    # 1.411 (g q^3 t / (3 nu))^(1/5).
    side, cell, viscosity = 24, 0.005, 0.02
    fill = np.zeros((110, 26, 3))
    fill[:side, :side] = 1.0
    flow = LatticeFlow(
        fill, empty(*fill.shape), cell=cell, viscosity=viscosity, **held_floor(fill.shape, 0.0)
    )
    rate = GRAVITY * (side * cell) ** 6 / (3.0 * viscosity)
    for reach in (2.5, 3.0, 3.5, 4.0):
        flow.advance((reach * side * cell / 1.411) ** 5 / rate)
        columns = flow.grid("mass").mean(axis=2).sum(axis=1)
        front = (np.flatnonzero(columns > 0.5).max() + 1) * cell
        assert front == pytest.approx(1.411 * (rate * flow.time) ** 0.2, rel=0.06)
    assert flow.droplets[6].sum() < 1e-3 * flow.mass


MARTIN_MOYCE = np.array(
    [
        (0.84, 1.22), (1.19, 1.44), (1.43, 1.67), (1.63, 1.89), (1.83, 2.11), (1.98, 2.33),
        (2.20, 2.56), (2.32, 2.78), (2.51, 3.00), (2.65, 3.22), (2.83, 3.44), (2.97, 3.67),
        (3.11, 3.89), (3.33, 4.11),
    ]
)  # fmt: skip
"""Front of a collapsing column twice as high as wide, after Martin & Moyce (1952), Phil. Trans. A
244: t sqrt(2 g / a), and the front over the column's width a = 5.715 cm."""


def dam_break(n):
    """Deviations of the front from the experiment, with n cells for the column's width."""
    width = 0.05715
    fill = np.zeros((6 * n, 3 * n, 4))
    fill[:n, : 2 * n] = 1.0
    flow = LatticeFlow(fill, empty(*fill.shape), cell=width / n, viscosity=WATER)
    fronts = []
    for moment in MARTIN_MOYCE[:, 0]:
        flow.advance(moment / np.sqrt(2 * GRAVITY / width))
        floor = flow.grid("fill")[:, 0].mean(axis=1)
        fronts.append((np.flatnonzero(floor >= 0.5).max() + 1) / n)
    return np.array(fronts) / MARTIN_MOYCE[:, 1] - 1.0


def assert_front(deviations):
    # Without friction on the floor the front leads at first, as it does in all such simulations.
    assert np.abs(deviations).mean() < 0.08
    assert np.abs(deviations).max() < 0.15
    assert np.abs(deviations[-8:]).max() < 0.10


def test_a_dam_breaks_as_in_the_experiment():
    assert_front(dam_break(16))


@pytest.mark.slow
def test_a_dam_breaks_as_in_the_experiment_with_finer_cells():
    assert_front(dam_break(40))


RITTER_STOKER_DEPTH = 16
"""Cells in the water's depth behind the dam."""


def broken_dam(bed, times):
    """Distances from a dam that broke, and depths there at some times [sqrt(depth / g)].

    All lengths are over the depth behind the dam; before it lies a `bed` of water.
    """
    n, cell = RITTER_STOKER_DEPTH, 0.002
    left, right = 12 * n, 18 * n
    fill = np.zeros((left + right, 20, 3))
    fill[:left, :n] = 1.0
    fill[left:] = np.clip(bed * n - np.arange(20), 0.0, 1.0)[:, None]
    flow = LatticeFlow(fill, empty(*fill.shape), cell=cell, viscosity=WATER)
    profiles = []
    for time in times:
        flow.advance(time * np.sqrt(n * cell / GRAVITY))
        profiles.append(flow.grid("mass").mean(axis=2).sum(axis=1) / n)
    return (np.arange(left + right) + 0.5 - left) / n, profiles


@pytest.mark.slow
def test_a_dam_breaks_on_a_dry_bed_as_ritters():
    # h = (2 - x / t)^2 / 9 (Ritter 1892), where it is deeper than two cells: what is thinner can't
    # run ahead on the grid, and piles up in a blunt front, as friction makes it do in experiments.
    x, (depth,) = broken_dam(0.0, [8.0])
    exact = np.clip(2.0 - x / 8.0, 0.0, 3.0) ** 2 / 9.0
    wave = (x > -8.0) & (exact > 2.0 / RITTER_STOKER_DEPTH)
    assert np.sqrt(np.mean((depth - exact)[wave] ** 2)) < 0.05
    assert depth[np.abs(x) < 0.2].mean() == pytest.approx(4.0 / 9.0, rel=0.05)
    # The front is ahead of where the exact depth is 1.5 cells, and behind the exact tip.
    front = x[depth > 1.0 / RITTER_STOKER_DEPTH].max() / 8.0
    assert 2.0 - 3.0 * np.sqrt(1.5 / RITTER_STOKER_DEPTH) < front < 2.0


def stoker(bed):
    """Depth between rarefaction and bore, and the bore's speed (Stoker 1957), for 1 behind."""
    low, high = bed, 1.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        jump = (middle - bed) * np.sqrt((middle + bed) / (2.0 * middle * bed))
        low, high = (middle, high) if 2.0 * (1.0 - np.sqrt(middle)) > jump else (low, middle)
    return low, 2.0 * (1.0 - np.sqrt(low)) * low / (low - bed)


@pytest.mark.slow
@pytest.mark.parametrize("bed", [0.1, 0.25, 0.45])
def test_a_dam_breaks_on_a_wet_bed_as_stokers(bed):
    # Shallow water has no time in which a bore forms, so that its speed counts from 4 to 10. Found
    # 9, 5 and 3 % too slow: a roller of some cells' height, on a bed of 2 to 7 cells.
    x, profiles = broken_dam(bed, [4.0, 10.0])
    exact, speed = stoker(bed)
    fronts = [x[depth > 0.5 * (exact + bed)].max() for depth in profiles]
    assert (fronts[1] - fronts[0]) / 6.0 == pytest.approx(speed, rel=0.12)
    between = (x > 10.0 * (2.0 - 3.0 * np.sqrt(exact)) + 1.0) & (x < fronts[1] - 2.0)
    assert profiles[1][between].mean() == pytest.approx(exact, rel=0.13)


def energy_lost(degrees, n):
    """Share of its energy that a sheet 12 times as long as deep has lost on meeting a face."""
    depth, speed = 0.015, 1.5
    cell, angle = depth / n, np.radians(degrees)
    foot = 14 * n
    shape = (foot + int(0.1 / cell / np.tan(angle)) + 10, int(0.26 / cell), 3)
    x, y = np.meshgrid(*(np.arange(side) + 0.5 for side in shape[:2]), indexing="ij")
    solid = np.repeat((y < (x - foot) * np.tan(angle))[..., None], 3, axis=2)
    fill = np.zeros(shape)
    fill[n : 13 * n, :n] = 1.0
    velocity = np.zeros((3, *shape))
    velocity[0] = speed * fill
    normal = wall_normals(shape)
    normal[:, with_margin(solid)] = np.array([[-np.sin(angle)], [np.cos(angle)], [0.0]])
    flow = LatticeFlow(fill, solid, cell=cell, viscosity=WATER, velocity=velocity, normal=normal)
    start = energy(flow)
    flow.advance(0.08)
    return 1.0 - energy(flow) / start


@pytest.mark.slow
def test_an_upright_face_takes_the_energy_of_the_blow_and_little_more():
    # A front that meets a wall all at once is stopped by an impulse (Cooker & Peregrine 1995): a
    # sheet of depth h and length L loses 2 sum (8 / ((2 k - 1) pi)^3) h / L = 0.54 h / L.
    blow = 0.543 / 12
    lost = [energy_lost(90, n) for n in (6, 12)]
    assert blow - 0.01 < lost[1] < lost[0] < blow + 0.07
    # What is lost beyond it is the grid's: it falls with the cell.
    assert lost[1] - blow < 0.65 * (lost[0] - blow)


@pytest.mark.slow
def test_a_slanted_face_takes_less_the_finer_the_cells():
    for degrees, most in ((30, 0.06), (75, 0.13)):
        lost = [energy_lost(degrees, n) for n in (6, 12)]
        assert 0.0 < lost[1] < 0.85 * lost[0]
        assert lost[0] < most


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [15, 30, 45])
def test_a_jet_on_a_slanted_plate_parts_by_its_momentum(degrees):
    # Without gravity or friction (1 + sin(angle)) / 2 of it goes down (Lamb 1932, section 76); found
    # within 0.03, with 8 and 16 cells across the jet.
    width, length, angle = 8, 10, np.radians(degrees)
    side = 14 * width
    middle = side * np.tan(angle) + 4.0
    shape = (2 * side, int(middle) + side + (length + 2) * width, 3)
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in shape[:2]), indexing="ij")
    above = (y - middle + np.tan(angle) * (x - side)) * np.cos(angle)
    along = (x - side) * np.cos(angle) - (y - middle) * np.sin(angle)
    jet = (np.abs(x - side) < width / 2) & (np.abs(y - middle - 6 * width) < length / 2 * width)
    fill, solid = (np.repeat(plane[..., None], 3, axis=2) for plane in (jet * 1.0, above < 0))
    velocity = np.zeros((3, *shape))
    velocity[1] = -fill
    normal = wall_normals(shape, periodic=(False, False, True))
    normal[2, 1:-1, 1:-1, [0, -1]] = 1.0
    normal[:, with_margin(solid)] = np.array([[np.sin(angle)], [np.cos(angle)], [0.0]])
    flow = LatticeFlow(
        fill, solid, cell=0.002, viscosity=WATER, velocity=velocity, normal=normal,
        gravity=(0.0, 0.0, 0.0),
    )  # fmt: skip
    flow.advance((length + 3) * width * flow.cell)
    mass = flow.grid("mass")
    down = mass[along > 0].sum() / mass.sum()
    assert down == pytest.approx((1.0 + np.sin(angle)) / 2.0, abs=0.04)


# Broken flows ------------------------------------------------------------------------


def pool(**changes):
    fill = np.zeros((6, 8, 3))
    fill[:, :4] = 1.0
    values = {"cell": 0.01, "viscosity": 1e-4, "time_step": 1e-4}
    return LatticeFlow(fill, empty(6, 8, 3), **(values | changes))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["populations", "mass"])  # velocity is found anew from them
@pytest.mark.parametrize("step", [1e-4, None], ids=["fixed step", "free step"])
def test_one_number_that_is_none_in_one_cell_raises(field, value, step):
    flow = pool(time_step=step, name="scene 'pool', water")
    flow.advance(1e-3)
    values = getattr(flow._cells, field)
    surface = flow.active[flow._cells.flags[flow.active] == INTERFACE][0]
    cell = surface if field == "mass" else flow.active[20]
    if field == "populations":
        values[:, cell, 5] = value
    else:
        values[..., cell] = value
    with pytest.raises(
        SimulationDivergedError, match=r"scene 'pool', water: diverged after .*LatticeSettings"
    ):
        flow.advance(flow.time + 0.1)


@pytest.mark.parametrize(
    ("share", "broken"), [(0.0, False), (9e-4, False), (1.1e-3, True), (0.5, True)]
)
@pytest.mark.parametrize("sign", [-1, 1])
def test_lost_or_new_mass_raises(share, broken, sign):
    flow = pool()
    flow._parts.owed[0] += sign * share * flow.mass / flow.cell**3
    if broken:
        with pytest.raises(SimulationDivergedError, match=r"its volume was 7.2e-05 m\^3, and is"):
            flow.advance(1e-2)
    else:
        flow.advance(1e-2)


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
@pytest.mark.parametrize("field", ["cell", "viscosity", "slip", "adhesion", "time_step"])
def test_a_flow_checks_itself(field, value):
    with pytest.raises(
        InputError, match=rf"liquid on a lattice: {field}: expected .*, found {value}"
    ):
        pool(**{field: value})
    with pytest.raises(InputError, match="smagorinsky must be at least 0, not nan"):
        LatticeSettings(smagorinsky=np.nan)


# Whole pours --------------------------------------------------------------------------

COARSE = lbm.LatticeBoltzmann(resolution=48)


def started(scene, liquid="water", solver=COARSE, threads=1):
    voxels = voxelise(scene, solver.resolution)
    return lbm.start_flow(
        scene, registry.resolve_liquid(liquid, scene), solver, voxels, threads
    ), voxels


def test_a_whole_pour_keeps_its_mass_and_never_gains_energy():
    # 0.5 % was asked for; energy may grow by what the surface lags behind in the fall (2 %).
    for scene in random_scenes(4):
        for liquid in ("water", "honey"):
            flow, _ = started(scene, liquid)
            volume, start = flow.mass, energy(flow)
            for moment in np.arange(0.1, 1.6, 0.25):
                flow.advance(moment)
                assert energy(flow) < 1.03 * start
            assert flow.mass == pytest.approx(volume, rel=1e-4)


def test_a_pour_comes_to_rest_below(ramp):
    flow, voxels = started(ramp)
    flow.advance(3.0)
    outcome, stranded = lbm.shares(flow, voxels, ramp)
    assert stranded < 0.02
    # The ramp throws it to the right.
    assert outcome > 0.6


def test_a_mirrored_scene_pours_its_mirror_image(ramp):
    # Exactly at first; where it splashes, the order of sums makes another splash of it.
    flow, _ = started(ramp)
    other, _ = started(ramp.mirrored())
    for one in (flow, other):
        one.advance(0.18)
    assert other.grid("fill")[::-1] == pytest.approx(flow.grid("fill"), abs=0.02)


def test_mirrored_scenes_have_mirrored_outcomes_on_the_whole():
    scenes = [scene for scene in random_scenes(8) if scene.goal.kind == "basins"]
    pairs = [
        (
            lbm.pour_to_end(scene, registry.WATER, COARSE, 1.5)[0],
            1.0 - lbm.pour_to_end(scene.mirrored(), registry.WATER, COARSE, 1.5)[0],
        )
        for scene in scenes
    ]
    differences = np.array([one - other for one, other in pairs])
    assert np.abs(differences).mean() < 0.12


def test_few_layers_and_their_mirror_images_fill_the_box(ramp):
    # Until it splashes (0.25 s) the flow is one in a plane: with any layers the same.
    solver = COARSE.model_copy(update={"layers": 3})
    flat, deep = (each.pour(ramp, registry.WATER, 0.2) for each in (solver, COARSE))
    for moment, whole in zip(flat.moments, deep.moments, strict=True):
        assert moment.fill.shape == whole.fill.shape
        assert moment.fill.astype(int) == pytest.approx(whole.fill.astype(int), abs=1)
    assert (flat.room == deep.room).all()
    assert flat.origin == deep.origin
    assert flat.outcome == pytest.approx(deep.outcome, abs=1e-4)
    assert flat.volume == pytest.approx(deep.volume, rel=1e-3)


@pytest.mark.parametrize("liquid", ["water", "honey"])
def test_front_and_back_are_mirrors(ramp, liquid):
    # What is the same through the depth stays so, also where front meets ceiling and floor.
    flow, _ = started(ramp, liquid)
    for moment in (0.02, 0.1, 0.15):
        flow.advance(moment)
        assert np.abs(np.diff(flow.grid("mass"), axis=-1)).max() < 1e-5


def test_drops_are_mirrored_with_their_layers():
    fill = np.zeros((2, 2, 3), np.uint8)
    fill[0, 0] = 10, 20, 30
    points = np.array([[0.5, 0.5, 3.25, 0.01]], np.float32)
    room = np.ones(fill.shape, np.float32)
    pour = RecordedPour((Moment(fill, points),), 1.0, (0.0, 0.0, 3.0), room, 0.5, 0.0)
    whole = lbm.mirrored_through(pour, 8.0)
    (moment,) = whole.moments
    assert moment.fill[0, 0].tolist() == [10, 20, 30, 30, 20, 10, 10, 20]
    assert whole.origin == (0.0, 0.0, 0.0)
    assert moment.points[:, 2] == pytest.approx([0.25, 5.75, 6.25])
    # A box thinner than the layers shows them all.
    assert lbm.mirrored_through(pour, 2.0).moments[0].fill.shape == (2, 2, 3)


def test_threads_change_nothing(ramp):
    solver = lbm.LatticeBoltzmann(resolution=170)
    flows = [started(ramp, solver=solver, threads=threads)[0] for threads in (1, 2)]
    for flow in flows:
        flow.advance(0.02)
    one, two = flows
    assert len(one.active) > 4096
    assert (one.grid("fill") == two.grid("fill")).all()
    assert (one.grid("velocity") == two.grid("velocity")).all()


def test_held_honey_is_slower_than_slipping_honey(ramp):
    # The paper's honey slips; `slip` 0 holds it, and leaves some on the ramp.
    left = []
    for slip in (1.0, 0.0):
        honey = replace(registry.HONEY_EXP1, slip=slip, slip_length=0.0, kinematic_viscosity=5e-3)
        left.append(lbm.pour_to_end(ramp, honey, COARSE, 1.0)[1])
    assert left[1] > left[0] + 0.1


def test_adhesion_pulls_liquid_to_a_ceiling():
    def fall(adhesion):
        fill = ball((12, 24, 4), (6, 24), 3.0)
        flow = LatticeFlow(
            fill, empty(*fill.shape), cell=0.005, viscosity=1e-4, slip=0.0, adhesion=adhesion
        )
        start = centre_of_mass(flow)
        flow.advance(0.05)
        return start - centre_of_mass(flow)

    assert fall(20.0) < 0.8 * fall(0.0)


# Drops --------------------------------------------------------------------------------


def test_what_is_smaller_than_a_cell_flies_and_lands():
    fill = np.zeros((12, 40, 6))
    fill[6, 35, 3] = 0.5
    flow = LatticeFlow(fill, empty(*fill.shape), cell=0.01, viscosity=WATER)
    assert flow.droplets.shape == (7, 1)
    height = flow.droplets[1, 0]
    flow.advance(0.15)
    assert height - flow.droplets[1, 0] == pytest.approx(0.5 * GRAVITY * flow.time**2, rel=0.05)
    flow.advance(1.0)
    (drop,) = flow.droplets.T
    assert drop[1] < flow.cell
    assert np.linalg.norm(drop[3:6]) < 0.05
    assert flow.mass == pytest.approx(0.5 * flow.cell**3)


def test_drops_that_meet_become_liquid_again():
    fill = np.zeros((3, 50, 3))
    fill[1, 2:49:2, 1] = 0.9
    flow = LatticeFlow(fill, empty(*fill.shape), cell=0.01, viscosity=WATER)
    before = flow.mass
    assert len(flow.active) == 0
    flow.advance(1.0)
    assert flow.grid("mass").sum() > 10.0
    assert flow.mass == pytest.approx(before, rel=1e-5)


# What it is told ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"courant": 0.5}, "courant must be in (0, 0.25]"),
        ({"compressibility": 0.0}, "compressibility must be in (0, 0.05]"),
        ({"smagorinsky": -0.1}, "smagorinsky must be at least 0"),
        ({"threads": 0}, "threads must be at least 1"),
    ],
)
def test_bad_settings_are_named(changes, said):
    with pytest.raises(InputError) as caught:
        LatticeSettings(**changes)
    assert said in str(caught.value)


def test_the_papers_liquids_have_the_viscosities_of_blenders_presets():
    # Section "Stimuli": "1.000", "2.000" and "100.0", read in the presets' exponents.
    for name, viscosity in {"water": 1e-6, "honey-exp1": 0.1, "honey-exp2": 2e-3}.items():
        liquid = registry.LIQUIDS.get(name)
        flow, voxels = started(random_scenes(1)[0], liquid)
        assert (flow.viscosity, flow.adhesion) == (viscosity, 0.0)
        # Obstacles, floor and side walls hold honey; front and back are planes of symmetry.
        assert (flow.slip[voxels.plane] == 1.0).all()
        assert (flow.slip[~voxels.plane] == 1.0).all() == (name == "water")


def test_a_slip_length_is_the_same_with_any_cells():
    for cell in (0.01, 0.002):
        share = slip_of(0.003, cell)
        # The wall's velocity over the shear between it and the middle of the cell beside it.
        assert share * 0.5 * cell / (1.0 - share) == pytest.approx(0.003)
