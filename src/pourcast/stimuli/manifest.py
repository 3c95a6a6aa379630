"""The lists of a study's stimuli, read by the experiment and by comparisons.

    stimuli/<solver>-<renderer>/manifest.json      what is there: files, checksums, outcomes
    stimuli/<solver>-<renderer>/<scene>-<liquid>.* the stimuli themselves

A study can have several sets, so that a film that is tried out costs nothing; in one set all
stimuli are made alike. File names give no outcome away.
"""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pourcast.errors import InputError, one_line
from pourcast.files import write_text
from pourcast.scenes.scene import Scene
from pourcast.stimuli.recipe import RENDERERS, SOLVERS, Recipe

FOLDER = "stimuli"
NAME = "manifest.json"


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Stimulus(_Frozen):
    """A scene with a liquid, as it is shown.

    Parameters
    ----------
    scene
        Digest of the scene, of its mirror image if that is shown.
    liquid
        `water` or `honey`.
    still
        File name of the picture of the start, which is the film's first.
    film, webm
        File names of the film of what happens; None where there is none.
    outcome
        Share that ends in the right basin, or in the cup; None if it was not simulated.
    stranded
        Share that is still above the goal's rim when the film ends; likewise.
    checksums
        SHA-256 of each file.
    """

    scene: str
    liquid: str
    still: str
    film: str | None = None
    webm: str | None = None
    outcome: float | None = Field(default=None, ge=0.0, le=1.0)
    stranded: float | None = Field(default=None, ge=0.0, le=1.0)
    checksums: dict[str, str]

    @property
    def files(self) -> list[str]:
        """Names of all its files."""
        return [name for name in (self.still, self.film, self.webm) if name is not None]


class Manifest(_Frozen):
    """All stimuli of a set, and how they were made."""

    format: Literal["pourcast-stimuli"] = "pourcast-stimuli"
    schema_version: Literal[2] = 2
    recipe: Recipe
    stimuli: tuple[Stimulus, ...] = ()


@dataclass(frozen=True)
class Wanted:
    """A scene with water or honey that is to be shown; `film` if what happens is, too."""

    scene: Scene
    liquid: str
    film: bool = False


@dataclass(frozen=True)
class StimulusSet:
    """Stimuli in a folder."""

    folder: Path
    manifest: Manifest

    def find(self, scene: Scene, liquid: str) -> Stimulus | None:
        """Stimulus of a scene with a liquid, if there is one."""
        wanted = (scene.digest, liquid)  # the digest takes longer than the search
        for stimulus in self.manifest.stimuli:
            if (stimulus.scene, stimulus.liquid) == wanted:
                return stimulus
        return None

    def has(self, wanted: Wanted) -> bool:
        """Whether a stimulus is there, with all its files as they were made."""
        found = self.find(wanted.scene, wanted.liquid)
        if found is None or (wanted.film and found.film is None):
            return False
        return self.is_whole(found)

    def is_whole(self, stimulus: Stimulus) -> bool:
        """Whether all files of a stimulus are there, and as they were made."""
        paths = [self.folder / name for name in stimulus.files]
        return all(
            path.is_file() and checksum(path) == stimulus.checksums.get(path.name) for path in paths
        )


def set_folder(study: Path, name: str) -> Path:
    """Folder of a study's set of stimuli, by the recipe's name."""
    return study / FOLDER / name


def read_set(folder: Path) -> StimulusSet | None:
    """A set of stimuli; None if there is none.

    Raises
    ------
    InputError
        If its list is damaged.
    """
    path = folder / NAME
    try:
        return StimulusSet(folder, Manifest.model_validate_json(path.read_bytes()))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None


def write_set(found: StimulusSet) -> None:
    """Write the list of a set."""
    write_text(found.folder / NAME, found.manifest.model_dump_json(indent=1) + "\n")


def sets_of(study: Path) -> Iterator[StimulusSet]:
    """A study's sets, those nearest to the paper's first."""
    for renderer in RENDERERS:
        for solver in SOLVERS:
            found = read_set(set_folder(study, f"{solver}-{renderer}"))
            if found is not None:
                yield found


def best_set(study: Path, wanted: Iterable[Wanted]) -> StimulusSet | None:
    """The first set in which all that is wanted is there and whole; None if there is none."""
    all_wanted = list(wanted)
    for found in sets_of(study):
        if all(found.has(one) for one in all_wanted):
            return found
    return None


def checksum(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
