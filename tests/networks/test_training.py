"""Learning: stages, what comes out, interruptions."""

import numpy as np
import pytest

from pourcast.errors import InputError, TrainingError
from pourcast.networks.backbones import make_backbone
from pourcast.networks.network import Network, Recipe
from pourcast.networks.training import learner, pair
from pourcast.networks.training.learner import Examples, Training, split, stages_of, train
from pourcast.progress import no_report
from tests.networks.make import SMALL, card_of, scenes_of
from tests.networks.test_data import digests

torch = pytest.importorskip("torch")


def examples(count, experiment="exp1", seed=7):
    scenes = scenes_of(experiment, count, seed)
    return Examples(scenes, np.random.default_rng(seed).uniform(0.0, 1.0, count))


def training(tmp_path, recipe, *, knows=False, seed=0, key="k"):
    return Training("learning", recipe, knows, seed, "cpu", key, tmp_path / "state.pt")


def fresh(recipe, seed=0):
    torch.manual_seed(seed)
    return make_backbone(recipe.backbone, recipe.height, recipe.width)


def test_overfits_32_scenes_and_obeys_the_mirror(tmp_path):
    some = examples(32)
    recipe = Recipe(
        height=48, width=32, batch=32, passes=50, patience=1.0, learning_rate=3e-3,
        weight_decay=0.0, least_zoom=1.0,
    )  # fmt: skip
    model = fresh(recipe)
    train(model, some, some, training(tmp_path, recipe))
    network = Network(model.eval(), card_of(recipe=recipe))
    judged = network.judge(some.scenes)
    assert np.corrcoef(judged, some.labels)[0, 1] > 0.99
    pairs = np.array([network.both(scene) for scene in some.scenes])
    assert np.abs(pairs[:, 0] - pairs[:, 1]).mean() < 0.05


def test_stages_go_from_the_last_layer_to_all():
    recipe = Recipe(passes=24, stage_passes=1, tuning_passes=10)
    stages = stages_of(recipe, 8, 2500, knows=True)
    assert [stage.layers for stage in stages] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert [stage.passes for stage in stages] == [2] * 7 + [20]
    (only,) = stages_of(recipe, 8, 10_000, knows=False)
    assert (only.layers, only.passes, only.rate) == (8, 24, recipe.learning_rate)


def test_layers_that_do_not_learn_stay_as_they_are(tmp_path, monkeypatch):
    some, recipe = examples(32), Recipe(**SMALL)
    model = fresh(recipe)
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    first = stages_of(recipe, 12, 64, knows=True)[:1]
    monkeypatch.setattr(learner, "stages_of", lambda *a, **k: first)
    train(model, some, some, training(tmp_path, recipe, knows=True))
    changed = [n for n, t in model.state_dict().items() if not torch.equal(t, before[n])]
    assert [name for name in changed if "num_batches" not in name] == list(before)[-2:]


def weights_after(tmp_path, recipe, report=no_report, seed=0, **options):
    some = examples(40)
    learned, validation = split(some, 0)
    model = fresh(recipe)
    epochs = train(
        model, learned, validation, training(tmp_path, recipe, seed=seed, **options), report
    )
    return {n: t.clone() for n, t in model.state_dict().items()}, epochs


def same(one, other):
    return all(torch.equal(one[name], other[name]) for name in one)


def test_interrupted_learning_ends_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr(learner, "KEEP_EVERY", 0.0)
    recipe = Recipe(**SMALL | {"patience": 1.0})
    whole, epochs = weights_after(tmp_path / "a", recipe, knows=True)
    assert len({epoch.stage for epoch in epochs}) == 8
    stops = {3, 12, 25, 33}

    class StoppedError(Exception):
        pass

    calls = 0

    def report(what, done, total):
        nonlocal calls
        calls += 1
        if calls in stops:
            raise StoppedError

    for _ in range(len(stops)):
        try:
            found, again = weights_after(tmp_path / "b", recipe, report, knows=True)
            break
        except StoppedError:
            continue
    else:
        found, again = weights_after(tmp_path / "b", recipe, knows=True)
    assert calls >= max(stops)
    assert same(found, whole)
    assert again == epochs


def test_the_same_seed_gives_the_same_bits(tmp_path):
    recipe = Recipe(**SMALL)
    first, _ = weights_after(tmp_path / "a", recipe)
    second, _ = weights_after(tmp_path / "b", recipe)
    other, _ = weights_after(tmp_path / "c", recipe, seed=1)
    assert same(first, second)
    assert not same(first, other)


def test_a_damaged_or_foreign_checkpoint_is_not_gone_on_with(tmp_path, monkeypatch):
    monkeypatch.setattr(learner, "KEEP_EVERY", 0.0)
    recipe = Recipe(**SMALL)
    first, _ = weights_after(tmp_path / "a", recipe)
    state = tmp_path / "a" / "state.pt"
    second, _ = weights_after(tmp_path / "a", recipe, key="other")
    assert same(first, second)
    state.write_bytes(state.read_bytes()[:50])
    third, _ = weights_after(tmp_path / "a", recipe)
    assert same(first, third)


def test_learning_stops_early_where_nothing_is_gained(tmp_path):
    some = examples(32)
    other = Examples(some.scenes, 1.0 - some.labels)
    recipe = Recipe(**SMALL | {"batch": 32, "passes": 4, "patience": 0.1})
    epochs = train(fresh(recipe), some, other, training(tmp_path, recipe))
    assert len(epochs) < 50


def test_learning_that_diverges_is_told(tmp_path):
    recipe = Recipe(**SMALL | {"learning_rate": 1e12})
    with pytest.raises(TrainingError, match=r"learning diverged in stage 1, pass .* lower"):
        weights_after(tmp_path, recipe)


def test_validation_scenes_are_none_of_the_training(tmp_path):
    some = examples(40)
    learned, validation = split(some, 0)
    assert len(validation.scenes) == 16
    assert set(digests(learned.scenes)) | set(digests(validation.scenes)) == set(
        digests(some.scenes)
    )
    assert not set(digests(learned.scenes)) & set(digests(validation.scenes))


def test_mirrored_pictures_have_mirrored_labels():
    from pourcast.networks.picture import View

    for experiment in ("exp1", "exp2"):
        some = examples(4, experiment)
        views = [View(mirrored=k % 2 == 0) for k in range(4)]
        expected = some.labels.copy()
        if experiment == "exp1":
            expected[::2] = 1.0 - expected[::2]
        assert (some.seen_in(views) == expected).all()


def test_a_device_that_is_not_there_is_named():
    assert pair.find_device("auto") in ("cpu", "cuda")
    with pytest.raises(InputError, match="device: 'abacus' can't be used"):
        pair.find_device("abacus")
