"""Arguments and options that several commands share."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pourcast.errors import InputError


class Resampled(StrEnum):
    """What is drawn again for intervals."""

    PARTICIPANTS = "participants"
    SCENES = "scenes"
    BOTH = "both"


class ExecutorName(StrEnum):
    """Where long work is done."""

    LOCAL = "local"
    DASK = "dask"
    SLURM = "slurm"


class LiquidName(StrEnum):
    """Liquids that a trial can show."""

    WATER = "water"
    HONEY = "honey"
    HONEY_EXP1 = "honey-exp1"
    HONEY_EXP2 = "honey-exp2"


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
LiquidOption = Annotated[LiquidName, typer.Option(help="Liquid shown in the trials.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Source of all randomness.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Processes [all cores].")]
StudyArgument = Annotated[Path, typer.Argument(metavar="STUDY", help="A study folder.")]
ResampleOption = Annotated[
    Resampled, typer.Option(help="What the intervals' bootstrap draws again.")
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
