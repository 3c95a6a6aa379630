"""Within-person reliability: known answers, and intervals that hold what they should."""

import numpy as np
import pytest

from pourcast.statistics.retest import retest


def people(count, scenes, noise, rng, signal=0.2):
    """First and second answers: each person's own signal, and noise."""
    own = signal * rng.standard_normal((count, scenes))
    return tuple(own + noise * rng.standard_normal((count, scenes)) for _ in range(2))


def test_without_noise_people_agree_with_themselves():
    first, _ = people(8, 20, 0.0, np.random.default_rng(0))
    found = retest(first, first, 0.95)
    assert found.participants == 8
    assert found.trials == 160
    assert found.r[0] > 0.998
    assert found.noise == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_of_random_answers_all_is_noise():
    found = retest(*people(200, 40, 0.2, np.random.default_rng(1), signal=0.0), 0.95)
    assert found.r[1] < 0.0 < found.r[2]
    assert found.noise[1] < 1.0 < found.noise[2]


@pytest.mark.parametrize("noise", [0.1, 0.2, 0.4])
def test_the_share_of_noise_is_that_of_the_variances(noise):
    found = retest(*people(400, 60, noise, np.random.default_rng(2)), 0.95)
    share = noise**2 / (noise**2 + 0.04)
    assert found.noise[0] == pytest.approx(share, rel=0.05)
    assert found.r[0] == pytest.approx(1.0 - share, abs=0.02)


def test_a_shift_is_noise_but_lowers_no_correlation():
    first, _ = people(8, 20, 0.0, np.random.default_rng(3))
    found = retest(first, first + 0.1, 0.95)
    assert found.r[0] > 0.998
    assert found.noise[0] > 0.05


@pytest.mark.parametrize(("count", "scenes"), [(12, 30), (20, 12), (5, 10)])
def test_intervals_hold_the_truth_as_often_as_they_say(count, scenes):
    rng = np.random.default_rng(4)
    held = []
    for _ in range(300):
        found = retest(*people(count, scenes, 0.15, rng), 0.9)
        share = 0.15**2 / (0.15**2 + 0.04)
        held.append((found.noise[1] < share < found.noise[2], found.r[1] < 1 - share < found.r[2]))
    assert np.mean(held, axis=0) == pytest.approx([0.9, 0.9], abs=0.05)


def test_too_little_is_no_number():
    rng = np.random.default_rng(5)
    first, second = people(4, 10, 0.1, rng)
    few = retest(first, second, 0.95)
    assert 0.0 < few.r[0] < 1.0
    assert np.isnan([*few.r[1:], *few.noise[1:]]).all()
    second[:, 2:] = np.nan
    assert np.isnan(retest(first, second, 0.95).r).all()
    constant = np.full((6, 10), 0.5)
    assert np.isnan(
        [*retest(constant, constant, 0.95).r, *retest(constant, constant, 0.95).noise]
    ).all()


def test_who_repeated_too_little_does_not_count():
    first, second = people(10, 20, 0.1, np.random.default_rng(6))
    second[7:, 2:] = np.nan
    assert retest(first, second, 0.95) == retest(first[:7], second[:7], 0.95)
