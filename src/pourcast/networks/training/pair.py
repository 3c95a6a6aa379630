"""The networks of an experiment: that of its first liquid, and the others, fine-tuned from it."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import pourcast
from pourcast.errors import InputError
from pourcast.files import check_writable
from pourcast.models.registry import presets
from pourcast.networks.backbones import (
    FirstWeights,
    backbone_of,
    imagenet_weights,
    make_backbone,
    take_over,
    torch_module,
    usual,
    weights_in,
)
from pourcast.networks.network import (
    SUFFIX,
    Card,
    HeldOut,
    Network,
    Recipe,
    judged,
    read_card,
    read_network,
    write_network,
)
from pourcast.networks.training.data import Draws, drawn_scenes, label_spec, truth_labels
from pourcast.networks.training.figure import draw_card
from pourcast.networks.training.learner import (
    Examples,
    Training,
    correlation,
    has_half_precision,
    split,
    train,
)
from pourcast.progress import Report, no_report
from pourcast.simulation.run import engine_version
from pourcast.study.experiments.base import Experiment
from pourcast.study.experiments.registry import EXPERIMENTS

TUNED_SHARE = 4
"""Of the scenes, one in so many is for the fine-tuned networks, too (paper: 2,500 of 10,000)."""

DEFAULT_BACKBONE = "efficientnet-lite0"

STARTS = ("random", "imagenet")
"""First weights that need no file."""

DEFAULT_SCENES = 10_000
HELD_OUT = 120

FEWEST_SCENES = 32

QUICK: dict[str, Any] = {"passes": 12, "stage_passes": 1, "tuning_passes": 6}
"""A first look: fewer passes."""


def default_recipe(backbone: str | None = None, **given: Any) -> Recipe:
    """Recipe of a backbone, with first weights and pictures as it is usually used.

    Parameters
    ----------
    backbone
        Its name; by default that of the file of first weights if `start` is one, and
        `DEFAULT_BACKBONE` otherwise.
    **given
        Other parameters of `Recipe`.

    Raises
    ------
    InputError
        If a value is out of its range, or a file of first weights can't be read.
    """
    if backbone is None:
        start = given.get("start", "imagenet")
        backbone = DEFAULT_BACKBONE if start in STARTS else backbone_of(Path(start))
    return Recipe(**{"backbone": backbone, **usual(backbone).recipe, **given})


@dataclass(frozen=True)
class NetworkRequest:
    """What networks are wanted.

    Parameters
    ----------
    experiment
        Name of the experiment.
    scenes
        Training scenes of the network of the experiment's first liquid (paper: 10,000).
    tuned_scenes
        Of its other liquids' networks, the first of the same; a quarter by default. 0 for none.
    recipe
        How they are made.
    seed
        Source of all randomness.
    filtered
        Whether scenes are dropped as for stimuli.
    held_out
        Scenes that the finished networks are tried on.
    """

    experiment: str
    scenes: int = DEFAULT_SCENES
    tuned_scenes: int | None = None
    recipe: Recipe = field(default_factory=default_recipe)
    seed: int = 0
    filtered: bool = True
    held_out: int = HELD_OUT

    def __post_init__(self) -> None:
        tuned = self._tuned_count or FEWEST_SCENES
        wanted = {"scenes": self.scenes, "tuned-scenes": tuned if self._others else FEWEST_SCENES}
        for name, count in wanted.items():
            if count < FEWEST_SCENES:
                raise InputError(f"{name}: expected at least {FEWEST_SCENES}, found {count}")

    def count(self, liquid: str) -> int:
        """Training scenes of a liquid's network."""
        return self.scenes if liquid == self.first_liquid else self._tuned_count

    @property
    def first_liquid(self) -> str:
        """Liquid whose network learns from the first weights; the others are tuned from it."""
        return self._experiment.shown_liquids[0]

    @property
    def liquids(self) -> list[str]:
        """Liquids that get a network."""
        return [liquid for liquid in self._experiment.shown_liquids if self.count(liquid)]

    @property
    def draws(self) -> Draws:
        """The list of scenes that its networks learn from."""
        return Draws(self.experiment, self.seed, self.filtered)

    @property
    def held_out_draws(self) -> Draws:
        """The list of scenes that they are tried on: always filtered, as stimuli are."""
        return Draws(self.experiment, self.seed, stream="held-out")

    def label_spec(self, liquid: str) -> str:
        """The ground truth that labels scenes for a liquid's network."""
        return label_spec(self._experiment, liquid)

    @property
    def _experiment(self) -> Experiment:
        return EXPERIMENTS.get(self.experiment)

    @property
    def _others(self) -> tuple[str, ...]:
        return self._experiment.shown_liquids[1:]

    @property
    def _tuned_count(self) -> int:
        if self.tuned_scenes is None:
            return max(FEWEST_SCENES, self.scenes // TUNED_SHARE)
        return self.tuned_scenes


def train_networks(
    folder: Path,
    request: NetworkRequest,
    *,
    data: Path | None = None,
    device: str = "auto",
    workers: int | None = None,
    report: Report = no_report,
) -> list[Path]:
    """Draw scenes, label them, train, try out, and write networks; goes on where it stopped.

    Parameters
    ----------
    folder
        Where to: for each liquid a network such as ``water.safetensors``, with its card (.json)
        and a picture (.png); ``work`` in it keeps half-trained networks.
    request
        What is wanted.
    data
        Where scenes and labels are kept; ``data`` in the folder by default.
    device
        Torch's name of what trains; ``auto``: a GPU if there is one.
    workers
        Processes that label; all cores by default.
    report
        Told of the progress.

    Returns
    -------
    list of Path
        The networks.

    Raises
    ------
    InputError
        If the folder holds other networks, or something is missing.
    StoreError, TrainingError
        If scenes can't be labelled, or a network doesn't learn.
    """
    torch_module()
    device = find_device(device)
    check_writable(folder / f"{request.first_liquid}.json")
    paths = {liquid: folder / f"{liquid}{SUFFIX}" for liquid in request.liquids}
    missing = [liquid for liquid, path in paths.items() if not _is_there(path, request, liquid)]
    labelled = _Labelled(data or folder / "data", request, workers, report)
    for liquid in missing:
        _train_one(folder, labelled, liquid, device, report)
    return list(paths.values())


def network_spec(liquid: str, path: Path) -> str:
    """Spec of a model that judges with a network: by the paper's name for it, if there is one.

    Examples
    --------
    >>> network_spec("water", Path("net/water.safetensors"))
    'water-convnet:weights=net/water.safetensors'
    """
    preset = f"{liquid}-convnet"
    return f"{preset if preset in presets() else 'convnet'}:weights={path}"


def find_device(name: str) -> str:
    """Torch's name of a device.

    Raises
    ------
    InputError
        If it is not there.
    """
    torch = torch_module()
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.empty(1, device=name)
    except Exception as error:  # Torch has many ways to say that there is none.
        reason = str(error).partition("\n")[0]
        raise InputError(f"device: {name!r} can't be used ({reason}); use auto or cpu") from None
    return name


def _wanted(request: NetworkRequest, liquid: str) -> dict[str, Any]:
    """What a card must say for its network to be the one that is wanted."""
    return {
        "experiment": request.experiment,
        "liquid": liquid,
        "drawn_from": request.draws.statistics,
        "labelled_by": f"{request.label_spec(liquid)} (engine {engine_version()})",
        "scenes": request.count(liquid),
        "seed": request.seed,
        "filtered": request.filtered,
        "recipe": request.recipe,
    }


def _is_there(path: Path, request: NetworkRequest, liquid: str) -> bool:
    """Whether a network is there already; another one is refused."""
    if not path.is_file():
        return False
    card, wanted = read_card(path), _wanted(request, liquid)
    found = {name: getattr(card, name) for name in wanted}
    if found != wanted:
        found |= found.pop("recipe").model_dump()
        wanted |= wanted.pop("recipe").model_dump()
        name = next(name for name in wanted if found[name] != wanted[name])
        raise InputError(
            f"{path}: there is a network already, made with other settings ({name}: "
            f"{found[name]}, not {wanted[name]}); choose another folder, or remove it"
        )
    return True


def _train_one(
    folder: Path, labelled: "_Labelled", liquid: str, device: str, report: Report
) -> None:
    path, request = folder / f"{liquid}{SUFFIX}", labelled.request
    model, first = _first(folder, request, liquid)
    examples, held_out = labelled.examples(liquid), labelled.held_out(liquid)
    learned_from, validation = split(examples, request.seed)
    wanted = _wanted(request, liquid)
    made_with = {
        "pourcast": pourcast.__version__,
        "torch": str(torch_module().__version__),
        "device": device,
        "precision": "bfloat16" if has_half_precision(device) else "float32",
    }
    words = [wanted | {"recipe": request.recipe.model_dump()}, first.source, made_with]
    key = hashlib.sha256(json.dumps(words).encode()).hexdigest()
    training = Training(
        name=f"learning {liquid}", recipe=request.recipe, knows=bool(first.tensors),
        seed=request.seed, device=device, key=key, checkpoint=folder / "work" / f"{liquid}.pt",
    )  # fmt: skip
    epochs = train(model, learned_from, validation, training, report)
    card = Card(
        **wanted, goal=examples.scenes[0].goal.kind, validation=len(validation.scenes),
        first_weights=first.source, licence=first.licence, epochs=tuple(epochs), held_out=None,
        made_with=made_with,
    )  # fmt: skip
    # As it will be when it is loaded, to the bit.
    model = model.to("cpu", memory_format=torch_module().contiguous_format)
    network = Network(model.eval(), card)
    tried = card.model_copy(update={"held_out": _tried(network, held_out, report)})
    write_network(path, Network(network.model, tried))
    draw_card(path.with_suffix(".png"), tried)
    training.checkpoint.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Labelled:
    """Scenes with labels, as a request wants them."""

    folder: Path
    request: NetworkRequest
    workers: int | None
    report: Report

    def examples(self, liquid: str) -> Examples:
        """What a network learns from."""
        return self._labelled(self.request.draws, self.request.count(liquid), liquid)

    def held_out(self, liquid: str) -> Examples:
        """What it is tried on."""
        return self._labelled(self.request.held_out_draws, self.request.held_out, liquid)

    def _labelled(self, draws: Draws, count: int, liquid: str) -> Examples:
        scenes = drawn_scenes(self.folder, draws, count, self.report)
        spec = self.request.label_spec(liquid)
        labels = truth_labels(self.folder, scenes, liquid, spec, self.workers, self.report)
        return Examples(scenes, labels)


def _first(folder: Path, request: NetworkRequest, liquid: str) -> tuple[Any, FirstWeights]:
    """A network before it learns, and what its weights are; no tensors: they know nothing."""
    torch, recipe = torch_module(), request.recipe
    torch.manual_seed(request.seed)
    model = make_backbone(recipe.backbone, recipe.height, recipe.width)
    first = request.first_liquid
    if liquid != first:
        learned = read_network(folder / f"{first}{SUFFIX}")
        tensors, card = learned.model.state_dict(), learned.card
        model.load_state_dict(tensors)
        source = f"the {first} network ({card.weights[:16]})"
        return model, FirstWeights(tensors, source, card.licence)
    weight, bias = list(model.parameters())[-2:]
    torch.nn.init.zeros_(weight)
    torch.nn.init.constant_(bias, 0.5)
    if recipe.start == "random":
        return model, FirstWeights({}, "random")
    weights = (
        imagenet_weights(recipe.backbone)
        if recipe.start == "imagenet"
        else weights_in(Path(recipe.start))
    )
    take_over(model, weights.tensors, recipe.start)
    return model, weights


def _tried(network: Network, held_out: Examples, report: Report) -> HeldOut:
    """What a finished network makes of scenes that it has never seen."""

    def tell(done: int, total: int) -> None:
        report("judging held-out scenes", done, total)

    pairs = network.pairs(held_out.scenes, tell)
    said = judged(pairs)
    return HeldOut(
        scenes=len(held_out.scenes),
        r=correlation(said, held_out.labels),
        rmse=float(np.sqrt(np.mean((said - held_out.labels) ** 2))),
        mirror=float(np.abs(pairs[:, 0] - pairs[:, 1]).mean()),
        truth=_rounded(held_out.labels),
        judgments=_rounded(said),
    )


def _rounded(values: Sequence[float] | Any) -> tuple[float, ...]:
    return tuple(round(float(value), 6) for value in values)
