"""The design of an experiment: `experiment.toml` in the study folder, and the words shown."""

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pourcast.errors import InputError, one_line

NAME = "experiment.toml"

LiquidKind = Literal["water", "honey"]


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SliderDesign(_Frozen):
    """How the slider behaves.

    Parameters
    ----------
    start
        Where the handle stands at first: nowhere (a start biases answers), in the
        middle, at a random place, or at `start_at`.
    start_at
        Place of a fixed start, 0..1.
    mouse
        Whether the mouse moves the handle as it moves over the slider, or drags it.
    number
        Show the answer as a number, too.
    trajectory
        Record the handle's whole way, not only where it ends.
    """

    start: Literal["none", "centre", "random", "fixed"] = "none"
    start_at: float = Field(default=0.5, ge=0.0, le=1.0)
    mouse: Literal["move", "drag"] = "move"
    number: bool = True
    trajectory: bool = False


class RecruitingDesign(_Frozen):
    """Completion codes of a recruiting platform, and where it takes participants back.

    `{code}` in `redirect` is filled in.
    """

    complete: str = ""
    screened_out: str = ""
    failed_check: str = ""
    redirect: str = ""

    @property
    def codes(self) -> dict[str, str]:
        """Codes by how a session ended."""
        return self.model_dump(include={"complete", "screened_out", "failed_check"})


class Design(_Frozen):
    """An experiment's design.

    Parameters
    ----------
    title, contact
        Shown to participants; `contact` on the first page.
    language
        Of the words shown: a file in `experiment/design/texts`, or `texts.xx.toml` in the study.
    minutes
        How long it takes, as participants are told.
    groups
        The liquids that each group of participants sees. Two groups of one liquid
        are Experiment 1a and 1b; one group of two liquids is Experiment 2.
    mirrored
        Liquids whose trials are shown in a mirror.
    practice
        Number of practice trials, none of them mirrored.
    blocks
        Parts of the test trials, with a break between.
    order
        One shuffled order shared by all of a group, or one for each participant.
    seed
        Source of the orders.
    places
        How many participants a group takes; None: as many as come.
    comprehension_attempts
        How often the questions may be answered before the session ends.
    minimum_width, minimum_height
        Least size of the window [points].
    fullscreen
        Fill the screen.
    largest_gap
        After this long without an answer a session can't be resumed, and its place
        is given to somebody else [s].
    slider, recruiting
        See there.
    texts
        The study's own words, in place of those of the language.
    """

    title: str = "Where will the liquid go?"
    contact: str = ""
    language: str = Field(default="en", pattern="^[a-z]{2,3}(-[A-Za-z]{2,4})?$")
    minutes: int = Field(default=30, ge=1)
    groups: tuple[tuple[LiquidKind, ...], ...] = Field(min_length=1)
    mirrored: tuple[LiquidKind, ...] = ()
    practice: int = Field(default=15, ge=0)
    blocks: int = Field(default=3, ge=1)
    order: Literal["shared", "own"] = "shared"
    seed: int = Field(default=0, ge=0)
    places: int | None = Field(default=None, ge=1)
    comprehension_attempts: int = Field(default=3, ge=1)
    minimum_width: int = Field(default=1280, ge=320)
    minimum_height: int = Field(default=720, ge=320)
    fullscreen: bool = True
    largest_gap: float = Field(default=7200.0, gt=0.0)
    slider: SliderDesign = SliderDesign()
    recruiting: RecruitingDesign = RecruitingDesign()
    texts: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _groups_see_something(self) -> "Design":
        for group in self.groups:
            if not group or len(set(group)) < len(group):
                raise ValueError("groups: expected one or two different liquids a group")
        if len(set(self.groups)) < len(self.groups):
            raise ValueError("groups: two groups see the same")
        return self


def read_design(study: Path) -> Design:
    """The design in a study's `experiment.toml`.

    Raises
    ------
    InputError
        One line that names the file, the field and what was expected.
    """
    path = study / NAME
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: not there; `pourcast experiment serve` makes one") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not TOML ({error})") from None
    try:
        design = Design.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None
    texts_of(study, design)
    return design


def default_design(goal: str, practice: int) -> str:
    """The paper's design for a kind of scene, with every choice explained.

    Parameters
    ----------
    goal
        Kind of the scenes' goal: `basins` (Experiments 1a and 1b) or `cup` (Experiment 2).
    practice
        Number of practice trials.

    Returns
    -------
    str
        Content of `experiment.toml`.
    """
    basins = goal == "basins"
    groups = '[["water"], ["honey"]]' if basins else '[["water", "honey"]]'
    mirrored = "[]" if basins else '["honey"]'
    text = files("pourcast.experiment.design").joinpath("default.toml").read_text(encoding="utf-8")
    for name, value in (("GROUPS", groups), ("MIRRORED", mirrored), ("PRACTICE", str(practice))):
        text = text.replace(f"@{name}@", value)
    return text


def texts_of(study: Path, design: Design) -> dict[str, Any]:
    """All words that participants read: those of the language, and over them the study's own.

    Raises
    ------
    InputError
        If there is no such language, or a word is missing or unknown.
    """
    english = _read_texts(None, "en")
    texts = english if design.language == "en" else _read_texts(study, design.language)
    own = f"{study / NAME}: texts"
    problem = next(_differences(english, texts, design.language), None)
    if problem is not None:
        raise InputError(f"texts of the language {design.language!r}: {problem}")
    return _merged(texts, {"page": {"title": design.title}} | design.texts, own)


def _read_texts(study: Path | None, language: str) -> dict[str, Any]:
    name = f"{language}.toml"
    own = None if study is None else study / f"texts.{name}"
    shipped = files("pourcast.experiment.design").joinpath("texts", name)
    source = own if own is not None and own.is_file() else shipped
    if not source.is_file():
        raise InputError(
            f"{own}: not there, and no texts in {language!r} come with pourcast; copy and "
            "translate texts/en.toml"
        )
    try:
        return tomllib.loads(source.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{source}: not TOML ({error})") from None


def _differences(wanted: dict[str, Any], found: dict[str, Any], where: str) -> Any:
    """Yield what is missing in a table of words."""
    for key, value in wanted.items():
        if key not in found:
            yield f"{where}.{key} is missing"
        elif not isinstance(found[key], type(value)):
            yield f"{where}.{key}: expected {type(value).__name__}"
        elif isinstance(value, dict):
            yield from _differences(value, found[key], f"{where}.{key}")


def _merged(texts: dict[str, Any], own: dict[str, Any], where: str) -> dict[str, Any]:
    merged = dict(texts)
    for key, value in own.items():
        if key not in texts:
            raise InputError(f"{where}.{key}: unknown; expected one of {', '.join(texts)}")
        if not isinstance(value, type(texts[key])):
            raise InputError(f"{where}.{key}: expected {type(texts[key]).__name__}")
        merged[key] = (
            _merged(texts[key], value, f"{where}.{key}") if isinstance(value, dict) else value
        )
    return merged
