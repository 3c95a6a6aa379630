"""From scenes to the engine: settings, errors, and the books of a batch."""

import pickle
import threading

import numpy as np
import pytest

from pourcast.engine.batch import available_cores, run_batch
from pourcast.engine.block import Block
from pourcast.engine.packing import pack_cylinder, reference_density, spacing_of
from pourcast.errors import InputError, SimulationDivergedError
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.scenes.scene import Box
from pourcast.simulation.pour import Pour
from pourcast.simulation.run import simulate
from pourcast.simulation.settings import EngineSettings
from tests.make import lattice_density, ramp_scene, random_scenes


def test_a_whole_number_of_steps_makes_a_frame_within_the_courant_limit():
    settings = EngineSettings()
    for count in (15, 50, 200, 2000):
        for liquid in (WATER, HONEY_EXP1):
            spacing = Pour(ramp_scene(), liquid, count).spacing
            stepping = settings.stepping("liquid", spacing, liquid.viscosity_alpha)
            assert stepping.frame == pytest.approx(1 / 30)
            h = 0.5 * settings.support_in_spacings * spacing
            speed = settings.sound_speed * (1 + 0.6 * liquid.viscosity_alpha)
            assert stepping.step <= min(settings.step, 0.4 * h / speed) * (1 + 1e-9)


@pytest.mark.parametrize("count", [0, -3, 2001])
def test_a_number_of_particles_out_of_range_is_refused(count):
    with pytest.raises(InputError, match=f"n_particles must be from 1 to 2000, not {count}"):
        simulate([Pour(ramp_scene(), WATER, count)])


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_liquid_checks_itself(value):
    with pytest.raises(InputError, match="viscosity_alpha: expected 0 to 10"):
        Liquid("odd", value)


def test_a_step_that_is_too_long_is_reported_not_returned():
    wild = EngineSettings(step=0.02, courant=1e20, sound_speed=1e12)
    with pytest.raises(SimulationDivergedError, match="the time step 0\\.0166667 s is too long"):
        simulate([Pour(ramp_scene(), WATER, 50)], settings=wild)


def test_an_error_in_the_second_worker_is_told_before_the_first_has_done_the_rest(monkeypatch):
    advance, workers, done = Block.advance, [], []
    both = threading.Barrier(2, timeout=60)

    def fail_in_the_second(*arguments):
        worker = threading.get_ident()
        if worker not in workers:
            workers.append(worker)
            both.wait()
        if worker == workers[1]:
            raise SimulationDivergedError("the second worker's")
        advance(*arguments)

    monkeypatch.setattr(Block, "advance", fail_in_the_second)
    pours = [Pour(ramp_scene(), WATER, 5)] * 500
    with pytest.raises(SimulationDivergedError, match="the second worker's"):
        simulate(pours, threads=2, progress=lambda count, _: done.append(count))
    assert len(done) < 250


def test_nothing_to_do_is_done():
    assert simulate([]) == []
    assert run_batch([], None, None) == []
    assert available_cores() >= 1


def test_progress_counts_every_pour():
    seen = []
    pours = [Pour(s, WATER, n) for s in random_scenes(3) for n in (5, 7)]
    outcomes = simulate(pours, progress=lambda *count: seen.append(count))
    assert sorted(seen) == [(k, 6) for k in range(7)]
    assert [len(o.position) for o in outcomes] == [5, 7] * 3


def test_frames_run_from_the_start_to_the_end():
    outcome = simulate([Pour(ramp_scene(), WATER, 30)], record=True)[0]
    assert outcome.frames.shape == (round(outcome.time * 30) + 1, 30, 3)
    assert (outcome.frames[-1] == outcome.position).all()
    centre = outcome.frames[0].mean(axis=0)
    assert centre[:2] == pytest.approx([0.4, 1.3], abs=0.005)
    assert simulate([Pour(ramp_scene(), WATER, 30)])[0].frames is None


def test_an_offset_moves_the_start():
    pours = [Pour(ramp_scene(), WATER, 20, offset=(0.05, -0.02))]
    settings = EngineSettings(max_duration=0.03)
    start = simulate(pours, settings=settings, record=True)[0].frames[0].mean(axis=0)
    assert start[:2] == pytest.approx([0.45, 1.28], abs=0.005)


@pytest.mark.parametrize("count", [1, 2, 15, 50, 200, 1000])
def test_the_packing_fills_the_cylinder_evenly(count):
    radius, depth = 0.074, 0.148
    place = pack_cylinder(count, (0.5, 1.0), radius, depth)
    again = pack_cylinder(count, (0.5, 1.0), radius, depth)
    assert (place == again).all()
    distance = np.hypot(place[:, 0] - 0.5, place[:, 1] - 1.0)
    assert distance.max() < radius
    assert place[:, 2].min() > 0
    assert place[:, 2].max() < depth
    if count >= 50:
        spacing = spacing_of(count, radius, depth)
        gaps = np.linalg.norm(place[:, None] - place[None], axis=2)[np.triu_indices(count, 1)]
        assert gaps.min() > 0.8 * spacing
        # Evenly full: the mean squared distance from the axis of a full cylinder.
        assert np.mean(distance**2) == pytest.approx(radius**2 / 2, rel=0.1)


def test_rest_density_is_that_of_the_bulk():
    spacing = spacing_of(1000, 0.074, 0.148)
    place = pack_cylinder(1000, (0.0, 0.0), 0.074, 0.148)
    assert reference_density(place, 2.3 * spacing, 0.148) == pytest.approx(
        lattice_density(2.3), rel=0.1
    )
    assert reference_density(place[:1], 0.1, 1e9) == 1.0


def test_a_start_has_hardly_any_energy_to_release():
    # Trap 1 of packings: without relaxation and calibration the blob bursts. In free fall,
    # it spreads by less than a twentieth in the 0.2 s before it meets anything.
    settings = EngineSettings(max_duration=0.3)
    for count in (20, 50, 200):
        frames = simulate(
            [Pour(ramp_scene(), WATER, count)], settings=settings, record=True
        )[0].frames  # fmt: skip
        width = np.ptp(frames[:, :, 0], axis=1)
        assert width[:7].max() < 1.05 * width[0]


def test_the_command_line_says_of_a_broken_pour_in_a_line_which_it_was(monkeypatch, capsys):
    from pourcast import cli

    def broken(*_, **__):
        raise SimulationDivergedError("scene 'ramp', 50 particles of 'water': diverged")

    monkeypatch.setattr("pourcast.prediction.judge_scenes", broken)
    status = cli.run(["predict", "examples/ramp.json", "-m", "ife"])
    assert status == 1
    assert capsys.readouterr().err == "pourcast: scene 'ramp', 50 particles of 'water': diverged\n"


def test_an_error_of_a_broken_pour_goes_from_process_to_process():
    error = pickle.loads(pickle.dumps(SimulationDivergedError("too fast", number=3)))
    assert (str(error), error.number) == ("too fast", 3)


@pytest.mark.parametrize("zeta", [-1.0, 201.0, float("nan"), float("inf")])
def test_a_damping_that_lets_nothing_fall_is_refused(zeta):
    with pytest.raises(InputError, match="damping_zeta: expected 0 to 200 per second"):
        Pour(ramp_scene(), WATER, 20, zeta)


def test_particles_wider_than_their_box_are_refused():
    scene = ramp_scene().model_copy(update={"box": Box(depth=0.002)})
    with pytest.raises(InputError, match=r"5 particles of its liquid are .* take more"):
        Pour(scene, WATER, 5)
