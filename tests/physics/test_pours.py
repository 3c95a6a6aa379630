"""Whole pours over many scenes: energy, solids, symmetry, the same bits, rest."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely

from pourcast.engine import block, sph
from pourcast.engine.batch import _broad_phase_of
from pourcast.engine.pairs import empty_pairs
from pourcast.engine.simd import LANES
from pourcast.scenes.goals.basins import Basins
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene import Box, LiquidStart, Scene
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import _job, _solids_of, simulate
from pourcast.simulation.settings import _RANGES, EngineSettings
from tests.make import OPEN_CHOICES, energy_of, loaded_block, ramp_scene, random_scenes

SHORT = EngineSettings(max_duration=1.5)


def test_energy_never_grows_in_200_scenes():
    # Kinetic + potential + elastic; contact pushes may add a little between two frames of 0.1 s:
    # at most 0.5 % of the 13 J/kg at the start (measured: 0.15 %).
    assert largest_gain(WATER, EngineSettings(), random_scenes(200)) < 0.005 * 13.0


@pytest.mark.parametrize("choice", OPEN_CHOICES)
def test_energy_never_grows_whatever_the_paper_leaves_open(choice):
    liquid, settings = OPEN_CHOICES[choice]
    assert largest_gain(liquid, settings, random_scenes(LANES)) < 0.005 * 13.0


ENDS = {
    field: _RANGES[field]
    for field in ("contact_radius", "contact_layer", "support_in_spacings", "damping_scale")
}


@pytest.mark.parametrize(("field", "end"), [(f, end) for f, ends in ENDS.items() for end in ends])
@pytest.mark.parametrize("liquid", [WATER, HONEY_EXP1], ids=lambda one: one.name)
def test_energy_never_grows_at_the_ends_of_the_ranges(liquid, field, end):
    # Measured over 200 scenes: 0.54 % for water in spheres of 0.6 spacings (0.65: 2 %, 0.7: 4 %),
    # none at the other ends.
    gain = largest_gain(liquid, EngineSettings(**{field: end}), random_scenes(LANES), zeta=1.0)
    assert gain < (0.007 if (field, end) == ("contact_radius", 0.6) else 0.005) * 13.0


@pytest.mark.parametrize("radius", _RANGES["marble_radius"])
def test_marbles_gain_no_energy_at_the_ends_of_their_radius(radius):
    # Kinetic and potential energy, halfway between frames. Measured over 32 scenes: 0.03 %.
    settings = EngineSettings(marble_radius=radius, max_duration=3.0)
    pours = [Pour(scene, WATER, 30, kind="marbles") for scene in random_scenes(LANES)]
    for outcome in simulate(pours, settings=settings, record=True):
        place = outcome.frames.astype(float)
        velocity = np.diff(place, axis=0) * settings.frame_rate
        height = (place[1:, :, 1] + place[:-1, :, 1]) / 2
        energy = (0.5 * (velocity**2).sum(axis=-1) + 9.81 * height).mean(axis=-1)
        assert np.max(energy - np.minimum.accumulate(energy)) < 0.005 * 13.0


def largest_gain(liquid, settings, scenes, zeta=0.0):
    """Largest gain of energy between two looks, 0.1 s apart, over the scenes [J/kg]."""
    largest = -np.inf
    for first in range(0, len(scenes), LANES):
        pours = [Pour(scene, liquid, 30, zeta) for scene in scenes[first : first + LANES]]
        solids, indices = _solids_of(pours)
        jobs = [_job(p, k, settings) for p, k in zip(pours, indices, strict=True)]
        with ThreadPoolExecutor(1) as pool:
            cells = _broad_phase_of(jobs, solids, pool, 1)
        state, lanes = loaded_block(jobs, 2e-4)
        before = None
        for _ in range(15):
            now = np.array([energy(one, state, lane) for lane, one in enumerate(jobs)])
            if before is not None:
                largest = max(largest, float(np.max(now - before)))
            before = now
            sph.advance(state, lanes, solids, cells, 2e-4, 500, empty_pairs(len(state.density)))
    return largest


def energy(one, state, lane):
    return energy_of(one, state.position[:, :, lane].T, state.velocity[:, :, lane].T)


@pytest.mark.parametrize("kind", ["liquid", "marbles"])
def test_no_centre_is_ever_inside_a_solid(kind):
    scenes = random_scenes(500, seed=7)
    outcomes = simulate(
        [Pour(s, WATER, 16, kind=kind) for s in scenes], settings=SHORT, record=True
    )
    assert_outside(scenes, outcomes)


def needle_scene(angle: float, tip_y: float) -> Scene:
    """A needle of one degree, straight below the liquid, and two that nearly meet below it."""

    def needle(x, y, turn, length=0.4):
        half = np.radians(0.5)
        base = [
            (float(x + length * np.sin(turn + d)), float(y - length * np.cos(turn + d)))
            for d in (-half, half)
        ]
        return (*base, (x, y))

    return Scene(
        id="needles",
        obstacles=(
            needle(0.5, tip_y, angle),
            needle(0.497, 0.62, -np.pi / 2 + 0.3),
            needle(0.503, 0.62, np.pi / 2 - 0.3),
        ),
        liquid=LiquidStart(centre=(0.5, 1.3)),
        goal=Basins(),
    )


@pytest.mark.parametrize("kind", ["liquid", "marbles"])
@pytest.mark.parametrize("liquid", [WATER, HONEY_EXP1], ids=["water", "honey"])
def test_no_centre_enters_a_needle_sharp_corner(kind, liquid):
    scenes = [needle_scene(a, y) for a in (-0.2, 0.0, 0.3) for y in (1.15, 1.0)]
    outcomes = simulate(
        [Pour(s, liquid, 60, kind=kind) for s in scenes], settings=SHORT, record=True
    )
    assert_outside(scenes, outcomes)


def assert_outside(scenes, outcomes):
    for scene, outcome in zip(scenes, outcomes, strict=True):
        solid = shapely.union_all([shapely.Polygon(p) for p in scene.solids]).buffer(-1e-6)
        x, y = outcome.frames[:, :, 0].ravel(), outcome.frames[:, :, 1].ravel()
        assert not shapely.contains_xy(solid, x, y).any(), scene.id
        assert x.min() > 0
        assert x.max() < scene.box.width
        assert y.min() > 0


def test_mirroring_a_scene_mirrors_the_judgment():
    # The packing is not mirrored, and one particle of 50 is 0.02: chaos moves a judgment by
    # 0.03 on average here (measured over 40 scenes), and not in one direction.
    scenes = random_scenes(60, seed=3)
    basins = [scene for scene in scenes if scene.goal.kind == "basins"]
    pours = [Pour(s, WATER, 50, 5.0) for s in (*basins, *(s.mirrored() for s in basins))]
    judged = np.array([outcome.judgment for outcome in simulate(pours)])
    here, there = np.split(judged, 2)
    difference = here - (1.0 - there)
    assert np.abs(difference).mean() < 0.06
    assert abs(difference.mean()) < 0.03
    assert np.corrcoef(here, 1.0 - there)[0, 1] > 0.97


def test_the_same_bits_alone_in_any_batch_and_on_any_number_of_threads():
    scenes = random_scenes(21, seed=5)
    pours = [Pour(s, WATER, 20, zeta) for s in scenes for zeta in (0.0, 5.0)]
    alone = [simulate([pour], settings=SHORT, threads=1)[0] for pour in pours[::7]]
    together = simulate(pours, settings=SHORT, threads=1)
    threaded = simulate(pours[::-1], settings=SHORT, threads=3)[::-1]
    for one, other in zip(together, threaded, strict=True):
        assert one.position.tobytes() == other.position.tobytes()
    for one, other in zip(alone, together[::7], strict=True):
        assert one.position.tobytes() == other.position.tobytes()
        assert (one.judgment, one.time) == (other.judgment, other.time)


@pytest.mark.parametrize("count", [310, 900])
def test_large_simulations_have_the_same_bits_on_any_number_of_threads(count):
    pours = [Pour(s, WATER, count) for s in random_scenes(3, seed=2)]
    settings = EngineSettings(max_duration=0.4)
    one, two = (simulate(pours, settings=settings, threads=n) for n in (1, 2))
    assert [o.position.tobytes() for o in one] == [o.position.tobytes() for o in two]


@pytest.mark.parametrize("count", [1, 2, 15, 300, 2000])
def test_any_number_of_particles_flows_to_the_floor(count):
    settings = EngineSettings(max_duration=1.2)
    outcome = simulate([Pour(ramp_scene(), WATER, count)], settings=settings)[0]
    assert outcome.position.shape == (count, 3)
    assert np.median(outcome.position[:, 1]) < 0.2
    assert 0.0 <= outcome.judgment <= 1.0


def test_marbles_at_rest_overlap_by_less_than_a_twentieth_of_a_radius():
    # A bin so narrow that the marbles pile up several deep.
    bin_ = Scene(
        id="bin",
        box=Box(width=0.2, height=1.0),
        liquid=LiquidStart(centre=(0.1, 0.8)),
        goal=Basins(divider_x=0.1, divider_width=0.02, divider_height=0.02),
    )
    for count in (25, 75):
        pour = Pour(bin_, WATER, count, kind="marbles")
        outcome = simulate([pour], settings=EngineSettings(max_duration=4.0))[0]
        gaps = np.linalg.norm(outcome.position[:, None] - outcome.position[None], axis=2)
        closest = gaps[np.triu_indices(count, 1)].min()
        radius = pour.spacing / 2
        assert 2 * radius - closest < 0.05 * radius


def test_a_pour_ends_by_itself_and_says_what_is_left_on_an_obstacle():
    shelf = Scene(
        id="shelf",
        obstacles=(
            ((0.2, 0.6), (0.6, 0.6), (0.6, 0.65), (0.2, 0.65)),
            ((0.2, 0.65), (0.25, 0.65), (0.25, 0.9), (0.2, 0.9)),
            ((0.55, 0.65), (0.6, 0.65), (0.6, 0.9), (0.55, 0.9)),
        ),
        liquid=LiquidStart(centre=(0.4, 1.2)),
    )
    caught = simulate([Pour(shelf, WATER, 50, 5.0)])[0]
    assert caught.settled
    assert caught.stranded == 1.0
    assert caught.touched == 1.0
    free = simulate([Pour(ramp_scene(), WATER, 50)])[0]
    assert free.settled
    assert free.stranded == 0.0
    assert free.time < 4.0


def test_the_early_end_does_not_change_judgments():
    # The rule "no particle has the head to climb the rim" against waiting for 6 s.
    scenes = random_scenes(40, seed=4)
    early = simulate(
        [Pour(s, WATER, 30) for s in scenes], settings=EngineSettings(max_duration=6.0)
    )
    margin, block.HEAD_MARGIN = block.HEAD_MARGIN, -1.0
    try:
        late = simulate(
            [Pour(s, WATER, 30) for s in scenes], settings=EngineSettings(max_duration=6.0)
        )
    finally:
        block.HEAD_MARGIN = margin
    settled = [k for k, outcome in enumerate(early) if outcome.settled]
    assert len(settled) > 20
    changed = [abs(early[k].judgment - late[k].judgment) for k in settled]
    assert np.mean(changed) < 0.01
