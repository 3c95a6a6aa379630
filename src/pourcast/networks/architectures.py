"""The networks whose layers are written here; `backbones` knows them, and others', by name."""

import math
from collections import OrderedDict
from collections.abc import Iterator
from functools import partial
from typing import Any

SMALL_WIDTHS = ((24, 24), (48, 48), (96, 96), (128, 128), (192, 192, 192))
"""Channels of the convolutions of `convnet-small`; after each group the picture is halved."""

DROPOUT = 0.3

LITE0_ROWS = (
    (1, 3, 1, 1, 16), (2, 3, 2, 6, 24), (2, 5, 2, 6, 40), (3, 3, 2, 6, 80), (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192), (1, 3, 1, 6, 320),
)  # fmt: skip
"""EfficientNet-Lite0's blocks: how many, width of the kernel, stride of the first, expansion,
channels (Tan & Le 2019, table 1; Lite: `efficientnet_lite_builder.py` of tensorflow/tpu)."""

LITE0_STRIDE = 32
"""Pixels of the picture from one place of the last block to the next."""


def convnet_small(nn: Any, height: int, width: int) -> Any:
    """Ours: eleven small convolutions, and a linear map of all that they make."""
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


def alexnet(nn: Any) -> Any:
    """The paper's (Krizhevsky, Sutskever & Hinton 2012), in the form and names of torchvision."""
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


def efficientnet_lite0(torch: Any, height: int, width: int) -> Any:
    """EfficientNet-Lite0 up to its last block, and a linear map of all that this makes.

    Its own last layers, a convolution to 1280 channels and their mean over the picture, are left
    out with the classes that they were for: they hardly tell where things are, and a mean over
    the picture is nearly the same in a mirror.
    """
    nn = torch.nn
    body = lite0_body(torch)
    inputs = LITE0_ROWS[-1][-1] * math.prod(-(-size // LITE0_STRIDE) for size in (height, width))
    model = nn.Sequential(
        OrderedDict(
            **body, flatten=nn.Flatten(), dropout=nn.Dropout(DROPOUT), _fc=_linear(torch, inputs)
        )
    )
    model.learn_together = _lite0_layers(model)
    return model


def lite0_body(torch: Any) -> dict[str, Any]:
    """Stem and blocks, with the names of weights of the package efficientnet-lite-pytorch.

    That package computes the same to the bit, a third slower, and is no longer kept.
    """
    nn = torch.nn
    return {
        "pad": _same_padding(torch, 3),
        "_conv_stem": nn.Conv2d(3, 32, 3, stride=2, bias=False),
        "_bn0": _normalisation(nn, 32),
        "relu0": nn.ReLU6(inplace=True),
        "_blocks": nn.Sequential(*(_bottleneck(torch, *sizes) for sizes in _lite0_blocks())),
    }


def _lite0_blocks() -> Iterator[tuple[int, int, int, int, int]]:
    """Of each block: width of the kernel, stride, expansion, channels in, channels out."""
    channels = 32
    for count, kernel, stride, expansion, wide in LITE0_ROWS:
        for place in range(count):
            yield kernel, 1 if place else stride, expansion, channels, wide
            channels = wide


def _lite0_layers(model: Any) -> list[list[Any]]:
    """Modules that learn in the same stage: seven groups.

    The first is the stem with both rows of blocks of high resolution; then one row each, and
    the linear map.
    """
    blocks = iter(model._blocks)
    rows = [[next(blocks) for _ in range(row[0])] for row in LITE0_ROWS]
    first = [model._conv_stem, model._bn0, *rows[0], *rows[1]]
    return [first, *rows[2:], [model._fc]]


def _bottleneck(
    torch: Any, kernel: int, stride: int, expansion: int, channels: int, wide: int
) -> Any:
    """More channels, a convolution of each by itself, fewer channels; added to what came in."""
    nn, inner = torch.nn, channels * expansion
    parts: dict[str, Any] = {}
    if expansion > 1:
        parts["_expand_conv"] = nn.Conv2d(channels, inner, 1, bias=False)
        parts |= {"_bn0": _normalisation(nn, inner), "relu0": nn.ReLU6(inplace=True)}
    if stride > 1:
        parts["pad"] = _same_padding(torch, kernel)
    parts["_depthwise_conv"] = _depthwise(torch, inner, kernel, stride)
    parts |= {"_bn1": _normalisation(nn, inner), "relu1": nn.ReLU6(inplace=True)}
    parts["_project_conv"] = nn.Conv2d(inner, wide, 1, bias=False)
    parts["_bn2"] = _normalisation(nn, wide)
    if stride > 1 or channels != wide:
        return nn.Sequential(OrderedDict(parts))

    class Residual(nn.Sequential):  # type: ignore[misc, name-defined]
        def forward(self, x: Any) -> Any:
            return x + super().forward(x)

    return Residual(OrderedDict(parts))


def _normalisation(nn: Any, channels: int) -> Any:
    return nn.BatchNorm2d(channels, eps=1e-3)  # TensorFlow's, with which it was trained.


def _same_padding(torch: Any, kernel: int) -> Any:
    """TensorFlow's padding before a convolution of stride 2: what is odd goes to the far side."""

    class SamePadding(torch.nn.Module):  # type: ignore[misc]
        def forward(self, x: Any) -> Any:
            sides: list[int] = []
            for size in (x.shape[-1], x.shape[-2]):
                total = kernel - 2 + size % 2
                sides += [total // 2, total - total // 2]
            return torch.nn.functional.pad(x, sides)

    return SamePadding()


def _depthwise(torch: Any, channels: int, kernel: int, stride: int) -> Any:
    """A convolution of each channel by itself.

    While it learns it stays in float32 on a processor: PyTorch's gradient of it takes two to
    eight times as long with bfloat16.
    """

    class Depthwise(torch.nn.Conv2d):  # type: ignore[misc]
        def forward(self, x: Any) -> Any:
            if self.training and x.device.type == "cpu":
                with torch.autocast("cpu", enabled=False):
                    return super().forward(x.float())
            return super().forward(x)

    padding = kernel // 2 if stride == 1 else 0
    return Depthwise(channels, channels, kernel, stride, padding, groups=channels, bias=False)


def _linear(torch: Any, inputs: int) -> Any:
    """A linear map to one output, of inputs that are divided by the root of their number.

    AdamW moves all weights by equal steps: what a step does to the output grows with the number
    of inputs, and thousands of them make learning unstable at any rate that the layers below
    need.
    """

    class ScaledLinear(torch.nn.Linear):  # type: ignore[misc]
        def forward(self, x: Any) -> Any:
            return super().forward(x * self.in_features**-0.5)

    return ScaledLinear(inputs, 1)
