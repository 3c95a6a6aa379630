"""Judgments asked of a study: by objects, through its store, small work without other processes."""

from dataclasses import dataclass

import numpy as np
import pytest

from pourcast.errors import InputError
from pourcast.models.base import Model, parameter
from pourcast.models.registry import MODELS
from pourcast.prediction import predict
from pourcast.sweep import judgments
from pourcast.sweep.judgments import judge_in_study
from pourcast.sweep.store import Store
from tests.make import random_scenes

ASKED = [("water", "gravity"), ("honey", "ife:n_particles=15,zeta_sigma=1")]


@pytest.fixture
def opened(monkeypatch):
    """Numbers of workers of the executors that were opened."""
    numbers, make = [], judgments.make_executor

    def noted(kind, workers, *arguments):
        numbers.append(workers)
        return make(kind, workers, *arguments)

    monkeypatch.setattr(judgments, "make_executor", noted)
    return numbers


def test_small_work_needs_no_other_process_and_is_kept_all_the_same(tmp_path, opened, monkeypatch):
    scenes = random_scenes(3, seed=4)
    first = judge_in_study(tmp_path, scenes, ASKED, "mine")
    assert opened == []
    for liquid, spec in ASKED:
        expected = predict(scenes, [spec], liquid)["judgment"].to_numpy()
        assert (first[liquid, spec] == expected).all()
    files = Store(tmp_path / "sweep").paths()
    assert files

    def fail(*arguments, **options):
        raise AssertionError("something was simulated")

    monkeypatch.setattr("pourcast.sweep.shard.simulate", fail)
    again = judge_in_study(tmp_path, scenes, ASKED, "mine")
    assert all((again[key] == first[key]).all() for key in ASKED)
    assert Store(tmp_path / "sweep").paths() == files


def test_an_interrupted_small_study_goes_on_where_it_was(tmp_path, monkeypatch):
    scenes, shards = random_scenes(3, seed=4), []
    run = judgments.run_sweep

    class Interrupted:
        def __call__(self, now):
            shards.append(now.shards)
            if now.shards == 1:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        judge_in_study(tmp_path, scenes, ASKED, "mine", report=Interrupted())
    kept = Store(tmp_path / "sweep").paths()
    assert len(kept) == 1
    results = []
    monkeypatch.setattr(
        judgments, "run_sweep", lambda *a, **k: results.append(run(*a, **k)) or results[0]
    )
    judge_in_study(tmp_path, scenes, ASKED, "mine")
    assert results[0].reused_shards == 1
    assert kept.items() <= Store(tmp_path / "sweep").paths().items()


def test_larger_work_is_shared_among_processes(tmp_path, opened, monkeypatch):
    monkeypatch.setattr(judgments, "SMALL_WORK", 1e-6)
    scenes = random_scenes(2, seed=4)
    found = judge_in_study(tmp_path, scenes, ASKED[:1], "mine", workers=1)
    assert opened == [1]
    expected = predict(scenes, ["gravity"])["judgment"].to_numpy()
    assert (found["water", "gravity"] == expected).all()


@dataclass(frozen=True)
class Quoting(Model):
    """A model with a parameter that is any text, such as the name of a file."""

    text: str = parameter("", doc="any text")

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        return np.full(len(scenes), 0.25)


@pytest.mark.parametrize("text", ["a wave \U0001f30a", 'a "quote" \\', "a\u2028line", "[[models]]"])
def test_any_text_can_be_a_parameter(tmp_path, monkeypatch, text):
    class Entry:
        def load(self):
            return Quoting

    found_there = {MODELS.noun: {"quoting": Entry()}}
    monkeypatch.setattr(type(MODELS), "third_party", lambda self: found_there.get(self.noun, {}))
    spec = f"quoting:text={text}"
    found = judge_in_study(tmp_path, random_scenes(2, seed=4), [("water", spec)], "mine")
    assert found["water", spec].tolist() == [0.25, 0.25]


def test_wrong_requests_are_refused_before_anything_is_written(tmp_path):
    scenes = random_scenes(2, seed=4)
    for wanted, said in (
        (("watr", "gravity"), "liquid: there is no 'watr'"),
        (("water", "gravty"), "model: there is no 'gravty'"),
        (("water", "simple:g=2"), "SimpleSim: g: expected 0 to 1, found 2"),
    ):
        with pytest.raises(InputError, match=said):
            judge_in_study(tmp_path, scenes, [wanted], "mine")
    assert list(tmp_path.iterdir()) == []
