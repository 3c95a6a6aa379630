"""Arguments and options that several commands share."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pourcast.errors import InputError


class Over(StrEnum):
    """What conclusions hold over."""

    PARTICIPANTS = "participants"
    SCENES = "scenes"
    BOTH = "both"


class ExecutorName(StrEnum):
    """Where long work is done."""

    LOCAL = "local"
    DASK = "dask"
    SLURM = "slurm"


def complete_experiment(incomplete: str) -> list[str]:
    """Names of experiments, for the shell's completion."""
    from pourcast.study.experiments.registry import EXPERIMENTS

    return [name for name in EXPERIMENTS.names() if name.startswith(incomplete)]


def complete_liquid(incomplete: str) -> list[str]:
    """Names of liquids, for the shell's completion."""
    from pourcast.scenes.liquids.registry import liquid_names

    return [name for name in liquid_names() if name.startswith(incomplete)]


ScenesArgument = Annotated[
    Path, typer.Argument(metavar="SCENES", help="A scene file, or a study folder.")
]
ModelOption = Annotated[
    list[str] | None,
    typer.Option(
        "--model", "-m", metavar="NAME[:parameter=value,...]",
        help="A model; may be given several times. `pourcast models` lists them.",
    ),
]  # fmt: skip
LiquidOption = Annotated[
    str,
    typer.Option(
        metavar="NAME", autocompletion=complete_liquid,
        help="Liquid shown in the trials; `pourcast list` lists them.",
    ),
]  # fmt: skip
SeedOption = Annotated[int, typer.Option(min=0, help="Source of all randomness.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Processes [all cores].")]
StudyArgument = Annotated[Path, typer.Argument(metavar="STUDY", help="A study folder.")]
OverOption = Annotated[
    Over,
    typer.Option(
        help="What intervals and tests hold over: other participants with these scenes (as in the "
        "paper), other scenes with these participants, or both."
    ),
]
ExecutorOption = Annotated[ExecutorName, typer.Option(help="Where to work.")]
SchedulerOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="dask: a scheduler that runs already.")
]
ClusterOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="dask, slurm: TOML with a table [dask] or [slurm]."),
]


def pixels(size: str | None) -> tuple[int, ...]:
    """Width, or width and height, in pixels, from what the user said of a size.

    Raises
    ------
    InputError
        If it is anything else.
    """
    if size is None:
        return ()
    parts = size.lower().split("x")
    if not all(part.isdecimal() for part in parts) or len(parts) > 2:
        raise InputError(f"size: expected WIDTHxHEIGHT in pixels, such as 640x960, found {size!r}")
    return tuple(int(part) for part in parts)
