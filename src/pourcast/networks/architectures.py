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

LITE0_KEPT = 3
"""Rows of blocks that are kept: down to 40 channels, a place for every 8 pixels."""

LITE0_NEW = ((128, 128), (192, 192, 192))
"""Channels of the new convolutions after them: the last two groups of `convnet-small`."""


def convnet_small(nn: Any, height: int, width: int) -> Any:
    """Ours: eleven small convolutions, and a linear map of all that they make."""
    return nn.Sequential(*_small_layers(nn, 3, SMALL_WIDTHS, (height, width)))


def _small_layers(
    nn: Any, channels: int, groups: tuple[tuple[int, ...], ...], size: tuple[int, int]
) -> list[Any]:
    """Groups of convolutions, after each the picture is halved, and a linear map of all places."""
    layers: list[Any] = []
    for group in groups:
        for wide in group:
            convolution = nn.Conv2d(channels, wide, 3, padding=1, bias=False)
            layers += [convolution, nn.BatchNorm2d(wide), nn.ReLU(inplace=True)]
            channels = wide
        layers.append(nn.MaxPool2d(2))
    places = math.prod(max(1, pixels >> len(groups)) for pixels in size)
    return [*layers, nn.Flatten(), nn.Dropout(DROPOUT), nn.Linear(channels * places, 1)]


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
    """EfficientNet-Lite0's first rows of blocks, and new layers that say where liquid ends.

    Its upper rows are left out with the classes that they were for: in the same time, networks
    that keep more of them learn less (`docs/reference/convnet.md` has the trials). `new_layers`
    names what no weights of ImageNet are for.
    """
    nn = torch.nn
    body = lite0_body(torch, LITE0_KEPT)
    channels, size = LITE0_ROWS[LITE0_KEPT - 1][-1], (height, width)
    for stride in (2, *(row[2] for row in LITE0_ROWS[:LITE0_KEPT])):
        size = -(-size[0] // stride), -(-size[1] // stride)
    head = nn.Sequential(*_small_layers(nn, channels, LITE0_NEW, size))
    model = nn.Sequential(OrderedDict(**body, head=head))
    model.new_layers = "head"
    model.learn_together = [*_lite0_layers(model), [head]]
    return model


def lite0_body(torch: Any, rows: int = len(LITE0_ROWS)) -> dict[str, Any]:
    """Stem and so many rows of blocks, with the names of the package efficientnet-lite-pytorch.

    That package computes the same to the bit, a third slower, and is no longer kept.
    """
    nn = torch.nn
    return {
        "pad": _same_padding(torch, 3),
        "_conv_stem": nn.Conv2d(3, 32, 3, stride=2, bias=False),
        "_bn0": _normalisation(nn, 32),
        "relu0": nn.ReLU6(inplace=True),
        "_blocks": nn.Sequential(*(_bottleneck(torch, *sizes) for sizes in _lite0_blocks(rows))),
    }


def _lite0_blocks(rows: int) -> Iterator[tuple[int, int, int, int, int]]:
    """Of each block: width of the kernel, stride, expansion, channels in, channels out."""
    channels = 32
    for count, kernel, stride, expansion, wide in LITE0_ROWS[:rows]:
        for place in range(count):
            yield kernel, 1 if place else stride, expansion, channels, wide
            channels = wide


def _lite0_layers(model: Any) -> list[list[Any]]:
    """Modules of ImageNet's that learn in the same stage.

    The first group is the stem with both rows of blocks of high resolution, the second the last
    row that is kept.
    """
    blocks = list(model._blocks)
    last = len(blocks) - LITE0_ROWS[LITE0_KEPT - 1][0]
    return [[model._conv_stem, model._bn0, *blocks[:last]], blocks[last:]]


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
