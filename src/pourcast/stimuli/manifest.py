"""The list of a study's stimuli: `stimuli/manifest.json`, read by the experiment."""

import hashlib
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pourcast.errors import InputError
from pourcast.files import write_text
from pourcast.scene import Scene, one_line

FOLDER = "stimuli"
NAME = "manifest.json"

FILM_SECONDS = {"water": 4.0, "honey": 10.0}
"""How long the paper's films run [s], by the liquid's kind."""


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
        File name of the picture of the start.
    film
        File name of the film of what happens; None where nobody is to see it.
    outcome
        Share that ends in the right basin, or in the cup; None if it was not simulated.
    checksums
        SHA-256 of each file.
    """

    scene: str
    liquid: str
    still: str
    film: str | None = None
    outcome: float | None = Field(default=None, ge=0.0, le=1.0)
    checksums: dict[str, str]


class Manifest(_Frozen):
    """All stimuli of a study, and who made them."""

    format: Literal["pourcast-stimuli"] = "pourcast-stimuli"
    schema_version: Literal[1] = 1
    solver: str = ""
    renderer: str = ""
    stimuli: tuple[Stimulus, ...] = ()

    def find(self, scene: Scene, liquid: str) -> Stimulus | None:
        """Stimulus of a scene with a liquid, if there is one."""
        wanted = (scene.digest, liquid)  # the digest takes longer than the search
        for stimulus in self.stimuli:
            if (stimulus.scene, stimulus.liquid) == wanted:
                return stimulus
        return None


def read_manifest(study: Path) -> Manifest:
    """List of a study's stimuli; an empty one if none were made.

    Raises
    ------
    InputError
        If the file is damaged.
    """
    path = study / FOLDER / NAME
    try:
        return Manifest.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return Manifest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None


def write_manifest(study: Path, manifest: Manifest) -> None:
    """Write the list of a study's stimuli."""
    write_text(study / FOLDER / NAME, manifest.model_dump_json(indent=1) + "\n")


def checksum(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def is_whole(study: Path, stimulus: Stimulus) -> bool:
    """Whether all files of a stimulus are there, and as they were made."""
    names = [name for name in (stimulus.still, stimulus.film) if name is not None]
    paths = [study / FOLDER / name for name in names]
    return all(
        path.is_file() and checksum(path) == stimulus.checksums.get(path.name) for path in paths
    )
