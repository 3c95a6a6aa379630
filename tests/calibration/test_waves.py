"""Waves are resumed, and the same seed gives the same; measured by a stand-in for the engine."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.calibration import report, space, waves
from benchmarks.calibration.measure import Measured
from benchmarks.calibration.targets import MODELS, VARIANCES, targets
from benchmarks.calibration.waves import Request, run_waves

from pourcast.errors import InputError

REQUEST = Request(waves=2, points=12, later_points=8, scenes=10, seed=3)

FEW = ("gravity / truth-water", "honey-marble / truth-honey", "water-ife", "truth-honey")


def stand_in(errand):
    """Judgments whose correlations follow two of the choices, and scatter with the errand's seed."""
    rng = np.random.default_rng(errand.seed)
    place = space.place_of(errand.point)
    truth, other = rng.normal(size=(2, errand.scenes))
    judgments = {
        name: ((0.2 + 0.7 * place[k % 2]) * truth + other * rng.normal(size=errand.scenes)).tolist()
        for k, name in enumerate(MODELS)
    }
    judgments["truth-water"] = truth.tolist()
    size = 0.02 * (1.0 + 4.0 * place[2])
    windows = {ife: (size * rng.normal(size=(5, errand.scenes))).tolist() for ife in VARIANCES}
    stays = {"truth-honey": 0.1 * float(place[3]), "truth-water": 0.0}
    return Measured(dict(errand.point), judgments, windows, stays, 64, 20, 7.0)


@pytest.fixture
def measured(monkeypatch):
    """The engine replaced by the stand-in, outputs by a few; what was measured."""
    did = []

    def measure_all(errands, workers, report=None):
        did.extend(errand.folder.parts[-2:] for errand in errands)
        return [stand_in(errand) for errand in errands]

    def few(pooled):
        return [target for target in targets(pooled) if target.name in FEW]

    monkeypatch.setattr(waves, "measure_all", measure_all)
    monkeypatch.setattr(waves, "targets", few)
    return did


@pytest.mark.slow
def test_the_same_seed_gives_the_same_points_wherever_it_was_interrupted(measured, tmp_path):
    left, at_once = run_waves(REQUEST, tmp_path / "a")
    run_waves(replace(REQUEST, waves=1), tmp_path / "b")
    left_resumed, resumed = run_waves(REQUEST, tmp_path / "b")
    assert left == left_resumed
    assert np.array_equal(at_once.places, resumed.places)
    assert np.array_equal(at_once.whole.places, resumed.whole.places)
    assert len(at_once.places) == 20
    assert report.recommend(at_once).point == report.recommend(resumed).point
    _, other = run_waves(replace(REQUEST, seed=4), tmp_path / "c")
    assert not np.array_equal(at_once.places, other.places)


def test_a_store_is_of_one_request(measured, tmp_path):
    run_waves(Request(waves=1, points=12, scenes=10), tmp_path)
    with pytest.raises(InputError, match="other scenes: take another --store"):
        run_waves(Request(waves=1, points=12, scenes=11), tmp_path)


@pytest.mark.parametrize("name", ["request.json", "wave-1.json", "wave-1-left.json"])
@pytest.mark.parametrize("text", ["{", "3", '{"a": 1}', '[["x"]]'])
def test_a_damaged_file_of_the_store_is_told_in_one_line(measured, tmp_path, name, text):
    if name == "request.json" and text.startswith('{"'):
        pytest.skip("it is a request, if another one")
    design = waves.first_design(12, len(space.CHOICES), 1)
    (tmp_path / "wave-1.json").write_text(json.dumps(design.tolist()))
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=name) as told:
        run_waves(Request(waves=2, points=12, scenes=10), tmp_path)
    assert "\n" not in str(told.value)


@pytest.mark.slow
def test_a_later_wave_is_drawn_where_least_is_implausible(measured, tmp_path):
    request = replace(REQUEST, points=40, scenes=60)
    _, first = run_waves(replace(request, waves=1), tmp_path)
    assert sum(one.foretells for one in first.emulators) >= 2
    assert min(first.whole.volume, first.correlated.volume) > waves.MUCH
    run_waves(replace(request, waves=2), tmp_path)
    drawn = np.array(json.loads((tmp_path / "wave-2.json").read_text()))
    assert len(drawn) == 8
    anywhere = np.random.default_rng(0).random((500, len(space.CHOICES)))
    for few, variances in ((drawn[:4], True), (drawn[4:], False)):
        largest = waves.statistic_of(first.emulators, first.targets, 1, variances=variances)
        assert largest(few).max() < np.quantile(largest(anywhere), 0.25)


def test_a_point_that_fails_is_left_out_and_counted(measured, tmp_path, monkeypatch):
    def fails_once(errands, workers, report=None):
        return [Measured({}, failure="broke"), *(stand_in(e) for e in errands[1:])]

    monkeypatch.setattr(waves, "measure_all", fails_once)
    (left,), wave = run_waves(Request(waves=1, points=12, scenes=10), tmp_path)
    assert left.failed == 1
    assert len(wave.emulators[0].residuals) == 11


@pytest.mark.slow
def test_the_report_says_what_was_found(measured, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "BASE_SAMPLE", 64)
    left, last = run_waves(REQUEST, tmp_path)
    text = report.write_report(left, last, REQUEST, tmp_path)
    assert all(choice.name in text for choice in space.CHOICES)
    assert "| 2 | 8 (0 failed) |" in text
    for name in ("sensitivity", "region", "trade-off"):
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
    point = space.read_point(tmp_path / "recommended.toml")
    assert space.world(point).engine is not None
    effects = report.sensitivity(last, seed=1)
    variance = effects.total[effects.outputs.index("variance, water-ife")]
    assert variance.argmax() == 2


def test_the_recommended_point_is_rounded_and_of_the_region(measured, tmp_path):
    _, wave = run_waves(REQUEST, tmp_path)
    best = report.recommend(wave)
    limit = waves.statistic_of(wave.emulators, wave.targets, 2)
    assert limit(space.place_of(best.point)[None]) <= 1.1 * wave.whole.cutoff
    for choice in space.CHOICES:
        assert choice.rounded(best.point[choice.name]) == best.point[choice.name]


def test_a_choice_can_be_held_from_any_wave_on(measured, tmp_path):
    held = space.read_held(["water.cohesion=0", "family.cell_count=99"])
    run_waves(replace(REQUEST, waves=1), tmp_path)
    first = (tmp_path / "wave-1.json").read_bytes()
    _, wave = run_waves(replace(REQUEST, held=held), tmp_path)
    assert (tmp_path / "wave-1.json").read_bytes() == first
    later = [space.point_at(place) for place in wave.places[12:]]
    assert len(later) == 8
    assert all((p["water.cohesion"], p["family.cell_count"]) == (0.0, 99) for p in later)
    best = report.recommend(wave, held)
    assert best.point["water.cohesion"] == 0.0
    assert best.point["family.cell_count"] == 99
    for word in ("water.colour=1", "water.cohesion=", "water.cohesion=2", "water.cohesion=much"):
        with pytest.raises(InputError, match=r"^hold: "):
            space.read_held([word])


def test_an_output_that_is_not_foretold_rules_nothing_out(measured, tmp_path):
    _, wave = run_waves(replace(REQUEST, waves=1), tmp_path)
    blind = [replace(one, explained=-1.0) for one in wave.emulators]
    anywhere = np.random.default_rng(0).random((50, len(space.CHOICES)))
    assert not waves.statistic_of(blind, wave.targets, 1)(anywhere).any()
    shown = report.sensitivity(replace(wave, emulators=blind), seed=1)
    assert np.isnan(shown.total).all()
    assert not shown.largest.any()
