"""Networks: contract, bits, files, backbones, and what is said of bad ones."""

import json
import urllib.error

import numpy as np
import pytest

from pourcast import cli
from pourcast.errors import InputError
from pourcast.models.registry import make_model
from pourcast.networks import backbones
from pourcast.networks.backbones import layers_of, make_backbone, take_over, weights_in
from pourcast.networks.network import Network, card_path, read_network, write_network
from pourcast.networks.training.pair import default_recipe
from pourcast.prediction import predict
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from tests.networks.make import random_network, scenes_of, written
from tests.test_models import check_contract
from tests.yardstick import ratio

torch = pytest.importorskip("torch")

ALEXNET = {
    "features.0": (64, 3, 11, 11), "features.3": (192, 64, 5, 5), "features.6": (384, 192, 3, 3),
    "features.8": (256, 384, 3, 3), "features.10": (256, 256, 3, 3),
    "classifier.1": (4096, 9216), "classifier.4": (4096, 4096), "classifier.6": (1000, 4096),
}  # fmt: skip
"""Names and shapes of torchvision's AlexNet."""


def imagenet_like():
    """Weights of the shape of ImageNet's AlexNet, made up."""
    generator = torch.Generator().manual_seed(3)
    weights = {}
    for name, shape in ALEXNET.items():
        weights[f"{name}.weight"] = torch.randn(shape, generator=generator) * 0.02
        weights[f"{name}.bias"] = torch.randn(shape[0], generator=generator) * 0.02
    return weights


@pytest.mark.parametrize("experiment", ["exp1", "exp2"])
def test_contract(experiment, tmp_path):
    path = written(tmp_path, experiment=experiment)
    check_contract(make_model(f"water-convnet:weights={path}"), scenes_of(experiment, 6, seed=11))


def test_a_mirrored_scene_has_a_mirrored_judgment():
    # By construction, but for edges' pixels: picture and mirror image are judged both.
    for experiment in ("exp1", "exp2"):
        network, scenes = random_network(experiment=experiment), scenes_of(experiment, 12, seed=12)
        here = network.judge(scenes)
        there = network.judge([scene.mirrored() for scene in scenes])
        expected = 1.0 - there if experiment == "exp1" else there
        assert np.abs(here - expected).mean() < 0.05


def test_judgments_have_the_same_bits_in_any_company_and_with_any_threads():
    network, scenes = random_network(), scenes_of("exp1", 6)
    whole = network.judge(scenes)
    assert np.std(whole) > 0.01
    assert (np.array([network.judge([scene])[0] for scene in scenes]) == whole).all()
    before = torch.get_num_threads()
    for threads in (1, 2, 3):
        torch.set_num_threads(threads)
        assert (network.judge(scenes) == whole).all()
        assert torch.get_num_threads() == threads
    torch.set_num_threads(before)


def test_saved_and_loaded_networks_agree_to_the_bit(tmp_path):
    network, scenes = random_network(), scenes_of("exp1", 6)
    write_network(tmp_path / "a.safetensors", network)
    again = read_network(tmp_path / "a.safetensors")
    assert (again.judge(scenes) == network.judge(scenes)).all()
    write_network(tmp_path / "b.safetensors", again)
    for suffix in (".safetensors", ".json"):
        first, second = (tmp_path / f"{name}{suffix}" for name in "ab")
        assert first.read_bytes() == second.read_bytes()


def test_a_trials_liquid_makes_no_difference(tmp_path):
    model = make_model(f"convnet:weights={written(tmp_path)}")
    scenes = scenes_of("exp1", 3)
    assert (model.judge(scenes, WATER) == model.judge(scenes, HONEY_EXP1, 5)).all()


@pytest.mark.slow
@pytest.mark.parametrize("backbone", backbones.OWN)
def test_120_scenes_take_little_more_than_the_network_itself(backbone):
    recipe = default_recipe(backbone)
    height, width = recipe.height, recipe.width
    network = random_network(recipe=recipe)
    bare, pair = make_backbone(backbone, height, width).eval(), torch.zeros(2, 3, height, width)
    scenes = scenes_of("exp1", 120)
    network.judge(scenes[:2])
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    with torch.inference_mode():
        found = ratio(lambda: network.judge(scenes), lambda: [bare(pair) for _ in scenes], times=2)
    torch.set_num_threads(before)
    # Measured: 1.2 and 1.3 times.
    assert found < 2.0


# Files -------------------------------------------------------------------------------


def complaint(spec, scenes):
    with pytest.raises(InputError) as caught:
        predict(scenes, [spec])
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_bad_files_get_one_clear_line(tmp_path):
    scenes, path = scenes_of("exp1", 1), written(tmp_path)
    spec = f"water-convnet:weights={path}"
    whole, card = path.read_bytes(), card_path(path).read_text()
    path.write_bytes(whole[:-100])
    assert "water.safetensors: damaged, or not the weights that water.json" in complaint(
        spec, scenes
    )
    path.write_bytes(b"")
    assert "damaged" in complaint(spec, scenes)
    path.write_bytes(whole)
    card_path(path).write_text(card.replace('"water"', '"lava"'))
    assert "water.json: liquid: there is no 'lava'" in complaint(spec, scenes)
    card_path(path).write_text(card[:40])
    assert "water.json: Invalid JSON" in complaint(spec, scenes)
    card_path(path).unlink()
    assert "water.json: cannot be read" in complaint(spec, scenes)
    path.unlink()
    assert "water.safetensors: not there; `pourcast convnet train`" in complaint(spec, scenes)
    other = f"water-convnet:weights={tmp_path / 'a.pth'}"
    assert "a.pth: expected a trained network (.safetensors)" in complaint(other, scenes)


def test_another_networks_card_gets_one_clear_line(tmp_path):
    path = written(tmp_path)
    card = json.loads(card_path(path).read_text())
    card["recipe"] |= {"backbone": "alexnet", "height": 96, "width": 96}
    card_path(path).write_text(json.dumps(card))
    said = complaint(f"water-convnet:weights={path}", scenes_of("exp1", 1))
    assert "water.safetensors: not the weights of alexnet" in said


def test_a_network_of_another_liquid_or_experiment_is_refused(tmp_path):
    path = written(tmp_path, liquid="honey")
    said = complaint(f"water-convnet:weights={path}", scenes_of("exp1", 1))
    assert "weights: expected a network of water, found one of honey" in said
    said = complaint(f"honey-convnet:weights={path}", scenes_of("exp2", 1))
    assert "the network was trained for exp1 (basins), not for cup" in said


def test_a_sweep_knows_another_network_of_the_same_name(tmp_path):
    from pourcast.sweep.judgments import judge_in_study

    scenes, path = scenes_of("exp1", 4), written(tmp_path)
    asked = ("water", f"water-convnet:weights={path}")
    first = judge_in_study(tmp_path, scenes, [asked], "g", workers=1)[asked]
    assert (first == predict(scenes, [asked[1]])["judgment"].to_numpy()).all()
    written(tmp_path, seed=1)
    second = judge_in_study(tmp_path, scenes, [asked], "g", workers=1)[asked]
    assert (first != second).any()
    assert (second == predict(scenes, [asked[1]])["judgment"].to_numpy()).all()


# Backbones ---------------------------------------------------------------------------


def test_alexnet_has_torchvisions_names_and_takes_its_weights(tmp_path):
    model, weights = make_backbone("alexnet", 224, 224), imagenet_like()
    assert list(model.state_dict()) == list(weights)
    torch.save(weights, tmp_path / "alexnet.pth")
    found = weights_in(tmp_path / "alexnet.pth")
    assert found.source.startswith("alexnet.pth, sha256 ")
    assert not found.licence
    before = model.state_dict()["classifier.6.weight"].clone()
    take_over(model, found.tensors, "alexnet.pth")
    now = model.state_dict()
    assert all(torch.equal(now[name], weights[name]) for name in list(now)[:-2])
    assert torch.equal(now["classifier.6.weight"], before)
    assert len(layers_of(model)) == 8


def test_wrong_weights_get_one_clear_line(tmp_path):
    model = make_backbone("convnet-small", 96, 64)
    with pytest.raises(InputError, match=r"f\.pth: not the weights of this backbone \(0\.weight"):
        take_over(model, imagenet_like(), "f.pth")
    for name, content in (("a.pth", b"nonsense"), ("a.safetensors", b"no"), ("b.pth", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match="not a file of weights") as caught:
            weights_in(tmp_path / name)
        assert "\n" not in str(caught.value)
    torch.save([1, 2], tmp_path / "list.pth")
    with pytest.raises(InputError, match="expected a state dict"):
        weights_in(tmp_path / "list.pth")


def test_a_download_that_fails_says_what_else_can_be_done(monkeypatch):
    def fail(*arguments, **options):
        raise urllib.error.URLError("no route")

    monkeypatch.setattr(torch.hub, "load_state_dict_from_url", fail)
    with pytest.raises(InputError, match=r"can't be downloaded .*no route.* --start FILE, or"):
        backbones.imagenet_weights("alexnet")
    with pytest.raises(InputError, match="nobody has trained convnet-small on ImageNet"):
        backbones.imagenet_weights("convnet-small")


def test_an_unknown_backbone_is_named(capsys, tmp_path):
    arguments = ["convnet", "train", "-e", "exp1", "--backbone", "alexnett", "-n", "40"]
    assert cli.run([*arguments, "-o", str(tmp_path / "net")]) == 2
    assert (
        "backbone: there is no 'alexnett'; known: efficientnet-lite0, convnet-small, alexnet"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "net" / "data").exists()


@pytest.mark.parametrize("name", ["resnet18", "mobilenet_v3_small", "vit_b_16", "resnet10t"])
def test_other_libraries_backbones(name):
    where = "timm" if name == "resnet10t" else "torchvision"
    pytest.importorskip(where)
    model = make_backbone(name, 224, 224)
    model.eval()
    with torch.inference_mode():
        assert model(torch.zeros(1, 3, 224, 224)).shape == (1, 1)
    assert len(layers_of(model)) > 8


def test_layers_are_counted_from_the_input():
    model = make_backbone("convnet-small", 96, 64)
    layers = layers_of(model)
    assert len(layers) == 12
    assert [len(layer) for layer in layers] == [3] * 11 + [2]
    assert sum(len(layer) for layer in layers) == len(list(model.parameters()))


def test_pictures_may_be_too_small():
    for name in ("convnet-small", "alexnet"):
        with pytest.raises(InputError, match=f"size: 20x96 pixels don't suit {name}") as caught:
            make_backbone(name, 96, 20)
        assert "\n" not in str(caught.value)


def test_a_network_is_what_its_card_says():
    network = random_network()
    assert isinstance(network, Network)
    assert network.card.recipe.backbone == "convnet-small"
