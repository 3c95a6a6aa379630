"""The study folder: `study.toml` says what was asked for, `scenes.json` holds the scenes.

`chosen.json` says how they were drawn and chosen, if they were.

`practice.json` holds those that participants practise with, and no model is compared on.
"""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, ValidationError

from pourcast.errors import InputError, one_line
from pourcast.files import check_empty, is_temporary, write_text
from pourcast.frozen import Frozen
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import known_liquids, liquid_from
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes, write_scenes
from pourcast.study.chosen import CHOSEN_FILE, how_chosen, read_chosen, write_chosen
from pourcast.study.experiments.base import Experiment
from pourcast.study.experiments.registry import EXPERIMENTS, experiment_like
from pourcast.study.selection import SceneChoice, Selection, filtered_scenes

STUDY_FILE = "study.toml"
PRACTICE_FILE = "practice.json"

DATABASE = "responses.sqlite"
"""The responses of the study's experiment, unless a PostgreSQL server has them."""

_PRACTICE = 1
"""Apart from the scenes' own random numbers, whose seed is not a list."""


@dataclass(frozen=True)
class SceneRequest:
    """Which scenes a study is to have.

    Parameters
    ----------
    experiment
        Name of the experiment.
    count
        Scenes to be judged; the experiment's number by default.
    seed
        Source of all randomness.
    candidates
        Size of the pool that they are chosen from, if they are; the experiment's by default.
    practice
        Scenes for practice.
    quick
        A cheaper choice among draws, for a first look.

    Raises
    ------
    InputError
        If a number is out of range, or there is no such experiment.
    """

    experiment: str
    count: int | None = None
    seed: int = 0
    candidates: int | None = None
    practice: int = 0
    quick: bool = False

    def __post_init__(self) -> None:
        EXPERIMENTS.get(self.experiment)
        if self.scene_count < 1:
            raise InputError(f"scenes: expected at least 1, found {self.scene_count}")
        if self.seed < 0:
            raise InputError(f"seed: expected 0 or more, found {self.seed}")
        if self.practice < 0:
            raise InputError(f"practice: expected 0 or more, found {self.practice}")
        if self.candidates is not None and not hasattr(self.choice, "candidates"):
            raise InputError(
                f"candidates: the scenes of {self.experiment} are not chosen from a pool"
            )

    @property
    def scene_count(self) -> int:
        """Scenes to be judged."""
        return self._experiment.scene_count if self.count is None else self.count

    @property
    def choice(self) -> SceneChoice:
        """How they are chosen."""
        choice = self._experiment.choice.quick() if self.quick else self._experiment.choice
        if self.candidates is None or not hasattr(choice, "candidates"):
            return choice
        pool: Any = choice
        smaller: SceneChoice = replace(pool, candidates=self.candidates)
        return smaller

    @property
    def _experiment(self) -> Experiment:
        return EXPERIMENTS.get(self.experiment)


class _Generated(Frozen):
    """How a study's scenes were made."""

    model_config = ConfigDict(strict=True)

    count: int
    seed: int
    candidates: int | None = None
    practice: int = 0
    quick: bool = False


class StudyFile(Frozen):
    """What `study.toml` says.

    Parameters
    ----------
    experiment
        The experiment that the study was made from; none for scenes of one's own.
    scenes
        File of the scenes.
    generated
        How they were made, if they were.
    liquids
        Name -> fields of `pourcast.Liquid`: liquids that only this study has.
    """

    experiment: str | None = None
    scenes: Literal["scenes.json"] = "scenes.json"
    generated: _Generated | None = None
    liquids: dict[str, dict[str, Any]] = Field(default_factory=dict)


def generate_scenes(request: SceneRequest, report: Report = no_report) -> Selection:
    """Draw, filter and choose scenes, as the experiment says.

    Parameters
    ----------
    request
        What is wanted.
    report
        Told of the progress.
    """
    family = EXPERIMENTS.get(request.experiment).family
    return request.choice.choose(family, request.scene_count, request.seed, report)


def generate_practice(
    experiment: Experiment, count: int, seed: int, report: Report = no_report
) -> list[Scene]:
    """Draw and filter scenes to practise with, unlike those of the same seed to be judged.

    Parameters
    ----------
    experiment
        Whose family and practice filter are used.
    count
        How many.
    seed
        Source of randomness; the scenes' own may be the same.
    report
        Told of the progress.
    """
    own = int(np.random.SeedSequence([seed, _PRACTICE]).generate_state(1)[0])
    rule = experiment.practice_filter
    chosen = filtered_scenes(experiment.family, count, own, rule=rule, report=report).scenes
    return [scene.model_copy(update={"id": f"practice-{scene.id}"}) for scene in chosen]


def new_study(folder: Path, request: SceneRequest, report: Report = no_report) -> Selection:
    """Make a study folder with fresh scenes.

    Parameters
    ----------
    folder
        The folder; must not exist, be empty, or hold no more than what the same call left that
        was interrupted.
    request
        The scenes wanted.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the folder holds something else already, or can't be written.
    """
    if not _is_unfinished(folder, request):
        check_empty(folder)
    write_text(folder / STUDY_FILE, _study_toml(request))
    try:
        selection = generate_scenes(request, report)
    except InputError:  # Asked otherwise, it may go: nothing is to be gone on with.
        (folder / STUDY_FILE).unlink()
        raise
    _write_all(folder, request, selection, report)
    return selection


def _is_unfinished(folder: Path, request: SceneRequest) -> bool:
    """Whether a folder holds what `new_study` left when it was interrupted, and nothing else."""
    try:
        said = (folder / STUDY_FILE).read_text(encoding="utf-8")
        names = {path.name for path in folder.iterdir() if not is_temporary(path)}
    except (OSError, UnicodeDecodeError):
        return False
    return said == _study_toml(request) and names <= {STUDY_FILE, PRACTICE_FILE, CHOSEN_FILE}


def open_study(folder: Path, request: SceneRequest, report: Report = no_report) -> list[Scene]:
    """Scenes of a study that was made by the same request, or of a fresh one.

    Parameters
    ----------
    folder
        The folder; must not exist, be empty, or hold a study of just this request, whole or not.
    request
        The scenes wanted.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the folder holds anything else, or can't be written.
    """
    path = folder / STUDY_FILE
    if not path.is_file():
        return new_study(folder, request, report).scenes
    said, wanted = read_study_file(folder), tomllib.loads(_study_toml(request))
    if (said.experiment, said.generated) != (
        wanted["experiment"],
        _Generated(**wanted["generated"]),
    ):
        raise InputError(f"{path}: the study was made with other settings; choose another folder")
    if not (folder / "scenes.json").is_file():
        _write_all(folder, request, generate_scenes(request, report), report)
    chosen, family = read_chosen(folder), EXPERIMENTS.get(request.experiment).family
    if chosen is None or not chosen.same_rules(family, request.choice):
        raise InputError(
            f"{folder / 'scenes.json'}: drawn by other rules than those of {request.experiment} "
            "today; choose another folder"
        )
    return read_scenes(folder / "scenes.json")


def _write_all(folder: Path, request: SceneRequest, selection: Selection, report: Report) -> None:
    """Scenes last: where they are, all that goes with them is there too."""
    experiment = EXPERIMENTS.get(request.experiment)
    if request.practice:
        practice = generate_practice(experiment, request.practice, request.seed, report)
        write_scenes(folder / PRACTICE_FILE, practice)
    write_chosen(folder, how_chosen(experiment.family, request.choice, selection))
    write_scenes(folder / "scenes.json", selection.scenes)


def _study_toml(request: SceneRequest) -> str:
    lines = [
        "# A pourcast study. Every command takes this folder in place of a scene file.",
        f'experiment = "{request.experiment}"',
        'scenes = "scenes.json"',
        "",
        "[generated]",
        f"count = {request.scene_count}",
        f"seed = {request.seed}",
    ]
    candidates = getattr(request.choice, "candidates", None)
    if candidates is not None:
        lines.append(f"candidates = {candidates}")
    if request.practice:
        lines.append(f"practice = {request.practice}")
    if request.quick and request.choice != replace(request, quick=False).choice:
        lines.append("quick = true")
    return "\n".join(lines) + "\n"


def read_study_file(folder: Path) -> StudyFile:
    """What a study's `study.toml` says; nothing if there is none.

    Raises
    ------
    InputError
        One line that names the file, the field and what was expected.
    """
    path = folder / STUDY_FILE
    if not path.is_file():
        return StudyFile()
    try:
        return StudyFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not TOML ({error})") from None
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None


def study_experiment(folder: Path, scenes: list[Scene]) -> Experiment | None:
    """The experiment that a study was made from.

    Parameters
    ----------
    folder
        The study folder.
    scenes
        Its scenes. If `study.toml` names no experiment, the first one with their goal is taken;
        None if there is none.

    Raises
    ------
    InputError
        If `study.toml` is wrong, or names an experiment that is not there.
    """
    name = read_study_file(folder).experiment
    if name is None:
        return experiment_like(scenes)
    try:
        return EXPERIMENTS.get(name)
    except InputError as error:
        raise InputError(f"{folder / STUDY_FILE}: {error}") from None


def study_liquids(path: Path) -> tuple[Liquid, ...]:
    """Liquids that only a study has, from the tables ``[liquids.<name>]`` of its `study.toml`.

    Parameters
    ----------
    path
        The study folder; a scene file has none.

    Raises
    ------
    InputError
        One line that names the file, the liquid, the field and what was expected.
    """
    if not path.is_dir():
        return ()
    file, liquids = path / STUDY_FILE, []
    for name, table in read_study_file(path).liquids.items():
        source = f"{file}: liquids.{name}"
        for field in {"called", "goals"} & set(table):
            raise InputError(f"{source}: {field}: a study's own liquid goes by its name alone")
        liquids.append(liquid_from(name, table, source))
    try:
        known_liquids(liquids)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    return tuple(liquids)


def load_scenes(path: Path) -> list[Scene]:
    """Scenes of a scene file or of a study folder.

    Raises
    ------
    InputError
        If there are none, or they are not valid.
    """
    return read_scenes(path / "scenes.json" if path.is_dir() else path)


def study_scenes(folder: Path) -> list[Scene]:
    """Scenes of a study folder; a scene file is refused.

    Raises
    ------
    InputError
        If it is no study folder, or its scenes are not valid.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a study folder; `pourcast new` makes one")
    return load_scenes(folder)


def load_practice(folder: Path) -> list[Scene]:
    """Scenes to practise with; none if the study has none.

    Raises
    ------
    InputError
        If they are not valid.
    """
    path = folder / PRACTICE_FILE
    return read_scenes(path) if path.is_file() else []


def pick_scene(scenes: list[Scene], wanted: str, source: Path) -> Scene:
    """Scene of an id, or of a number counted from 1.

    Raises
    ------
    InputError
        If there is no such scene.
    """
    for scene in scenes:
        if scene.id == wanted:
            return scene
    if wanted.isdecimal() and 1 <= int(wanted) <= len(scenes):
        return scenes[int(wanted) - 1]
    raise InputError(
        f"{source}: scene: expected a number from 1 to {len(scenes)} or an id such as "
        f"{scenes[0].id!r}, found {wanted!r}"
    )
