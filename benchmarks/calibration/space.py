"""The open choices: what each is, how far it may go, and why so far.

A point is one value of each choice. `World` is what a point means: engine settings, the liquids,
the scene family and the filter; what a point doesn't name stays as the product has it. Values
that the paper gives (N, alpha, zeta, sigma, area of the obstacles) are no choices.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tomli_w
from numpy.typing import NDArray

from pourcast.errors import InputError, unknown
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import HONEY_EXP1, WATER
from pourcast.simulation.settings import EngineSettings
from pourcast.study.experiments.exp1 import EXPERIMENT
from pourcast.study.selection import CoarseFilter

Section = Literal["engine", "water", "honey", "family", "filter"]
Scale = Literal["linear", "log", "square"]
Value = float | int | str
Point = Mapping[str, Value]
"""Choice -> value."""
Array = NDArray[np.float64]

_POWERS = {"linear": 1, "square": 2}

SECTIONS: tuple[Section, ...] = ("engine", "water", "honey", "family", "filter")

WATER_NAME, HONEY_NAME = "open-water", "open-honey"
"""A study's own liquids may not be called as those that come with pourcast."""


@dataclass(frozen=True)
class Choice:
    """One open choice.

    Parameters
    ----------
    section
        Where it goes.
    fields
        Fields of that section that take its value.
    low, high
        Range, in the fields' unit.
    scale
        How the unit interval is laid over it: ``square`` is finest at the low end, and reaches 0,
        which ``log`` can't.
    why
        Why this range.
    whole
        Whether only whole numbers are meant.
    """

    section: Section
    fields: tuple[str, ...]
    low: float
    high: float
    scale: Scale
    why: str
    whole: bool = False

    @property
    def name(self) -> str:
        """Section and field: ``family.cell_count``."""
        return f"{self.section}.{self.fields[0]}"

    def value(self, unit: float) -> Value:
        """The value at a place of the unit interval."""
        if self.scale == "log":
            value = self.low * (self.high / self.low) ** unit
        else:
            value = self.low + (self.high - self.low) * unit ** _POWERS[self.scale]
        return round(value) if self.whole else float(value)

    def unit(self, value: Value) -> float:
        """Where in the unit interval a value lies; beyond 0..1 if it is beyond the range."""
        number = float(value)
        if self.scale == "log":
            return float(np.log(number / self.low) / np.log(self.high / self.low))
        share = (number - self.low) / (self.high - self.low)
        return float(np.sign(share) * abs(share) ** (1.0 / _POWERS[self.scale]))

    def rounded(self, value: Value) -> Value:
        """To two digits."""
        short = float(f"{float(value):.2g}")
        return round(short) if self.whole else short


CHOICES: tuple[Choice, ...] = (
    Choice(
        "family", ("cell_count",), 60, 300, "log",
        "the paper shows several small obstacles a scene: 6 (60 cells) to 28 (300)", whole=True,
    ),
    Choice(
        "family", ("band_bottom",), 0.15, 0.5, "linear",
        "obstacles stand above the divider, and reach down to the basins or stop half-way",
    ),
    Choice(
        "family", ("wall_gap",), 0.0, 0.1, "square",
        "solid cells at the side walls or not: up to the spheres of liquid (0.074 m) and more",
    ),
    Choice(
        "family", ("liquid_spread",), 0.0, 0.3, "square",
        "the paper says 'above the obstacles', and never that its place varies; 0.3 m is 0.1's",
    ),
    Choice(
        "filter", ("min_touched",), 0.2, 0.95, "linear",
        "'hardly touches an obstacle' is left out: anything from a fifth to nearly all",
    ),
    Choice(
        "filter", ("max_stranded",), 0.02, 0.2, "log",
        "'trapped' is left out: one particle of fifty to a fifth",
    ),
    Choice(
        "honey", ("adhesion_normal",), 30.0, 400.0, "log",
        "10 /s moves as water does, 300 /s clings and drips, more strands (physics.md)",
    ),
    Choice(
        "honey", ("adhesion_tangential",), 30.0, 400.0, "log",
        "as the normal one: the paper has two parameters, set by eye",
    ),
    Choice(
        "honey", ("cohesion",), 0.005, 0.03, "log",
        "the paper's honey 'coheres as a continuous substance'; capillary lengths .023 to .055 m",
    ),
    Choice(
        "water", ("cohesion",), 0.0, 0.03, "square",
        "none, to as much as honey: the paper says nothing of what holds its water together",
    ),
    Choice(
        "engine", ("damping_scale",), 0.4, 1.6, "log",
        "1 as written; 0.5 as when zeta acts in one of two half-kicks of an integrator",
    ),
    Choice(
        "engine", ("contact_radius",), 0.35, 0.6, "linear",
        "half a spacing in a packing that touches; the paper's spheres have no size given",
    ),
    Choice(
        "engine", ("marble_radius",), 0.35, 0.62, "linear",
        "marbles that fill a fifth of the liquid's volume to all of it",
    ),
)  # fmt: skip
"""All that are searched.

A first search (138 points of 12 scenes) had six more, which are held as the product has them:
tension of honey and of water (a lower bound of pressure alone draws few particles into clumps,
which no liquid does), sound speed (what a pour costs is proportional to it), support, contact layer
and pairs with viscosity (no effect that 12 scenes could tell from noise). Ranges were narrowed to
what it left open, but for cohesion of water, which it had searched to 0.01 only.
"""


NOT_OPEN = (
    "name",
    "called",
    "goals",
    "colour",
    "glass_colour",
    "film_seconds",
    "liquid",
    "settings",
)
"""Fields that a point doesn't have: what the liquids are called, what the filter pours."""

LIMITS = {
    "family.cell_count": (1.0, 10_000.0),
    "family.band_bottom": (0.0, 1.25),
    "family.band_top": (0.0, 1.5),
    "family.solid_area": (1e-3, 1.0),
    "family.wall_gap": (0.0, 0.4),
    "family.liquid_y": (0.1, 1.5),
    "family.liquid_spread": (0.0, 0.4),
    "filter.n_particles": (1.0, 10_000.0),
    "filter.damping_zeta": (0.0, 1000.0),
    "filter.min_touched": (0.0, 1.0),
    "filter.max_stranded": (0.0, 1.0),
}
"""Smallest and largest values of fields that don't check their own: families and filters are made
in code elsewhere. Lengths are the box's, 1 m wide and 1.5 m high."""


@dataclass(frozen=True)
class World:
    """What a point means."""

    engine: EngineSettings
    water: Liquid
    honey: Liquid
    family: VoronoiFamily
    rule: CoarseFilter


def product_sections() -> dict[Section, Any]:
    """What the product takes where the paper is silent."""
    return {
        "engine": EngineSettings(),
        "water": WATER,
        "honey": HONEY_EXP1,
        "family": EXPERIMENT.family,
        "filter": EXPERIMENT.choice.rule,
    }


def product_point() -> dict[str, Value]:
    """The product as it stands, as a point."""
    sections = product_sections()
    return {c.name: getattr(sections[c.section], c.fields[0]) for c in CHOICES}


def world(point: Point) -> World:
    """What a point means; what it doesn't name is the product's.

    Parameters
    ----------
    point
        Choices, or other fields of the sections.

    Raises
    ------
    InputError
        If there is no such field, or a value is out of what its section allows.
    """
    sections = product_sections()
    changes: dict[Section, dict[str, Value]] = {section: {} for section in SECTIONS}
    for name, value in point.items():
        section, _, entry = name.partition(".")
        if section not in sections:
            raise InputError(f"point: {unknown(section, list(SECTIONS))}")
        standard = {
            one.name: getattr(sections[section], one.name)
            for one in fields(sections[section])
            if one.name not in NOT_OPEN
        }
        if entry not in standard:
            raise InputError(f"point: [{section}]: {unknown(entry, list(standard))}")
        _check_value(name, value, standard[entry])
        changes[section][entry] = value
    for choice in CHOICES:
        if choice.name in point:
            changes[choice.section] |= dict.fromkeys(choice.fields, point[choice.name])
    made = {name: replace(one, **changes[name]) for name, one in sections.items()}
    water = replace(made["water"], name=WATER_NAME, called="", goals=())
    honey = replace(made["honey"], name=HONEY_NAME, called="", goals=())
    rule = replace(made["filter"], liquid=water, settings=made["engine"])
    return World(made["engine"], water, honey, made["family"], rule)


def _check_value(name: str, value: Value, standard: Value) -> None:
    """Refuse what is not of the kind of the product's value, or out of `LIMITS`."""
    section, _, entry = name.partition(".")
    low, high = LIMITS.get(name, (-math.inf, math.inf))
    kind = "a word" if isinstance(standard, str) else "a number"
    if isinstance(standard, int):
        kind = "a whole number"
    if name in LIMITS:
        kind += f", {low:g} to {high:g}"
    if isinstance(standard, str):
        fits = isinstance(value, str)
    elif isinstance(value, str | bool):
        fits = False
    else:
        whole = not isinstance(standard, int) or isinstance(value, int)
        fits = whole and math.isfinite(value) and low <= value <= high
    if not fits:
        raise InputError(f"point: [{section}] {entry}: expected {kind}, found {value!r}")


def point_at(unit: Array) -> dict[str, Value]:
    """The point at a place of the unit cube, shape [choice_count]."""
    return {c.name: c.value(float(u)) for c, u in zip(CHOICES, unit, strict=True)}


def place_of(point: Point) -> Array:
    """Where in the unit cube a point lies; what it doesn't name is the product's."""
    full = {**product_point(), **point}
    return np.array([choice.unit(full[choice.name]) for choice in CHOICES])


def read_point(path: Path) -> dict[str, Value]:
    """Read a point from a TOML file with a table for each section, such as ``[engine]``.

    Raises
    ------
    InputError
        One line that names the file, the table, the field and what was expected.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a TOML file ({error})") from None
    point: dict[str, Value] = {}
    for section, table in content.items():
        if section not in SECTIONS:
            raise InputError(f"{path}: {unknown(section, list(SECTIONS))}")
        if not isinstance(table, dict):
            raise InputError(f"{path}: {section}: expected a table [{section}]")
        point |= {f"{section}.{name}": value for name, value in table.items()}
    for name, value in point.items():
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise InputError(f"{path}: {name}: expected a number or a word, found {value!r}")
    try:
        world(point)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return point


def holding(places: Array, held: Point) -> Array:
    """Places of the unit cube, moved to where the choices that are held have their values."""
    moved = places.copy()
    for number, choice in enumerate(CHOICES):
        if choice.name in held:
            moved[:, number] = choice.unit(held[choice.name])
    return moved


def read_held(words: Sequence[str]) -> dict[str, Value]:
    """Choices that are held, from words such as ``water.cohesion=0``.

    Raises
    ------
    InputError
        If there is no such choice, or its value is no number within its range.
    """
    choices = {choice.name: choice for choice in CHOICES}
    held: dict[str, Value] = {}
    for word in words:
        name, _, text = word.partition("=")
        if name not in choices:
            raise InputError(f"hold: {unknown(name, list(choices))}")
        low, high = choices[name].low, choices[name].high
        try:
            held[name] = float(text)
            within = low <= float(text) <= high
        except ValueError:
            within = False
        if not within:
            raise InputError(f"hold: {name}: expected {low:g} to {high:g}, found {text!r}")
    return held


def point_text(point: Point) -> str:
    """A point as TOML; see `read_point`."""
    tables: dict[str, dict[str, Value]] = {}
    for name, value in point.items():
        section, _, entry = name.partition(".")
        tables.setdefault(section, {})[entry] = value
    return tomli_w.dumps(tables)
