"""Scenes to learn from: drawn once, in pieces, labelled through a sweep's store."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from pourcast.errors import InputError
from pourcast.models.registry import make_model
from pourcast.networks.training import data
from pourcast.networks.training.data import PIECE, Draws, drawn_scenes, label_spec, truth_labels
from pourcast.scenes.liquids.registry import WATER
from pourcast.simulation.settings import EngineSettings
from pourcast.study import chosen, selection
from pourcast.study.experiments.registry import EXPERIMENTS
from tests.networks.make import scenes_of

SPEC = label_spec(EXPERIMENTS.get("exp1"), "water")


def digests(scenes):
    return [scene.digest for scene in scenes]


def test_the_first_scenes_are_the_same_however_many_are_drawn(tmp_path):
    draws = Draws("exp2", 5, filtered=False)
    few = drawn_scenes(tmp_path / "a", draws, 30)
    many = drawn_scenes(tmp_path / "a", draws, PIECE + 10)
    at_once = drawn_scenes(tmp_path / "b", draws, PIECE + 10)
    assert digests(few) == digests(many)[:30]
    assert digests(many) == digests(at_once)
    assert len(set(digests(many))) == len(many)
    assert len({scene.id for scene in many}) == len(many)


def test_held_out_scenes_are_others_and_filters_differ(tmp_path):
    lists = [
        Draws("exp1", 5), Draws("exp1", 5, stream="held-out"), Draws("exp1", 6),
        Draws("exp1", 5, filtered=False),
    ]  # fmt: skip
    found = [set(digests(drawn_scenes(tmp_path, draws, 12))) for draws in lists]
    assert len(set.union(*found)) >= 4 * 12 - 11
    assert found[0] != found[3]
    assert not found[0] & found[1]
    assert not found[0] & found[2]


def test_an_experiment_whose_scenes_are_drawn_otherwise_draws_anew(tmp_path, monkeypatch):
    draws = Draws("exp1", 5, filtered=False)
    before, name = drawn_scenes(tmp_path, draws, 3), draws.name
    experiment = EXPERIMENTS.get("exp1")
    changed = replace(experiment, family=replace(experiment.family, cell_count=90))
    monkeypatch.setattr(data, "EXPERIMENTS", SimpleNamespace(get=lambda name: changed))
    assert draws.name != name
    assert "cell_count=90" in draws.statistics
    after = drawn_scenes(tmp_path, draws, 3)
    assert not set(digests(before)) & set(digests(after))
    assert len(list(tmp_path.iterdir())) == 2


def test_scenes_that_were_filtered_otherwise_are_not_taken_for_todays(monkeypatch):
    filtered, plain = Draws("exp1", 5), Draws("exp1", 5, filtered=False)
    names = {filtered.name}
    unfiltered = plain.name
    rule = EXPERIMENTS.get("exp1").choice.rule
    with monkeypatch.context() as patch:  # the engine's own settings, which the rule leaves open
        patch.setattr(chosen, "EngineSettings", partial(EngineSettings, contact_radius=0.5))
        names.add(filtered.name)
        assert plain.name == unfiltered
    thicker = replace(WATER, viscosity_alpha=0.3)
    with monkeypatch.context() as patch:  # the liquid that its name means
        patch.setattr(selection, "resolve_liquid", lambda *_: thicker)
        names.add(filtered.name)
        assert plain.name == unfiltered
    for other in (
        replace(rule, max_stranded=0.01),
        replace(rule, settings=EngineSettings(step=1e-4)),
    ):
        with monkeypatch.context() as patch:
            experiment = EXPERIMENTS.get("exp1")
            changed = replace(experiment, choice=replace(experiment.choice, rule=other))
            patch.setattr(data, "EXPERIMENTS", SimpleNamespace(get=lambda _, one=changed: one))
            names.add(filtered.name)
            assert plain.name == unfiltered
    assert len(names) == 5
    assert filtered.name in names


def test_what_was_drawn_is_read_and_damage_is_told(tmp_path):
    draws = Draws("exp2", 5, filtered=False)
    first = drawn_scenes(tmp_path, draws, 5)
    (path,) = (tmp_path / draws.name).glob("*.json")
    assert digests(drawn_scenes(tmp_path, draws, 5)) == digests(first)
    path.write_text(path.read_text()[:100])
    with pytest.raises(InputError, match=r"0000\.json: not a JSON file"):
        drawn_scenes(tmp_path, draws, 5)


def test_labels_are_the_truths_and_made_once(tmp_path):
    scenes = scenes_of("exp1", 4)
    told = []
    labels = truth_labels(tmp_path, scenes, "water", SPEC, 1, lambda *words: told.append(words))
    model = make_model("ife:n_particles=100,damping_zeta=0,zeta_sigma=0,liquid=water")
    assert (labels == model.judge(scenes, WATER)).all()
    assert told
    told.clear()
    again = truth_labels(tmp_path, scenes, "water", SPEC, 1, lambda *words: told.append(words))
    assert (again == labels).all()
    assert not told
    with pytest.raises(InputError, match="there is no 'lava'"):
        truth_labels(tmp_path, scenes, "lava", SPEC)
