"""The design of an experiment: `experiment.toml` in the study folder, and the words shown."""

import json
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, ValidationError, model_validator

from pourcast.errors import InputError, one_line
from pourcast.frozen import Frozen
from pourcast.scenes.goals.base import Goal, GoalWords
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.study.experiments.base import Experiment
from pourcast.study.folder import study_experiment, study_liquids, study_scenes

NAME = "experiment.toml"


class SliderDesign(Frozen):
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


class RecruitingDesign(Frozen):
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


class Design(Frozen):
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
        The liquids that each group of participants sees, as they are called. Two groups of one
        liquid are Experiment 1a and 1b; one group of two liquids is Experiment 2.
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
        Least size of the page [points], once it fills the screen. Pictures are scaled to what there
        is. The defaults fit a laptop of 1366 x 768, even in a window with a bookmarks bar.
    fullscreen
        Fill the screen, where the browser can; asked for again when it was left.
    largest_gap
        After this long without an answer a session's place may be given to somebody
        else, and then it can't be resumed if its group is full [s].
    slider, recruiting
        How the slider behaves, and where participants come from: see these classes.
    texts
        The study's own words, in place of those of the language.
    """

    title: str = "Where will the liquid go?"
    contact: str = ""
    language: str = Field(default="en", pattern="^[a-z]{2,3}(-[A-Za-z]{2,4})?$")
    minutes: int = Field(default=30, ge=1)
    groups: tuple[tuple[str, ...], ...] = Field(min_length=1)
    mirrored: tuple[str, ...] = ()
    practice: int = Field(default=15, ge=0)
    blocks: int = Field(default=3, ge=1)
    order: Literal["shared", "own"] = "shared"
    seed: int = Field(default=0, ge=0)
    places: int | None = Field(default=None, ge=1)
    comprehension_attempts: int = Field(default=3, ge=1)
    minimum_width: int = Field(default=1280, ge=320)
    minimum_height: int = Field(default=585, ge=320)
    fullscreen: bool = True
    largest_gap: float = Field(default=7200.0, gt=0.0)
    slider: SliderDesign = SliderDesign()
    recruiting: RecruitingDesign = RecruitingDesign()
    texts: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _groups_see_something(self) -> "Design":
        for group in self.groups:
            if not group or len(set(group)) < len(group):
                raise ValueError("groups: expected different liquids in a group, at least one")
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
    return parse_design(study, content)


def parse_design(study: Path, content: dict[str, Any]) -> Design:
    """A design from the content of `experiment.toml`; see `read_design`."""
    path = study / NAME
    try:
        design = Design.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None
    scene, own = study_scenes(study)[0], study_liquids(study)
    for group in design.groups:
        try:
            liquids = [resolve_liquid(liquid, scene, own) for liquid in group]
        except InputError as error:
            raise InputError(f"{path}: groups: {error}") from None
        if len(set(liquids)) < len(liquids):
            raise InputError(f"{path}: groups: {' and '.join(group)} are not all different here")
    for liquid in design.mirrored:
        if liquid not in liquids_of(design):
            raise InputError(f"{path}: mirrored: no group sees {liquid!r}")
    texts_of(study, design)
    return design


def liquids_of(design: Design) -> list[str]:
    """Liquids that any group sees, each once."""
    return list(dict.fromkeys(liquid for group in design.groups for liquid in group))


def default_design(experiment: Experiment | None, practice: int) -> str:
    """An experiment's design, with every choice explained; the paper's where it says nothing.

    Parameters
    ----------
    experiment
        The experiment; without one, everybody sees water.
    practice
        Number of practice trials.

    Returns
    -------
    str
        Content of `experiment.toml`.
    """
    groups = (("water",),) if experiment is None else experiment.groups
    mirrored = () if experiment is None else experiment.mirrored
    text = files("pourcast.experiment.design").joinpath("default.toml").read_text(encoding="utf-8")
    values = {"GROUPS": json.dumps(groups), "MIRRORED": json.dumps(mirrored)}
    for name, value in (values | {"PRACTICE": str(practice)}).items():
        text = text.replace(f"@{name}@", value)
    return text


def study_goal(study: Path) -> type[Goal]:
    """What a study asks.

    Raises
    ------
    InputError
        If its scenes ask different things.
    """
    kinds = {scene.goal.kind: type(scene.goal) for scene in study_scenes(study)}
    if len(kinds) > 1:
        raise InputError(
            f"{study}: its scenes have different goals ({', '.join(sorted(kinds))}); an experiment "
            "asks one question"
        )
    return next(iter(kinds.values()))


def texts_of(study: Path, design: Design) -> dict[str, Any]:
    """All words that participants read.

    Those of the language, with the goal's as `goal`, and the shown liquids' as `liquids`; over
    them the experiment's own, and over these the study's.

    Raises
    ------
    InputError
        If there is no such language, or a word is missing or unknown.
    """
    english = _read_texts(None, "en")
    texts = english if design.language == "en" else _read_texts(study, design.language)
    goal, where = study_goal(study), f"texts of the language {design.language!r}"
    problem = next(_differences(english, texts, design.language), None)
    if problem is not None:
        raise InputError(f"{where}: {problem}")
    liquids = _liquid_words(design, texts, where)
    goal_words, source = _goal_words(goal, texts, design.language, where)
    texts = {key: value for key, value in texts.items() if key != "goals"}
    texts |= {"goal": goal_words, "liquids": liquids}
    experiment = study_experiment(study, study_scenes(study))
    if experiment is not None:
        words = _words_for(experiment, list(liquids), f"{study / NAME}: groups")
        texts = _merged(texts, words, f"experiment {experiment.name!r}: words")
    own = {"page": {"title": design.title}} | design.texts
    texts = _merged(texts, own, f"{study / NAME}: texts")
    _check_words(GoalWords, texts["goal"], f"{study / NAME}: texts.goal, or {source}")
    return texts


def _words_for(experiment: Experiment, liquids: list[str], where: str) -> dict[str, Any]:
    """An experiment's words, without those of its liquids that no group sees."""
    for liquid in liquids:
        if (meant := experiment.namesake(liquid)) is not None:
            raise InputError(
                f"{where}: {liquid!r} is not what {experiment.name} shows by that name: name its "
                f"own liquid, {meant!r} (it has {', '.join(experiment.shown_liquids)})"
            )
    words = dict(experiment.words)
    if "liquids" in words:
        shown = {name: said for name, said in words["liquids"].items() if name in liquids}
        words["liquids"] = shown
    return words


def _check_words(kind: type[Frozen], words: Any, where: str) -> None:
    try:
        kind.model_validate(words)
    except ValidationError as error:
        raise InputError(f"{where}: {one_line(error)}") from None


def _goal_words(
    goal: type[Goal], texts: dict[str, Any], language: str, where: str
) -> tuple[dict[str, Any], str]:
    """What a goal says in a language, a translation's or its own, and where that stands."""
    kind = goal.model_fields["kind"].default
    translations = texts.get("goals", {})
    if not isinstance(translations, dict):
        raise InputError(f"{where}: goals: expected tables such as [goals.{kind}]")
    if kind in translations:
        _check_words(GoalWords, translations[kind], f"{where}: goals.{kind}")
        return translations[kind], f"goals.{kind}"
    if language not in goal.words:
        raise InputError(
            f"{where}: goals.{kind} is missing; translate the English words of the goal {kind!r}"
        )
    return dict(goal.words[language]), f"the goal {kind!r}"


def _liquid_words(design: Design, texts: dict[str, Any], where: str) -> dict[str, Any]:
    """Name and description of the liquids that the design shows."""
    own = design.texts.get("liquids", {})
    if not isinstance(own, dict):
        raise InputError(f"{NAME}: texts.liquids: expected tables such as [texts.liquids.water]")
    words = {}
    for liquid in liquids_of(design):
        known = texts["liquids"].get(liquid)
        if known is None:
            given = own.get(liquid, {})
            name = given.get("name") if isinstance(given, dict) else None
            name = name if isinstance(name, str) else liquid.replace("-", " ")
            described = texts["any_liquid"]["description"].replace("{liquid}", name)
            known = {"name": name, "description": described}
        _check_words(_LiquidWords, known, f"{where}: liquids.{liquid}")
        words[liquid] = known
    return words


class _LiquidWords(Frozen):
    """What participants read of a liquid."""

    name: str
    description: str


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
