"""How a network learns: stage by stage, from pictures that are zoomed, moved and mirrored."""

import copy
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pourcast.errors import TrainingError
from pourcast.networks.backbones import layers_of, torch_module
from pourcast.networks.network import Epoch, Recipe, outputs, tensor_of
from pourcast.networks.picture import STRAIGHT, Pictures, View, paint
from pourcast.networks.training.checkpoint import load_checkpoint, save_checkpoint
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.statistics.correlation import pearson

Array = NDArray[np.float64]

KEEP_EVERY = 30.0
"""A half-trained network is kept as often [s]; one of AlexNet's takes a second or two."""

_ORDER, _VIEWS, _DROPOUT = range(3)
"""Parts of the seed."""


@dataclass(frozen=True)
class Examples:
    """Scenes and what the ground truth says of them.

    Parameters
    ----------
    scenes
        The scenes.
    labels
        Shape [scene_count], 0..1.
    """

    scenes: Sequence[Scene]
    labels: Array

    def some(self, places: NDArray[np.int64]) -> "Examples":
        """Those at some places."""
        return Examples([self.scenes[k] for k in places], self.labels[places])

    def pictures(self, recipe: Recipe, views: Sequence[View] | None = None) -> Pictures:
        """Pictures of all, straight by default."""
        views = views or [STRAIGHT] * len(self.scenes)
        size = recipe.height, recipe.width
        return np.stack([paint(s, *size, v) for s, v in zip(self.scenes, views, strict=True)])

    def seen_in(self, views: Sequence[View]) -> Array:
        """Labels of the pictures: in a mirror they may be others."""
        labels = zip(self.scenes, views, self.labels, strict=True)
        seen = [
            scene.goal.mirrored_judgment(label) if view.mirrored else label
            for scene, view, label in labels
        ]
        return np.array(seen)


@dataclass(frozen=True)
class Stage:
    """A part of the training.

    Parameters
    ----------
    number
        From 1.
    layers
        How many layers learn, counted from the last.
    passes
        Most passes through the training scenes.
    rate
        Highest learning rate.
    """

    number: int
    layers: int
    passes: int
    rate: float


FULL_SET = 10_000
"""Training scenes for which a recipe's passes are meant."""

MOST_REPEATS = 5
"""Fewer scenes are passed through at most so many times as often."""

MOST_STAGES = 8
"""Networks of many layers are unfrozen several layers at a time."""


def stages_of(
    recipe: Recipe, layer_count: int, scene_count: int = FULL_SET, *, knows: bool
) -> list[Stage]:
    """Stages of a training: first the last layer alone, then more and more, down to all.

    Parameters
    ----------
    recipe
        How a network is made.
    layer_count
        Layers of the network.
    scene_count
        Training scenes.
    knows
        Whether its first weights know anything. If not, there is only the last stage.

    Examples
    --------
    >>> [stage.layers for stage in stages_of(Recipe(), 5, knows=True)]
    [1, 2, 3, 4, 5]
    >>> [stage.layers for stage in stages_of(Recipe(), 50, knows=True)]
    [1, 8, 15, 22, 29, 36, 43, 50]
    >>> [stage.layers for stage in stages_of(Recipe(stage_passes=0), 5, knows=True)]
    [5]
    """
    more = min(MOST_REPEATS, np.sqrt(FULL_SET / scene_count))
    if not knows:
        return [Stage(1, layer_count, round(recipe.passes * more), recipe.learning_rate)]
    count = min(MOST_STAGES, layer_count)
    layers = [round(v) for v in np.linspace(1, layer_count, count)]
    passes = [recipe.stage_passes] * (count - 1) + [recipe.tuning_passes]
    learning = [(n, p) for n, p in zip(layers, passes, strict=True) if p > 0]
    return [
        Stage(k, n, round(p * more), recipe.tuning_rate)
        for k, (n, p) in enumerate(learning, start=1)
    ]


@dataclass(frozen=True)
class Training:
    """What is to be trained.

    Parameters
    ----------
    name
        What it is called in messages.
    recipe
        How.
    knows
        Whether the first weights know anything.
    seed
        Source of all randomness.
    device
        Torch's name of it.
    key
        Name of all that determines the result; see `save_checkpoint`.
    checkpoint
        File that keeps the state after a pass, if the last time is `KEEP_EVERY` ago.
    """

    name: str
    recipe: Recipe
    knows: bool
    seed: int
    device: str
    key: str
    checkpoint: Path


def train(
    model: Any,
    examples: Examples,
    validation: Examples,
    training: Training,
    report: Report = no_report,
) -> list[Epoch]:
    """Train a network; it ends with those weights that did best on the validation scenes.

    Parameters
    ----------
    model
        Torch module with first weights; changed in place.
    examples, validation
        What it learns from, and what tells how well.
    training
        How.
    report
        Told of the progress.

    Returns
    -------
    list of Epoch
        How learning went.

    Raises
    ------
    TrainingError
        If the error grows beyond all bounds.
    """
    return _Learner(model, examples, validation, training, report).run()


class _Learner:
    def __init__(
        self,
        model: Any,
        examples: Examples,
        validation: Examples,
        training: Training,
        report: Report,
    ) -> None:
        self._torch = torch_module()
        self._model = model.to(training.device, memory_format=self._torch.channels_last)
        self._examples, self._validation, self._training = examples, validation, training
        self._report = report
        self._recipe = training.recipe
        self._layers = layers_of(model)
        count = len(examples.scenes) + len(validation.scenes)
        self._stages = stages_of(self._recipe, len(self._layers), count, knows=training.knows)
        self._shown = validation.pictures(self._recipe)
        self._epochs: list[Epoch] = []
        self._best: tuple[float, dict[str, Any]] = np.inf, {}
        self._kept = time.monotonic()
        self._steps = max(1, len(examples.scenes) // self._recipe.batch)

    def run(self) -> list[Epoch]:
        """All stages, from where an earlier run stopped."""
        kept = load_checkpoint(self._training.checkpoint, self._training.key)
        if kept is not None:
            self._epochs = [Epoch(**epoch) for epoch in kept["epochs"]]
            self._best = kept["best"], kept["best_weights"]
        begun = self._epochs[-1].stage if self._epochs else 1
        for stage in self._stages[begun - 1 :]:
            self._learn(stage, kept)
            kept = None
            self._model.load_state_dict(self._best[1])
        self._model.eval()
        return self._epochs

    def _learn(self, stage: Stage, kept: dict[str, Any] | None) -> None:
        """One stage; early stopping counts within it."""
        learning = _unfreeze(self._model, self._layers, stage.layers)
        optimiser = self._torch.optim.AdamW(
            learning, lr=stage.rate, weight_decay=self._recipe.weight_decay
        )
        schedule = self._torch.optim.lr_scheduler.OneCycleLR(
            optimiser, stage.rate, total_steps=stage.passes * self._steps + 1
        )
        own = [epoch for epoch in self._epochs if epoch.stage == stage.number]
        if kept is not None:
            self._model.load_state_dict(kept["weights"])
            optimiser.load_state_dict(kept["optimiser"])
            schedule.load_state_dict(kept["schedule"])
        for number in range(len(own), stage.passes):
            if _has_stopped(own, max(2, round(self._recipe.patience * stage.passes))):
                return
            loss = self._pass(stage, number, optimiser, schedule)
            epoch = self._judged(stage, number, loss)
            own.append(epoch)
            self._epochs.append(epoch)
            self._keep(optimiser, schedule)

    def _pass(self, stage: Stage, number: int, optimiser: Any, schedule: Any) -> float:
        """One pass through the training scenes; returns the mean loss."""
        torch = self._torch
        words = self._training.seed, stage.number, number
        torch.manual_seed(_seed(_DROPOUT, *words))
        _learning_mode(self._model, stage.layers == len(self._layers))
        losses: list[float] = []
        for step, (pictures, labels) in enumerate(self._batches(words)):
            self._tell(stage, number, step, losses)
            shown = tensor_of(pictures, self._model)
            shown = shown.to(memory_format=torch.channels_last)
            wanted = torch.from_numpy(labels).float().to(self._training.device)
            with half_precision(self._training.device):
                said = self._model(shown).flatten()
            loss = (said.float() - wanted).square().mean()
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            schedule.step()
            losses.append(float(loss.detach()))
            self._check(losses[-1], stage, number)
        return float(np.mean(losses))

    def _batches(self, words: tuple[int, ...]) -> Iterator[tuple[Pictures, Array]]:
        """Batches of a pass, painted as they are needed; what is left over waits for the next."""
        batch, count = self._recipe.batch, len(self._examples.scenes)
        order = np.random.default_rng(_seed(_ORDER, *words)).permutation(count)
        rng = np.random.default_rng(_seed(_VIEWS, *words))
        for first in range(0, max(1, count - batch + 1), batch):
            chosen = self._examples.some(order[first : first + batch])
            views = [self._random_view(rng) for _ in chosen.scenes]
            yield chosen.pictures(self._recipe, views), chosen.seen_in(views)

    def _random_view(self, rng: np.random.Generator) -> View:
        zoom = rng.uniform(self._recipe.least_zoom, 1.0)
        return View(zoom, (rng.uniform(), rng.uniform()), bool(rng.integers(2)))

    def _judged(self, stage: Stage, number: int, loss: float) -> Epoch:
        """The pass, with how the validation scenes are judged after it."""
        said = np.concatenate(
            [
                outputs(self._model, self._shown[k : k + self._recipe.batch])
                for k in range(0, len(self._shown), self._recipe.batch)
            ]
        )
        rmse = float(np.sqrt(np.mean((said - self._validation.labels) ** 2)))
        self._check(rmse, stage, number)
        if rmse < self._best[0]:
            self._best = rmse, copy.deepcopy(self._model.state_dict())
        return Epoch(
            stage=stage.number, layers=stage.layers, loss=loss, validation_rmse=rmse,
            validation_r=correlation(said, self._validation.labels),
        )  # fmt: skip

    def _check(self, error: float, stage: Stage, number: int) -> None:
        if not np.isfinite(error):
            raise TrainingError(
                f"{self._training.name}: learning diverged in stage {stage.number}, pass "
                f"{number + 1}; a lower --learning-rate may help"
            )

    def _keep(self, optimiser: Any, schedule: Any) -> None:
        if time.monotonic() - self._kept < KEEP_EVERY:
            return
        content = {
            "epochs": [epoch.model_dump() for epoch in self._epochs],
            "weights": self._model.state_dict(),
            "best": self._best[0],
            "best_weights": self._best[1],
            "optimiser": optimiser.state_dict(),
            "schedule": schedule.state_dict(),
        }
        save_checkpoint(self._training.checkpoint, self._training.key, content)
        self._kept = time.monotonic()

    def _tell(self, stage: Stage, number: int, step: int, losses: list[float]) -> None:
        before = sum(s.passes for s in self._stages[: stage.number - 1])
        words = f"{self._training.name}: stage {stage.number} of {len(self._stages)}"
        if losses:
            words += f", loss {np.mean(losses[-50:]):.4f}"
        if self._epochs and self._epochs[-1].validation_r is not None:
            words += f", validation r {self._epochs[-1].validation_r:.3f}"
        passes = sum(s.passes for s in self._stages)
        self._report(words, (before + number) * self._steps + step, passes * self._steps)


def correlation(one: Array, other: Array) -> float | None:
    """Pearson's r; None without spread."""
    r = float(pearson(one, other[None])[0])
    return r if np.isfinite(r) else None


def half_precision(device: str) -> Any:
    """Context in which layers compute with bfloat16, where the device is faster with it."""
    torch = torch_module()
    kind = device.partition(":")[0]
    return torch.autocast(kind, torch.bfloat16, enabled=has_half_precision(device))


def has_half_precision(device: str) -> bool:
    """Whether a device multiplies matrices of bfloat16 faster than others."""
    torch = torch_module()
    if device.startswith("cuda"):
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    return device == "cpu" and bool(torch.cpu._is_avx512_bf16_supported())


def _seed(part: int, *words: int) -> int:
    return int(np.random.SeedSequence([*words, part]).generate_state(1)[0])


def _unfreeze(model: Any, layers: Sequence[Sequence[Any]], count: int) -> list[Any]:
    """Let the last layers learn and no others; returns their parameters."""
    model.requires_grad_(False)
    learning = [parameter for layer in layers[-count:] for parameter in layer]
    for parameter in learning:
        parameter.requires_grad_(True)
    return learning


def _learning_mode(model: Any, all_layers: bool) -> None:
    """Training mode; layers that don't learn keep the statistics of their normalisation."""
    model.train()
    if all_layers:
        return
    for module in model.modules():
        own = list(module.parameters(recurse=False))
        if own and not any(parameter.requires_grad for parameter in own):
            module.eval()


def _has_stopped(epochs: Sequence[Epoch], patience: int) -> bool:
    """Whether the last passes of a stage have brought nothing."""
    errors = [epoch.validation_rmse for epoch in epochs]
    return len(errors) > patience and min(errors[-patience:]) >= min(errors[:-patience])


def split(examples: Examples, seed: int) -> tuple[Examples, Examples]:
    """Training and validation scenes: every tenth at random, between 16 and 500, validates."""
    count = len(examples.scenes)
    held = min(500, max(16, count // 10), count // 2)
    order = np.random.default_rng(_seed(0, seed, count)).permutation(count)
    return examples.some(np.sort(order[held:])), examples.some(np.sort(order[:held]))
