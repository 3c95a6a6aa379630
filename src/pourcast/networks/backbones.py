"""Networks by name, with one linear output in place of their last layer.

`convnet-small` is ours; `alexnet` is the paper's (Krizhevsky, Sutskever & Hinton 2012, in the
form of torchvision, whose names of weights it has); any other name is a backbone of torchvision
or of timm, if that is installed.
"""

import hashlib
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from pourcast.errors import InputError
from pourcast.extras import optional_module

SMALL_WIDTHS = ((24, 24), (48, 48), (96, 96), (128, 128), (192, 192, 192))
"""Channels of the convolutions of `convnet-small`; after each group the picture is halved."""

DROPOUT = 0.3

ALEXNET_ADDRESS = "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth"
"""ImageNet's weights of AlexNet, as torchvision has them."""

OWN = ("convnet-small", "alexnet")

_SHAPES = {"convnet-small": (96, 64)}
_USUAL_SHAPE = (224, 224)


def usual_shape(name: str) -> tuple[int, int]:
    """Height and width of the pictures that a backbone is usually shown."""
    return _SHAPES.get(name, _USUAL_SHAPE)


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
        `convnet-small`, `alexnet`, or a name that torchvision or timm knows.
    height, width
        Of the pictures [pixels].

    Returns
    -------
    torch.nn.Module
        Takes pictures of shape [count, 3, height, width], gives [count, 1].

    Raises
    ------
    InputError
        If there is no such backbone, or the pictures are too small for it.
    """
    model = _by_name(name, height, width)
    torch = torch_module()
    try:
        with torch.inference_mode():
            model.eval()(torch.zeros(1, 3, height, width))
    except Exception as error:  # Each backbone has its own way to say so.
        reason = str(error).partition("\n")[0]
        raise InputError(f"size: {width}x{height} pixels don't suit {name} ({reason})") from None
    return model


def _by_name(name: str, height: int, width: int) -> Any:
    nn = torch_module().nn
    if name == "convnet-small":
        return _convnet_small(nn, height, width)
    if name == "alexnet":
        return _alexnet(nn)
    torchvision, timm = _installed("torchvision.models"), _installed("timm")
    if torchvision is not None and name in torchvision.list_models():
        model = torchvision.get_model(name, weights=None)
    elif timm is not None and timm.is_model(name):
        return timm.create_model(name, pretrained=False, num_classes=1)
    else:
        there = [n for n, m in (("torchvision", torchvision), ("timm", timm)) if m is not None]
        more = f", or any of {' and '.join(there)}" if there else "; torchvision and timm know more"
        raise InputError(f"backbone: there is no {name!r}; known: {', '.join(OWN)}{more}")
    return _with_one_output(model, nn)


def _installed(module: str) -> Any:
    try:
        return optional_module(module, "convnet")
    except InputError:
        return None


def _convnet_small(nn: Any, height: int, width: int) -> Any:
    layers: list[Any] = []
    channels = 3
    for group in SMALL_WIDTHS:
        for wide in group:
            convolution = nn.Conv2d(channels, wide, 3, padding=1, bias=False)
            layers += [convolution, nn.BatchNorm2d(wide), nn.ReLU(inplace=True)]
            channels = wide
        layers.append(nn.MaxPool2d(2))
    rows, columns = (max(1, size >> len(SMALL_WIDTHS)) for size in (height, width))
    last = nn.Linear(channels * rows * columns, 1)
    return nn.Sequential(*layers, nn.Flatten(), nn.Dropout(DROPOUT), last)


def _alexnet(nn: Any) -> Any:
    relu = partial(nn.ReLU, inplace=True)
    features = nn.Sequential(
        nn.Conv2d(3, 64, 11, stride=4, padding=2), relu(), nn.MaxPool2d(3, 2),
        nn.Conv2d(64, 192, 5, padding=2), relu(), nn.MaxPool2d(3, 2),
        nn.Conv2d(192, 384, 3, padding=1), relu(),
        nn.Conv2d(384, 256, 3, padding=1), relu(),
        nn.Conv2d(256, 256, 3, padding=1), relu(), nn.MaxPool2d(3, 2),
    )  # fmt: skip
    classifier = nn.Sequential(
        nn.Dropout(0.5), nn.Linear(256 * 6 * 6, 4096), relu(),
        nn.Dropout(0.5), nn.Linear(4096, 4096), relu(),
        nn.Linear(4096, 1),
    )  # fmt: skip
    for layer in (*features, *classifier):
        if hasattr(layer, "weight"):
            # He et al. (2015): without normalisation, signals fade with PyTorch's own weights,
            # and learning from random ones begins late or never.
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)
    parts = {
        "features": features,
        "avgpool": nn.AdaptiveAvgPool2d((6, 6)),
        "flatten": nn.Flatten(),
        "classifier": classifier,
    }
    return nn.Sequential(OrderedDict(parts))


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

    A layer is a convolution or a linear map, with the normalisation that follows it.
    """
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


def imagenet_weights(name: str) -> tuple[Mapping[str, Any], str]:
    """ImageNet's weights of a backbone by its usual download, and where they came from.

    Raises
    ------
    InputError
        If they can't be had.
    """
    torch = torch_module()
    torchvision, timm = _installed("torchvision.models"), _installed("timm")
    try:
        if name == "alexnet":
            load = torch.hub.load_state_dict_from_url
            return load(ALEXNET_ADDRESS, progress=False, check_hash=True), ALEXNET_ADDRESS
        if torchvision is not None and name in torchvision.list_models():
            weights = torchvision.get_model_weights(name).DEFAULT
            return weights.get_state_dict(progress=False, check_hash=True), weights.url
        if timm is not None and timm.is_model(name):
            return timm.create_model(name, pretrained=True).state_dict(), f"timm: {name}"
    except Exception as error:  # Each library has its own ways to fail without a network.
        raise InputError(
            f"start: ImageNet's weights of {name} can't be downloaded ({error}); give a file with "
            "--start FILE, or start from random weights with --start random"
        ) from None
    raise InputError(f"start: nobody has trained {name} on ImageNet; use --start random")


def weights_in(path: Path) -> tuple[Mapping[str, Any], str]:
    """Weights in a file of PyTorch (a state dict) or safetensors, and what names them.

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
    return state, f"{path.name}, sha256 {hashlib.sha256(content).hexdigest()[:16]}"


def take_over(model: Any, weights: Mapping[str, Any], source: str) -> None:
    """Take another network's weights, but for its last layer.

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
    kept = {name: tensor for name, tensor in weights.items() if not name.startswith(f"{last}.")}
    for name, tensor in own.items():
        if name.startswith(f"{last}."):
            continue
        if name not in kept or kept[name].shape != tensor.shape:
            found = f"it has the shape {tuple(kept[name].shape)}" if name in kept else "missing"
            raise InputError(
                f"{source}: not the weights of this backbone ({name}: expected the shape "
                f"{tuple(tensor.shape)}, {found})"
            )
    model.load_state_dict(own | {name: kept[name] for name in own if name in kept})


def last_layer(names: Iterable[str]) -> str:
    """Name of the last layer among a network's names of weights."""
    return list(names)[-1].rpartition(".")[0]
