"""What is asked: models, ranges of their parameters, and the liquids of the trials.

A grid is made of objects (`make_grid`) or read from a TOML file; the paper's and a quick one lie
in `sweep/grids`.
"""

import itertools
import math
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pourcast.errors import InputError, one_line, unknown
from pourcast.models.base import Model
from pourcast.models.registry import build_model, parse_parameter, presets
from pourcast.scenes.liquids.base import RESERVED, Liquid
from pourcast.scenes.liquids.registry import liquid_names
from pourcast.study.experiments.base import Experiment
from pourcast.study.experiments.registry import EXPERIMENTS

MAX_MODELS = 1_000_000
"""Most combinations of parameters that a grid may ask for."""

MAX_VALUES = 100_000
"""Most values of one range."""

Value = float | int | str


class Range(BaseModel):
    """Evenly spaced values, both ends included: by their `step`, or by their `count`."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    first: float = Field(alias="from", allow_inf_nan=False)
    last: float = Field(alias="to", allow_inf_nan=False)
    step: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    count: int | None = Field(default=None, ge=2, le=MAX_VALUES)

    @model_validator(mode="after")
    def _one_way(self) -> "Range":
        if (self.step is None) == (self.count is None):
            raise ValueError("expected either `step` or `count` beside `from` and `to`")
        if self.last < self.first:
            raise ValueError("`to` is less than `from`")
        if self.step is not None:
            steps = (self.last - self.first) / self.step
            if abs(steps - round(steps)) > 1e-6:
                raise ValueError("the step doesn't lead from `from` to `to`")
            if steps >= MAX_VALUES:
                raise ValueError(f"more than {MAX_VALUES} values")
        return self

    def values(self) -> list[Value]:
        """The values, whole numbers where they are whole, rounded where 0.1 + 0.2 isn't 0.3."""
        count = self.count or round((self.last - self.first) / (self.step or 1.0)) + 1
        exact = (round(float(v), 10) for v in np.linspace(self.first, self.last, count))
        return [int(v) if v == int(v) else v for v in exact]


class GridModels(BaseModel):
    """One `[[models]]` of a grid: a model, and values of some of its parameters."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    model: str
    liquids: tuple[str, ...] = Field(default=("water",), min_length=1, strict=False)
    """Liquids that the trials show."""
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = Field(default=(0,), min_length=1, strict=False)
    parameters: dict[str, Range | Value | list[Value]] = {}
    """Parameter -> a value, a list of values, or a range."""

    def axes(self) -> dict[str, list[Value]]:
        """Values of every parameter that is given."""
        return {name: _values(given) for name, given in self.parameters.items()}

    def first(self, own: Sequence[Liquid] = ()) -> Model:
        """The model with the first value of every parameter that is given."""
        first = {k: str(values[0]) for k, values in self.axes().items()}
        return build_model(self.model, first, own)


def _values(given: Range | Value | list[Value]) -> list[Value]:
    if isinstance(given, Range):
        return given.values()
    return list(given) if isinstance(given, list) else [given]


class GridFile(BaseModel):
    """The content of a grid, and of its file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str = ""
    trajectories: bool = False
    """Keep every particle's path too."""
    shard_seconds: float | None = Field(default=None, gt=0.0, allow_inf_nan=False)
    """Rough work in a shard [s of one core]; by default 60, less towards the end."""
    models: tuple[GridModels, ...] = Field(min_length=1)


@dataclass(frozen=True)
class GridPoint:
    """A model that is to judge all scenes, as trials with one liquid, with one seed."""

    name: str
    """As in the grid file: a family, a preset or a third-party model."""
    family: str
    """A preset's family; else the same."""
    model: Model
    liquid: str
    seed: int


@dataclass(frozen=True)
class Grid:
    """A grid that was found right; see `make_grid` and `read_grid`.

    Parameters
    ----------
    name
        Its name: that of the file, without the extension.
    content
        What it says.
    own
        The study's own liquids.
    source
        The text of the file; empty if there is none.
    """

    name: str
    content: GridFile
    own: tuple[Liquid, ...] = ()
    source: str = ""

    @property
    def text(self) -> str:
        """The grid as TOML: the text of its file, if there is one."""
        content = self.content.model_dump(mode="json", by_alias=True, exclude_defaults=True)
        return self.source or tomli_w.dumps(content)

    def points(self) -> Iterator[GridPoint]:
        """All models, in the order of the file; later parameters vary fastest."""
        for entry in self.content.models:
            base, axes = entry.first(self.own), entry.axes()
            family = presets().get(entry.model, {}).get("model", entry.model)
            parsed = [_parsed(entry.model, base, k, values, self.own) for k, values in axes.items()]
            for combination in itertools.product(*parsed):
                model = replace(base, **dict(zip(axes, combination, strict=True)))
                for liquid, seed in itertools.product(entry.liquids, entry.seeds):
                    yield GridPoint(entry.model, family, model, liquid, seed)

    def with_trajectories(self) -> "Grid":
        """The same grid, keeping every particle's path."""
        if self.content.trajectories:
            return self
        content = self.content.model_copy(update={"trajectories": True})
        return Grid(self.name, content, self.own)


def _parsed(
    name: str, base: Model, key: str, values: list[Value], own: Sequence[Liquid]
) -> list[Any]:
    return [parse_parameter(name, type(base), key, str(value), own) for value in values]


def grid_names() -> list[str]:
    """Names of the grids that come with pourcast."""
    entries = (entry.name for entry in files("pourcast.sweep").joinpath("grids").iterdir())
    return sorted(name.removesuffix(".toml") for name in entries if name.endswith(".toml"))


def read_grid(name_or_path: str, own: Sequence[Liquid] = ()) -> Grid:
    """Read a grid, and check every model and value in it.

    Parameters
    ----------
    name_or_path
        A TOML file, the name of a grid that comes with pourcast, or of an experiment.
    own
        The study's own liquids, which it can name.

    Raises
    ------
    InputError
        One line that names the file, the field and what was expected.

    Examples
    --------
    >>> sum(1 for _ in read_grid("quick").points())
    325
    """
    if name_or_path in grid_names():
        resource = files("pourcast.sweep").joinpath("grids", f"{name_or_path}.toml")
        return parse_grid(resource.read_text(encoding="utf-8"), name_or_path, name_or_path, own)
    path = Path(name_or_path)
    if name_or_path in EXPERIMENTS.names() and not path.exists():
        return experiment_grid(EXPERIMENTS.get(name_or_path), own)
    if path.suffix != ".toml" and not path.exists():
        known = [*grid_names(), *EXPERIMENTS.names()]
        raise InputError(f"grid: {unknown(name_or_path, known)}, or a .toml file")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read ({reason})") from None
    return parse_grid(text, path.stem, str(path), own)


def experiment_grid(experiment: Experiment, own: Sequence[Liquid] = ()) -> Grid:
    """What a whole reproduction of an experiment sweeps; see `read_grid`.

    In a grid that comes with pourcast, a list of liquids stands for the experiment's; a model
    with another liquid alone is left out.
    """
    if isinstance(experiment.grid, str):
        return _with_liquids(read_grid(experiment.grid, own), experiment.shown_liquids)
    name = experiment.grid.name.removesuffix(".toml")
    return parse_grid(experiment.grid.read_text(encoding="utf-8"), name, name, own)


def _with_liquids(grid: Grid, shown: tuple[str, ...]) -> Grid:
    """A grid for an experiment: several liquids are all of its own, one that it hasn't is none."""
    entries = tuple(
        _entry_with_liquids(entry, shown)
        for entry in grid.content.models
        if all(len(named) > 1 or named[0] in (*shown, RESERVED) for named in _liquids_in(entry))
    )
    if entries == grid.content.models:
        return grid
    content = grid.content.model_copy(update={"models": entries})
    return Grid(f"{grid.name}-{'-'.join(shown)}", content, grid.own)


def _liquids_in(entry: GridModels) -> list[list[str]]:
    """Liquids of the trials, and liquids in the head if any are named."""
    imagined = [str(value) for value in entry.axes().get("liquid", [])]
    return [list(entry.liquids), *([imagined] if imagined else [])]


def _entry_with_liquids(entry: GridModels, shown: tuple[str, ...]) -> GridModels:
    changed: dict[str, Any] = {"liquids": shown if len(entry.liquids) > 1 else entry.liquids}
    if len(entry.axes().get("liquid", [])) > 1:
        changed["parameters"] = {**entry.parameters, "liquid": list(shown)}
    return entry.model_copy(update=changed)


def parse_grid(text: str, name: str, source: str, own: Sequence[Liquid] = ()) -> Grid:
    """Grid from the text of its file; see `read_grid`.

    Parameters
    ----------
    text
        TOML.
    name
        Name of the grid.
    source
        Name of the file, for error messages.
    own
        The study's own liquids.
    """
    try:
        content = GridFile.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{source}: not a TOML file ({error})") from None
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error)}") from None
    return replace(make_grid(name, content, own, source), source=text)


def make_grid(
    name: str, content: GridFile, own: Sequence[Liquid] = (), source: str | None = None
) -> Grid:
    """Grid from what it says; every model and value in it is checked.

    Parameters
    ----------
    name
        Its name, by which a store keeps it.
    content
        What it says.
    own
        The study's own liquids.
    source
        Where it is from, for error messages; its name by default.

    Raises
    ------
    InputError
        One line that names the entry, the field and what was expected.

    Examples
    --------
    >>> entry = GridModels(model="simple", parameters={"g": [0.0, 0.1]})
    >>> [point.model.g for point in make_grid("two", GridFile(models=[entry])).points()]
    [0.0, 0.1]
    """
    for number, entry in enumerate(content.models):
        try:
            _check(entry, own)
        except InputError as error:
            raise InputError(f"{source or name}: models[{number}]: {error}") from None
    return Grid(name, content, tuple(own))


def _check(entry: GridModels, own: Sequence[Liquid]) -> None:
    """Build a model with each single value; ranges of parameters don't depend on one another."""
    for liquid in entry.liquids:
        if liquid not in liquid_names(own):
            raise InputError(f"liquids: {unknown(liquid, liquid_names(own))}")
    axes = entry.axes()
    for key, values in axes.items():
        if not values:
            raise InputError(f"parameters.{key}: the list is empty, expected at least one value")
    base = entry.first(own)
    for key, values in axes.items():
        for value in _parsed(entry.model, base, key, values, own):
            replace(base, **{key: value})
    size = math.prod(len(values) for values in axes.values())
    size *= len(entry.liquids) * len(entry.seeds)
    if size > MAX_MODELS:
        raise InputError(f"{size} combinations of parameters; at most {MAX_MODELS} can be swept")
