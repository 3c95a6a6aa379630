"""A trained network: it judges scenes, and is kept as weights with a card beside them."""

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, field_validator

from pourcast.cores import available_cores
from pourcast.errors import InputError, one_line, unknown
from pourcast.extras import optional_module
from pourcast.files import replacing, write_text
from pourcast.frozen import Frozen
from pourcast.networks.backbones import make_backbone, torch_module
from pourcast.networks.picture import MIRRORED, STRAIGHT, Pictures, paint
from pourcast.progress import Progress, no_progress
from pourcast.scenes.liquids.registry import liquid_names
from pourcast.scenes.scene import Scene

SUFFIX = ".safetensors"


class Recipe(Frozen):
    """How a network is made.

    Parameters
    ----------
    backbone
        Its name; see `networks.backbones`.
    height, width
        Of the pictures that it is shown [pixels].
    start
        First weights: ``random``, ``imagenet`` (the usual download), or a file.
    passes
        Most passes through 10,000 training scenes from random first weights; fewer scenes are
        passed through more often, by the square root. There is only one stage then: nothing is
        yet in the lower layers that the upper ones could use.
    stage_passes, tuning_passes
        The same from weights that know something already: in each stage in which some layers
        learn, and in the last, when all do. With no `stage_passes`, all learn from the beginning.
    patience
        A stage ends after this share of its passes without a better validation error.
    batch
        Scenes in a step.
    learning_rate
        Highest learning rate when all layers learn from random weights.
    tuning_rate
        The same from weights that know something already.
    weight_decay
        AdamW's.
    least_zoom
        Pictures are zoomed at random, from this to 1, and stand anywhere in the room left.
    """

    backbone: str = "convnet-small"
    height: int = Field(default=96, ge=16, le=2048)
    width: int = Field(default=64, ge=16, le=2048)
    start: str = "random"
    passes: int = Field(default=24, ge=1)
    stage_passes: int = Field(default=1, ge=0)
    tuning_passes: int = Field(default=10, ge=1)
    patience: float = Field(default=0.4, gt=0.0, le=1.0)
    batch: int = Field(default=64, ge=2)
    learning_rate: float = Field(default=2e-3, gt=0.0)
    tuning_rate: float = Field(default=5e-4, gt=0.0)
    weight_decay: float = Field(default=0.2, ge=0.0)
    least_zoom: float = Field(default=0.7, gt=0.1, le=1.0)


class Epoch(Frozen):
    """A pass through the training scenes."""

    stage: int
    """Number of the stage, from 1."""
    layers: int
    """How many layers learned, counted from the last."""
    loss: float
    """Mean squared error on the training scenes, as they were shown."""
    validation_rmse: float
    validation_r: float | None
    """None where all judgments are the same."""


class HeldOut(Frozen):
    """How well the network does on scenes that had no part in its training."""

    scenes: int
    r: float | None
    rmse: float
    mirror: float
    """Mean difference between J and what the mirrored scene says, by the network alone."""
    truth: tuple[float, ...]
    judgments: tuple[float, ...]


class Card(Frozen):
    """Everything that made a network.

    Parameters
    ----------
    experiment, goal, liquid
        What it was trained for; the goal by its kind.
    drawn_from
        Statistics that its scenes were drawn by, and the filter.
    labelled_by
        The ground truth.
    scenes
        Training scenes; those for validation are among them.
    validation
        How many of them were for validation.
    seed
        Source of all randomness.
    filtered
        Whether scenes were dropped as for stimuli.
    recipe
        How it was made.
    first_weights
        What it started from, in words.
    licence
        Of the first weights, as far as it is known; what is made from them keeps to it.
    epochs
        How learning went.
    held_out
        How well it does.
    made_with
        Versions, device, precision.
    weights
        SHA-256 of the file of weights.
    """

    format: Literal["pourcast-convnet"] = "pourcast-convnet"
    schema_version: Literal[1] = 1
    experiment: str
    goal: str
    liquid: str
    drawn_from: str = ""
    labelled_by: str
    scenes: int
    validation: int
    seed: int
    filtered: bool
    recipe: Recipe
    first_weights: str
    licence: str = ""
    epochs: tuple[Epoch, ...]
    held_out: HeldOut | None
    made_with: dict[str, str]
    weights: str = ""

    @field_validator("liquid")
    @classmethod
    def _known(cls, liquid: str) -> str:
        if liquid not in liquid_names():
            raise ValueError(unknown(liquid, liquid_names()))
        return liquid


def card_path(path: Path) -> Path:
    """File of the card that belongs to a file of weights."""
    return path.with_suffix(".json")


def read_card(path: Path) -> Card:
    """Card of a file of weights, which are not looked into.

    Raises
    ------
    InputError
        If one of the two is missing, or the card is not valid.
    """
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: expected a trained network ({SUFFIX})")
    if not path.is_file():
        raise InputError(f"{path}: not there; `pourcast convnet train` makes networks")
    card = card_path(path)
    try:
        return Card.model_validate_json(card.read_bytes())
    except OSError as error:
        raise InputError(
            f"{card}: cannot be read ({error.strerror or error}); it belongs to {path.name}"
        ) from None
    except ValidationError as error:
        raise InputError(f"{card}: {one_line(error)}") from None


def in_words(card: Card) -> str:
    """Half a sentence about a network: what it is, what it started from, how well it does."""
    words = f"{card.recipe.backbone}, first weights {card.first_weights}, {card.scenes} scenes"
    if card.held_out is None or card.held_out.r is None:
        return words
    return f"{words}; r = {card.held_out.r:.2f} with the truth on {card.held_out.scenes} others"


@dataclass(frozen=True)
class Network:
    """A trained network.

    Parameters
    ----------
    model
        The torch module.
    card
        What made it.
    """

    model: Any
    card: Card

    def judge(
        self, scenes: Sequence[Scene], progress: Progress = no_progress
    ) -> NDArray[np.float64]:
        """Judge scenes: the mean of what the network says of the picture and its mirror image.

        Each scene is judged alone, on one core: a judgment has the same bits in any company, and
        on any number of cores.

        Parameters
        ----------
        scenes
            The scenes.
        progress
            Called with (done, in all).

        Raises
        ------
        InputError
            If a scene's goal is not that of the experiment it was trained for.
        """
        return judged(self.pairs(scenes, progress))

    def pairs(
        self, scenes: Sequence[Scene], progress: Progress = no_progress
    ) -> NDArray[np.float64]:
        """What the network says of pictures and of mirror images; see `judge` and `both`.

        Returns
        -------
        ndarray
            Shape [scene_count, 2].
        """
        self._check_goals(scenes)
        pairs = np.empty((len(scenes), 2))
        alone = partial(torch_module().set_num_threads, 1)
        with _one_thread(), ThreadPoolExecutor(available_cores(), initializer=alone) as pool:
            for k, said in enumerate(pool.map(self.both, scenes)):
                pairs[k] = said
                progress(k + 1, len(scenes))
        return pairs

    def both(self, scene: Scene) -> tuple[float, float]:
        """What the network says of a scene's picture, and of its mirror image; may leave 0..1."""
        size = self.card.recipe.height, self.card.recipe.width
        pictures = np.stack([paint(scene, *size, view) for view in (STRAIGHT, MIRRORED)])
        straight, mirrored = (float(said) for said in outputs(self.model, pictures))
        return straight, float(scene.goal.mirrored_judgment(mirrored))

    def _check_goals(self, scenes: Sequence[Scene]) -> None:
        known = self.card.goal
        for scene in scenes:
            if scene.goal.kind != known:
                raise InputError(
                    f"scene {scene.id!r}: the network was trained for {self.card.experiment} "
                    f"({known}), not for {scene.goal.kind}"
                )


def judged(pairs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Judgments from what a network says of pictures and of mirror images (`Network.pairs`)."""
    mean: NDArray[np.float64] = pairs.mean(axis=1)
    return np.clip(mean, 0.0, 1.0)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch compute on one core, so that its sums don't depend on the machine's number."""
    torch = torch_module()
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def outputs(model: Any, pictures: Pictures) -> NDArray[np.float64]:
    """What a module in evaluation mode says of pictures, shape [picture_count]."""
    model.eval()
    with torch_module().inference_mode():
        said = model(tensor_of(pictures, model))
    found: NDArray[np.float64] = said.flatten().double().cpu().numpy()
    return found


def tensor_of(pictures: Pictures, model: Any) -> Any:
    """Pictures as a network takes them: standardised as its backbone wants, on its device."""
    torch, device = torch_module(), next(model.parameters()).device
    mean, sd = (torch.tensor(v, device=device).view(1, 3, 1, 1) for v in model.colours)
    return (torch.from_numpy(pictures).to(device).float() / 255.0 - mean) / sd


def write_network(path: Path, network: Network) -> Card:
    """Write weights and card; both are whole or as they were before.

    Returns
    -------
    Card
        The card, with the weights' checksum.
    """
    save = optional_module("safetensors.torch", "convnet").save_file
    weights = {n: t.detach().cpu().contiguous() for n, t in network.model.state_dict().items()}
    with replacing(path) as temporary:
        save(weights, temporary)
        checksum = _checksum(temporary.read_bytes())
    card = network.card.model_copy(update={"weights": checksum})
    write_text(card_path(path), card.model_dump_json(indent=1) + "\n")
    return card


def read_network(path: Path) -> Network:
    """Read weights and card.

    Raises
    ------
    InputError
        If one is missing, damaged, or belongs to another network.
    """
    torch_module()
    card = read_card(path)
    load = optional_module("safetensors.torch", "convnet").load
    content = path.read_bytes()
    if _checksum(content) != card.weights:
        raise InputError(
            f"{path}: damaged, or not the weights that {card_path(path).name} belongs to "
            "(its checksum is wrong)"
        )
    recipe = card.recipe
    model = make_backbone(recipe.backbone, recipe.height, recipe.width)
    try:
        model.load_state_dict(load(content))
    except (RuntimeError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{path}: not the weights of {recipe.backbone} ({reason})") from None
    return Network(model.eval(), card)


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
