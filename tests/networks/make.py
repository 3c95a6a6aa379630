"""Small networks, their cards, and scenes for them."""

from pathlib import Path
from typing import Any

import numpy as np

from pourcast.networks.backbones import make_backbone, torch_module
from pourcast.networks.network import Card, Network, Recipe, outputs, tensor_of, write_network
from pourcast.networks.picture import paint
from pourcast.study.experiments.registry import EXPERIMENTS
from tests.make import random_scenes

SMALL: dict[str, Any] = {"height": 48, "width": 32, "passes": 1, "tuning_passes": 1, "batch": 16}
"""A recipe whose network learns in no time."""


def scenes_of(experiment, count, seed=0):
    goal = EXPERIMENTS.get(experiment).goal
    return [s for s in random_scenes(2 * count, seed) if s.goal.kind == goal]


def card_of(liquid="water", experiment="exp1", recipe=None) -> Card:
    return Card(
        experiment=experiment, goal=EXPERIMENTS.get(experiment).goal, liquid=liquid, labelled_by="nobody", scenes=0, validation=0, seed=0,
        filtered=True, recipe=recipe or Recipe(**SMALL), first_weights="random", epochs=(),
        held_out=None, made_with={},
    )  # fmt: skip


def random_network(liquid="water", experiment="exp1", recipe=None, seed=0) -> Network:
    """A network that has learned nothing, whose judgments differ nevertheless."""
    card = card_of(liquid, experiment, recipe)
    torch = torch_module()
    torch.manual_seed(seed)
    model = make_backbone(card.recipe.backbone, card.recipe.height, card.recipe.width)
    size = card.recipe.height, card.recipe.width
    pictures = np.stack([paint(scene, *size) for scene in scenes_of(experiment, 8, seed=99)])
    weight, bias = list(model.parameters())[-2:]
    with torch.no_grad():
        # Normalisation takes its statistics from some pictures, as after training.
        model.train()
        for _ in range(20):
            model(tensor_of(pictures, model))
        said = outputs(model, pictures)
        weight.mul_(0.2 / said.std())
        bias.fill_(0.0)
        bias.fill_(0.5 - float(outputs(model, pictures).mean()))
    return Network(model.eval(), card)


def written(folder: Path, **what) -> Path:
    """File of a random network."""
    network = random_network(**what)
    path = folder / f"{network.card.liquid}.safetensors"
    write_network(path, network)
    return path
