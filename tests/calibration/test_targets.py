"""What the paper publishes, as targets."""

import numpy as np
import pytest
from benchmarks.calibration.measure import LEAST_VARIANCE, Measured, log_variance, output
from benchmarks.calibration.targets import (
    MODELS,
    VARIANCES,
    people_bounds,
    targets,
)

from pourcast.study.experiments.base import Published

ALL = targets(dict.fromkeys(VARIANCES, 4.0))


def test_bounds_of_the_water_ife_and_the_water_truth():
    low, high = people_bounds("water-ife", "truth-water")
    assert low == pytest.approx(0.444, abs=0.001)
    assert high == pytest.approx(0.945, abs=0.001)


def test_bounds_are_where_a_correlation_matrix_stops_being_one():
    column = {"a": Published(0.9, 0.8, 1.0), "b": Published(0.5, 0.4, 0.6)}
    for edge, inwards in zip(people_bounds("a", "b", {"people": column}), (1, -1), strict=True):
        for step, holds in ((0.001 * inwards, True), (-0.001 * inwards, False)):
            r = edge + step
            matrix = np.array([[1.0, 0.9, 0.5], [0.9, 1.0, r], [0.5, r, 1.0]])
            assert (np.linalg.eigvalsh(matrix).min() >= 0.0) == holds


def test_all_pairs_have_a_value_or_a_bound():
    pairs = [t for t in ALL if t.kind in ("correlation", "bound")]
    assert len(pairs) == len(MODELS) * (len(MODELS) - 1) // 2
    assert sum(t.kind == "correlation" for t in ALL) == 10
    assert all(t.low <= t.high for t in ALL)


def test_published_values_are_within_the_bounds_that_people_give():
    for target in ALL:
        if target.kind == "correlation":
            low, high = people_bounds(*target.name.split(" / "))
            assert low <= np.tanh(target.low) <= high


def test_the_sampling_of_120_scenes_is_part_of_the_tolerance():
    correlation = next(t for t in ALL if t.kind == "correlation")
    assert correlation.variance > 1.0 / 117
    variance = next(t for t in ALL if t.kind == "variance")
    assert np.exp(2.0 * np.sqrt(variance.variance)) == pytest.approx(2.2, abs=0.1)


def test_the_noise_of_a_logarithm_is_that_of_samples():
    rng = np.random.default_rng(1)
    draws = rng.exponential(0.01, (4000, 30))
    found = np.array([log_variance(one) for one in draws])
    assert found[:, 0].var() == pytest.approx(np.median(found[:, 1]) / 30, rel=0.3)
    assert found[:, 0].mean() == pytest.approx(np.log(0.01 + LEAST_VARIANCE), abs=0.02)


def test_outputs_of_what_was_measured():
    rng = np.random.default_rng(2)
    judgments = {name: rng.random(20).tolist() for name in MODELS}
    judgments["gravity"] = [0.5] * 20
    windows = {ife: rng.random((5, 20)).tolist() for ife in VARIANCES}
    one = Measured({}, judgments, windows, {"truth-honey": 0.2}, 64, 32, 6.0)
    named = {(t.name, t.kind): t for t in ALL}
    value, noise = output(one, named["honey-simple / truth-water", "correlation"], np.nan)
    r = np.corrcoef(judgments["honey-simple"], judgments["truth-water"])[0, 1]
    assert np.tanh(value) == pytest.approx(r)
    assert noise == pytest.approx(1.0 / 17)
    assert np.isnan(output(one, named["gravity / truth-water", "correlation"], np.nan)[0])
    assert output(one, named["truth-honey", "stranded"], np.nan)[0] == 0.2
    assert output(one, named["water-ife", "variance"], 4.0)[1] == pytest.approx(0.2)
    assert 0.0 <= one.flips("water-ife") <= 1.0
