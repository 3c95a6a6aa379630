"""Emulators and history matching on simulators whose truth is known."""

import numpy as np
import pytest
from benchmarks.calibration.emulator import fit
from benchmarks.calibration.matching import (
    CUTOFF,
    distance,
    expected_misses,
    first_design,
    implausibilities,
    kth_largest,
    region,
    spread_out,
)
from benchmarks.calibration.targets import Target

from pourcast.errors import InputError

TRUTH = np.array([0.3, 0.7, 0.6, 0.2])
SPREAD = 0.05


def simulator(places):
    """Two outputs of four inputs, the last of which does nothing."""
    x = np.atleast_2d(places)
    return np.array([np.sin(3.0 * x[:, 0]) + x[:, 1], x[:, 1] * x[:, 2] - 0.5 * x[:, 0] ** 2])


def noisy(places, rng):
    return simulator(places) + SPREAD * rng.normal(size=(2, len(places)))


def emulators_of(places, rng):
    noise = np.full(len(places), SPREAD**2)
    return [fit(places, values, noise) for values in noisy(places, rng)]


def targets_at(place):
    values = simulator(place)[:, 0]
    return [Target(f"output {k}", "variance", v, v, 0.05**2) for k, v in enumerate(values)]


def test_an_emulator_recovers_a_function_and_knows_how_sure_it_is():
    rng = np.random.default_rng(1)
    emulators = emulators_of(first_design(60, 4, 1), rng)
    places = rng.random((400, 4))
    for emulator, truth in zip(emulators, simulator(places), strict=True):
        mean, variance = emulator.predict(places)
        assert np.sqrt(np.mean((mean - truth) ** 2)) < 0.2 * truth.std()
        assert 0.5 < np.sqrt(np.mean((mean - truth) ** 2 / variance)) < 1.6
        assert 0.7 < emulator.misfit < 1.4
        assert emulator.explained > 0.9
        assert emulator.foretells
        assert emulator.mean(places) == pytest.approx(mean)


def test_pure_noise_is_not_taken_for_a_function():
    rng = np.random.default_rng(2)
    places, noise = first_design(60, 4, 2), np.full(60, SPREAD**2)
    emulator = fit(places, SPREAD * rng.normal(size=60), noise)
    mean, _ = emulator.predict(rng.random((200, 4)))
    assert np.abs(mean).max() < SPREAD
    assert not emulator.foretells


def test_what_is_explained_is_of_points_that_the_emulator_has_not_seen():
    """Lengths that were fitted to all points "explain" permuted outputs, which have no function."""
    rng, places = np.random.default_rng(7), first_design(40, 5, 7)
    values = 2.0 * places[:, 0] + np.sin(4.0 * places[:, 1]) + 0.3 * rng.normal(size=40)
    noise = np.full(40, 0.3**2)
    real = fit(places, values, noise)
    assert real.foretells
    assert 0.4 < real.explained <= 1.1
    for _ in range(2):
        shuffled = fit(places, rng.permutation(values), noise)
        assert shuffled.explained < 2.0 * shuffled.error
        assert not shuffled.foretells
        mean, variance = shuffled.predict(rng.random((50, 5)))
        assert np.ptp(mean) == 0.0
        assert variance == pytest.approx(values.var() - 0.3**2)


def test_the_folds_of_a_seed_are_the_same():
    places, rng = first_design(30, 4, 8), np.random.default_rng(8)
    values = noisy(places, rng)[0]
    first, second = (fit(places, values, np.full(30, SPREAD**2), seed=5) for _ in range(2))
    assert np.array_equal(first.residuals, second.residuals)
    assert first.explained == second.explained


def test_too_few_points_are_told():
    with pytest.raises(InputError, match="at least 10 points with a value, found 3"):
        fit(first_design(3, 4, 1), np.arange(3.0), np.full(3, 0.01))


def test_a_choice_that_does_nothing_gets_the_longest_length():
    emulator = emulators_of(first_design(60, 4, 3), np.random.default_rng(3))[0]
    lengths = emulator.process.kernel_.k1.k2.k2.length_scale
    assert lengths[3] > 3.0 * lengths[0]


def test_missing_values_are_left_out():
    places = first_design(30, 4, 4)
    values = simulator(places)[0]
    values[5] = np.nan
    mean, _ = fit(places, values, np.full(30, 1e-4)).predict(places)
    assert np.isfinite(mean).all()


def test_history_matching_keeps_the_truth_and_shrinks_the_volume():
    rng, wanted = np.random.default_rng(5), targets_at(TRUTH)
    places, volumes = first_design(20, 4, 5), []
    for wave in range(3):
        emulators = emulators_of(places, rng)

        def statistic(where, emulators=emulators):
            return kth_largest(implausibilities(where, emulators, wanted), 1)

        left = region(statistic, 4, seed=wave, sample=1024)
        assert statistic(TRUTH[None]) <= CUTOFF
        assert statistic(left.places).max() <= CUTOFF
        volumes.append(left.volume)
        places = np.concatenate([places, spread_out(left.places, 20, seed=wave)])
    assert not left.empty
    assert volumes[2] < volumes[0] < 0.5
    far = np.abs(simulator(left.places) - simulator(TRUTH)).max(axis=0)
    assert np.median(far) < 0.25


def test_the_volume_of_a_small_ball_is_found():
    middle = np.array([0.4, 0.5, 0.6])

    def statistic(places):
        return CUTOFF / 0.05 * np.linalg.norm(places - middle, axis=1)

    left = region(statistic, 3, seed=6, sample=2048)
    exact = 4.0 / 3.0 * np.pi * 0.05**3
    assert exact / 1.6 < left.volume < exact * 1.6
    assert left.places.mean(axis=0) == pytest.approx(middle, abs=0.01)


def test_where_all_is_ruled_out_the_least_implausible_is_told_and_called_so():
    middle = np.array([0.4, 0.5])
    left = region(lambda x: 5.0 + np.linalg.norm(x - middle, axis=1), 2, seed=7, sample=512)
    assert left.empty
    assert left.cutoff > CUTOFF
    assert np.linalg.norm(left.places - middle, axis=1).max() < 0.05


def test_a_bound_counts_beyond_it_only():
    bound = Target("a / b", "bound", -1.0, 2.0, 1.0)
    assert distance(np.array([-1.5, 0.0, 2.5]), bound) == pytest.approx([0.5, 0.0, 0.5])


def test_the_kth_largest():
    values = np.array([[1.0, 9.0], [3.0, 2.0], [2.0, 5.0]])
    assert list(kth_largest(values, 1)) == [3.0, 9.0]
    assert list(kth_largest(values, 2)) == [2.0, 5.0]
    assert list(kth_largest(values, 7)) == [1.0, 2.0]


def test_who_is_unsure_is_no_good_advice():
    rng = np.random.default_rng(8)
    near = first_design(30, 4, 8) * 0.3
    emulators, wanted = emulators_of(near, rng), targets_at(np.full(4, 0.15))
    here, far = np.full((1, 4), 0.15), np.full((1, 4), 0.95)
    assert (
        expected_misses(far, emulators, wanted).max()
        > expected_misses(here, emulators, wanted).max()
    )


def test_the_same_seed_gives_the_same_region():
    def statistic(places):
        return 20.0 * np.linalg.norm(places - 0.5, axis=1)

    first, second = (region(statistic, 3, seed=9, sample=512) for _ in range(2))
    assert np.array_equal(first.places, second.places)


def test_points_are_spread_out():
    rng = np.random.default_rng(10)
    chosen = spread_out(rng.random((500, 2)), 20, seed=1)
    gaps = np.linalg.norm(chosen[:, None] - chosen, axis=2) + np.eye(20)
    assert gaps.min() > 0.08
