"""ConvNet: a network that never simulates, but has seen many pictures and what came of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import InputError
from pourcast.models.base import Model, parameter
from pourcast.networks.network import Network, in_words, read_card, read_network
from pourcast.progress import Progress, no_progress
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene


@dataclass(frozen=True)
class ConvNet(Model):
    """Regression from the picture of the starting scene to the judgment.

    Bates et al., section "Alternative models": AlexNet, pre-trained, one network for each liquid
    and experiment. `pourcast convnet train` makes them. The liquid shown and the seed are not
    used.
    """

    seconds_per_judgment: ClassVar[float] = 0.05

    weights: str = parameter("", doc="trained network, a .safetensors file with its card beside")
    liquid: str = parameter("any", doc="liquid that it must have been trained with")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.weights:
            raise InputError(
                "convnet: weights: expected a trained network, such as "
                "water-convnet:weights=net/water.safetensors (`pourcast convnet train` makes one)"
            )
        trained = read_card(Path(self.weights)).liquid
        if self.liquid not in ("any", trained):
            raise InputError(
                f"{self.weights}: weights: expected a network of {self.liquid}, found one of "
                f"{trained}"
            )

    @classmethod
    def follows_trial(cls, parameters: Mapping[str, Any]) -> bool:
        """No: the picture shows none of it."""
        return False

    @property
    def fingerprint(self) -> str:
        """Checksum of the weights: a file of the same name may be another network."""
        return read_card(Path(self.weights)).weights

    @property
    def remark(self) -> str:
        """Which network it is, from what first weights, and how well it learned."""
        return in_words(read_card(Path(self.weights)))

    def judge(
        self,
        scenes: Sequence[Scene],
        liquid: Liquid,
        seed: int = 0,
        *,
        progress: Progress = no_progress,
    ) -> NDArray[np.float64]:
        """Judge scenes by their pictures. See `Model.judge`."""
        return _network(self.weights, self.fingerprint).judge(scenes, progress)


@lru_cache(maxsize=4)
def _network(weights: str, fingerprint: str) -> Network:
    """A network, read once in a process as long as the file is the same."""
    network = read_network(Path(weights))
    if network.card.weights != fingerprint:
        raise InputError(f"{weights}: another network took its place just now")
    return network


MODEL = ConvNet
