"""The lists of a study's stimuli, read by the experiment and by comparisons.

    stimuli/<solver>-<renderer>/manifest.json      what is there: files, checksums, outcomes
    stimuli/<solver>-<renderer>/<scene>-<liquid>.* the stimuli themselves

A study can have several sets, so that a film that is tried out costs nothing; in one set all
stimuli are made alike, of liquids whose numbers it records: what shows another liquid of the
same name is not taken for it. File names give no outcome away.
"""

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, ValidationError

from pourcast.errors import InputError, one_line
from pourcast.files import write_text
from pourcast.frozen import Frozen
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.renderers.registry import RENDERERS
from pourcast.stimuli.settings import StimulusSettings, first_difference
from pourcast.stimuli.solvers.registry import SOLVERS

FOLDER = "stimuli"
NAME = "manifest.json"


class Stimulus(Frozen):
    """A scene with a liquid, as it is shown.

    Parameters
    ----------
    scene
        Digest of the scene, of its mirror image if that is shown.
    liquid
        Name of the liquid.
    still
        File name of the picture of the start, which is the film's first.
    film, webm
        File names of the film of what happens; None where there is none.
    outcome
        Share that the goal holds at the end; None if it was not simulated.
    stranded
        Share that is still above the goal's rim when the film ends; None, too.
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


class Manifest(Frozen):
    """All stimuli of a set, and how they were made.

    Parameters
    ----------
    settings
        How they were made; `recipe` in the file.
    liquids
        Name of each liquid -> all of it that its stimuli depend on.
    stimuli
        The stimuli.
    solver_code
        Name of the state of the solver's code; empty in sets of before 0.2.
    """

    model_config = ConfigDict(populate_by_name=True)

    format: Literal["pourcast-stimuli"] = "pourcast-stimuli"
    schema_version: Literal[3] = 3
    settings: StimulusSettings = Field(alias="recipe")
    liquids: dict[str, dict[str, float | str | tuple[float, ...]]] = Field(default_factory=dict)
    stimuli: tuple[Stimulus, ...] = ()
    solver_code: str = ""

    def difference(self, liquid: Liquid) -> str:
        """How a liquid differs from that of its name; empty if it doesn't, or is not there yet."""
        if liquid.name not in self.liquids:
            return ""
        there = self.liquids[liquid.name]
        difference = first_difference(there, self.settings.liquid_identity(liquid))
        return difference and f"{liquid.name}: {difference}"

    def with_liquids(self, liquids: Iterable[Liquid]) -> "Manifest":
        """The same with further liquids."""
        more = {liquid.name: self.settings.liquid_identity(liquid) for liquid in liquids}
        return self.model_copy(update={"liquids": self.liquids | more})

    def content(self) -> dict[str, Any]:
        """What stands in the file."""
        return self.model_dump(mode="json", by_alias=True)


@dataclass(frozen=True)
class StimulusRequest:
    """A scene with a liquid that is to be shown; `film` if what happens is, too."""

    scene: Scene
    liquid: Liquid
    film: bool = False

    @property
    def id(self) -> str:
        """Name of the stimulus, and of its files."""
        return f"{self.scene.digest}-{self.liquid.name}"


@dataclass(frozen=True)
class StimulusSet:
    """Stimuli in a folder."""

    folder: Path
    manifest: Manifest

    def find(self, scene: Scene, liquid: Liquid) -> Stimulus | None:
        """Stimulus of a scene with a liquid; None if there is none, or of a liquid that differs."""
        if self.manifest.difference(liquid):
            return None
        key = (scene.digest, liquid.name)  # the digest takes longer than the search
        for stimulus in self.manifest.stimuli:
            if (stimulus.scene, stimulus.liquid) == key:
                return stimulus
        return None

    def has(self, request: StimulusRequest) -> bool:
        """Whether a stimulus is there, with all its files as they were made."""
        stimulus = self.find(request.scene, request.liquid)
        if stimulus is None or (request.film and stimulus.film is None):
            return False
        return self.is_whole(stimulus)

    def is_whole(self, stimulus: Stimulus) -> bool:
        """Whether all files of a stimulus are there, and as they were made."""
        paths = [self.folder / name for name in stimulus.files]
        return all(
            path.is_file() and checksum(path) == stimulus.checksums.get(path.name) for path in paths
        )

    def check_made_alike(self, settings: StimulusSettings, liquids: Iterable[Liquid]) -> None:
        """See to it that further stimuli would be made like those that are there.

        Raises
        ------
        InputError
            If a setting, or a number of a liquid, differs.
        """
        manifest = self.manifest
        differences = [
            manifest.settings.difference(settings),
            *(manifest.difference(liquid) for liquid in liquids),
        ]
        for difference in filter(None, differences):
            raise InputError(
                f"{self.folder}: made with other settings ({difference}); `pourcast stimuli` with "
                "--replace begins it anew"
            )


def set_folder(study: Path, name: str) -> Path:
    """Folder of a study's set of stimuli, by the settings' name."""
    return study / FOLDER / name


def read_set(folder: Path) -> StimulusSet | None:
    """A set of stimuli; None if there is none.

    Raises
    ------
    InputError
        If its list is damaged, or an older version's.
    """
    path = folder / NAME
    try:
        return StimulusSet(folder, Manifest.model_validate_json(path.read_bytes()))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValidationError as error:
        raise InputError(
            f"{path}: {one_line(error)}; `pourcast stimuli` with --replace makes the set anew"
        ) from None


def write_set(stimuli: StimulusSet) -> None:
    """Write the list of a set."""
    content = stimuli.manifest.model_dump_json(indent=1, by_alias=True)
    write_text(stimuli.folder / NAME, content + "\n")


def sets_of(study: Path) -> Iterator[StimulusSet]:
    """A study's sets, those nearest to the paper's first."""
    pairs = [
        (renderer, solver)
        for renderer in RENDERERS.names()
        for solver in SOLVERS.names()
        if (set_folder(study, f"{solver}-{renderer}") / NAME).is_file()
    ]

    def rank(pair: tuple[str, str]) -> tuple[int, int]:
        return -RENDERERS.get(pair[0]).fidelity, -SOLVERS.get(pair[1]).fidelity

    for renderer, solver in sorted(pairs, key=rank):
        stimuli = read_set(set_folder(study, f"{solver}-{renderer}"))
        if stimuli is not None:
            yield stimuli


def best_set(study: Path, requests: Iterable[StimulusRequest]) -> StimulusSet | None:
    """The first set in which all that is asked for is there and whole; None if there is none.

    Raises
    ------
    InputError
        If there is none, but a set of liquids that have changed since.
    """
    asked = list(requests)
    sets = []
    for stimuli in sets_of(study):
        if all(stimuli.has(request) for request in asked):
            return stimuli
        sets.append(stimuli)
    for stimuli in sets:
        stimuli.check_made_alike(stimuli.manifest.settings, (one.liquid for one in asked))
    return None


def checksum(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
