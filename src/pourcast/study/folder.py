"""The study folder: `study.toml` says how it was made, `scenes.json` holds the scenes.

`practice.json` holds those that participants practise with, and no model is compared on.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pourcast.errors import InputError
from pourcast.files import check_empty, write_text
from pourcast.progress import Report
from pourcast.scenes.families.shapes import ShapesFamily
from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes, write_scenes
from pourcast.study.selection import Selection, contrasting_scenes, filtered_scenes

EXPERIMENTS = ("exp1", "exp2")

DATABASE = "responses.sqlite"
"""The responses of the study's experiment, unless a PostgreSQL server has them."""

DEFAULT_SCENES = {"exp1": 120, "exp2": 60}
"""The paper's set sizes."""

_PRACTICE = 1
"""Apart from the scenes' own random numbers, whose seed is not a list."""


@dataclass(frozen=True)
class SceneRequest:
    """What scenes are wanted: experiment, number, seed, and size of Experiment 2's pool.

    `practice` is how many more are for practice.
    """

    experiment: str
    count: int
    seed: int
    candidates: int
    practice: int = 0

    def __post_init__(self) -> None:
        if self.experiment not in EXPERIMENTS:
            raise InputError(
                f"experiment: expected {' or '.join(EXPERIMENTS)}, found {self.experiment!r}"
            )
        if self.count < 1:
            raise InputError(f"scenes: expected at least 1, found {self.count}")
        if self.seed < 0:
            raise InputError(f"seed: expected 0 or more, found {self.seed}")
        if self.practice < 0:
            raise InputError(f"practice: expected 0 or more, found {self.practice}")


def generate_scenes(request: SceneRequest, report: Report | None = None) -> Selection:
    """Draw, filter and (Experiment 2) choose scenes.

    Parameters
    ----------
    request
        What is wanted.
    report
        Told of the progress.
    """
    if request.experiment == "exp1":
        return filtered_scenes(VoronoiFamily(), request.count, request.seed, report=report)
    return contrasting_scenes(
        ShapesFamily(), request.count, request.seed, candidates=request.candidates, report=report
    )


def generate_practice(
    experiment: str, count: int, seed: int, report: Report | None = None
) -> list[Scene]:
    """Draw and filter scenes to practise with, unlike those of the same seed to be judged.

    Parameters
    ----------
    experiment
        One of `EXPERIMENTS`.
    count
        How many.
    seed
        Source of randomness; the scenes' own may be the same.
    report
        Told of the progress.
    """
    family = VoronoiFamily() if experiment == "exp1" else ShapesFamily()
    own = int(np.random.SeedSequence([seed, _PRACTICE]).generate_state(1)[0])
    chosen = filtered_scenes(family, count, own, report=report).scenes
    return [scene.model_copy(update={"id": f"practice-{scene.id}"}) for scene in chosen]


def new_study(folder: Path, request: SceneRequest, report: Report | None = None) -> Selection:
    """Make a study folder with fresh scenes.

    Parameters
    ----------
    folder
        The folder; must not exist, or be empty.
    request
        The scenes wanted.
    report
        Told of the progress.

    Raises
    ------
    InputError
        If the folder holds something already, or can't be written.
    """
    check_empty(folder)
    write_text(folder / "study.toml", _study_toml(request))
    selection = generate_scenes(request, report)
    write_scenes(folder / "scenes.json", selection.scenes)
    if request.practice:
        practice = generate_practice(request.experiment, request.practice, request.seed, report)
        write_scenes(folder / "practice.json", practice)
    return selection


def open_study(folder: Path, request: SceneRequest, report: Report | None = None) -> list[Scene]:
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
    told = folder / "study.toml"
    if not told.is_file():
        return new_study(folder, request, report).scenes
    if told.read_text(encoding="utf-8") != _study_toml(request):
        raise InputError(f"{told}: the study was made with other settings; choose another folder")
    if not (folder / "scenes.json").is_file():
        write_scenes(folder / "scenes.json", generate_scenes(request, report).scenes)
    return read_scenes(folder / "scenes.json")


def _study_toml(request: SceneRequest) -> str:
    lines = [
        "# A pourcast study. Every command takes this folder in place of a scene file.",
        f'experiment = "{request.experiment}"',
        'scenes = "scenes.json"',
        "",
        "[generated]",
        f"count = {request.count}",
        f"seed = {request.seed}",
    ]
    if request.experiment == "exp2":
        lines.append(f"candidates = {request.candidates}")
    if request.practice:
        lines.append(f"practice = {request.practice}")
    return "\n".join(lines) + "\n"


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
    path = folder / "practice.json"
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
