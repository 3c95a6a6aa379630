"""Commands of the networks: convnet train, convnet show."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pourcast.cli.app import app
from pourcast.cli.options import JsonOption, SeedOption, WorkersOption
from pourcast.cli.scenes import EXPERIMENT_HELP
from pourcast.cli.terminal import print_json, print_table, progress_bar, resumable
from pourcast.errors import InputError

if TYPE_CHECKING:
    from pourcast.networks.network import Card, Recipe

networks = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Networks that judge a picture of the scene: train a pair, look at one.",
)
app.add_typer(networks, name="convnet")


@networks.command()
def train(
    experiment: Annotated[str, typer.Option("--experiment", "-e", help=EXPERIMENT_HELP)],
    out: Annotated[Path, typer.Option("--output", "-o", help="Folder to make, or go on with.")],
    scenes: Annotated[
        int | None,
        typer.Option("-n", "--scenes", help="Training scenes of the first network [10000]."),
    ] = None,
    tuned_scenes: Annotated[
        int | None,
        typer.Option(help="Of the other liquids' [a quarter as many]; 0: only the first."),
    ] = None,
    backbone: Annotated[
        str | None,
        typer.Option(
            help="efficientnet-lite0, convnet-small, alexnet (the paper's), or one of torchvision "
            "or timm [that of FILE; efficientnet-lite0]."
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="random, imagenet or FILE",
            help="First weights: none, ImageNet's, or a file (.pth, .safetensors) [imagenet for "
            "efficientnet-lite0, random for others].",
        ),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Pixels [efficientnet-lite0 and convnet-small 64x96, others 224x224].",
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A first look: fewer passes.")] = False,
    passes: Annotated[
        int | None, typer.Option(min=1, help="Most passes of all layers through the scenes.")
    ] = None,
    learning_rate: Annotated[float | None, typer.Option(help="Highest learning rate.")] = None,
    keep_all: Annotated[
        bool,
        typer.Option("--no-filter", help="Also scenes that would make no stimuli (liquid caught)."),
    ] = False,
    data: Annotated[
        Path | None, typer.Option(help="Folder of scenes and labels, to share [OUTPUT/data].")
    ] = None,
    device: Annotated[str, typer.Option(help="What trains: auto, cpu, cuda ...")] = "auto",
    workers: WorkersOption = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Train a network on scenes that the ground truth labels; other liquids' are tuned from it.

    Every piece of work is kept: the same command goes on after Ctrl-C.

    Example: pourcast convnet train --experiment exp1 --scenes 500 --quick -o net
    """
    from pourcast.networks.network import in_words, read_card
    from pourcast.networks.training.pair import (
        DEFAULT_SCENES,
        NetworkRequest,
        network_spec,
        train_networks,
    )

    recipe = _recipe(backbone, start, size, quick, passes, learning_rate)
    request = NetworkRequest(
        experiment,
        DEFAULT_SCENES if scenes is None else scenes,
        tuned_scenes,
        recipe,
        seed,
        not keep_all,
    )
    with resumable(out), progress_bar() as report:
        made = train_networks(
            out, request, data=data, device=device, workers=workers, report=report
        )
    cards = {path: read_card(path) for path in made}
    if as_json:
        print_json({str(path): _facts(card) for path, card in cards.items()})
        return
    for path, card in cards.items():
        typer.echo(f"{path}: {in_words(card)}; {path.with_suffix('.png').name} shows it")
    names = " ".join(f"-m {network_spec(card.liquid, path)}" for path, card in cards.items())
    typer.echo(f"\nuse: pourcast predict SCENES {names}")


def _recipe(
    backbone: str | None,
    start: str | None,
    size: str | None,
    quick: bool,
    passes: int | None,
    learning_rate: float | None,
) -> "Recipe":
    from pydantic import ValidationError

    from pourcast.cli.options import pixels
    from pourcast.errors import one_line
    from pourcast.networks.training.pair import QUICK, STARTS, default_recipe

    given: dict[str, Any] = dict(QUICK) if quick else {}
    if size is not None:
        wide = pixels(size)
        given |= {"width": wide[0], "height": wide[-1]}
    if passes is not None:
        given |= {"passes": passes, "tuning_passes": passes}
    if learning_rate is not None:
        given |= {"learning_rate": learning_rate, "tuning_rate": learning_rate}
    if start is not None:
        if start not in STARTS and not Path(start).is_file():
            raise InputError(f"start: expected {', '.join(STARTS)} or a file, found {start!r}")
        given |= {"start": start}
    try:
        return default_recipe(backbone, **given)
    except ValidationError as error:
        raise InputError(one_line(error)) from None


def _facts(card: "Card") -> dict[str, Any]:
    single = {"held_out": {"truth", "judgments"}}  # numbers for each scene
    return card.model_dump(mode="json", exclude=single)


@networks.command()
def show(
    network: Annotated[Path, typer.Argument(metavar="NETWORK", help="A .safetensors file.")],
    as_json: JsonOption = False,
) -> None:
    """Tell what made a network, how it learned, and how well it does.

    Example: pourcast convnet show net/water.safetensors
    """
    import pandas as pd

    from pourcast.networks.network import in_words, read_card

    card = read_card(network)
    if as_json:
        print_json(_facts(card))
        return
    typer.echo(f"{network}: {card.experiment}, {card.liquid}: {in_words(card)}\n")
    facts = _facts(card)
    epochs = facts.pop("epochs")
    flat = {k: v for k, v in facts.items() if not isinstance(v, dict)}
    for group in ("recipe", "made_with", "held_out"):
        flat |= {f"{group}: {k}": v for k, v in (facts[group] or {}).items()}
    for name, value in flat.items():
        typer.echo(f"{name}: {value}")
    typer.echo()
    table = pd.DataFrame(epochs).rename_axis("pass")
    table.index += 1
    print_table(table, decimals=4)
