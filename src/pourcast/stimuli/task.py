"""A worker's part: pour a liquid, draw it, and keep still, film and outcome."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout
from PIL import Image

from pourcast.cores import available_cores
from pourcast.errors import InputError, StoreError
from pourcast.files import replacing, write_text
from pourcast.pictures.video import FRAME_RATE, write_film
from pourcast.stimuli.manifest import Stimulus, StimulusRequest, checksum
from pourcast.stimuli.recording import RecordedPour, load_pour, save_pour
from pourcast.stimuli.renderers.base import picture_file
from pourcast.stimuli.settings import StimulusSettings
from pourcast.sweep.task import OnWork, TaskResult, no_work, told

WORK = "work"
"""Folder of what is not finished."""

MADE = (".png", ".mp4", ".webm")
"""Endings of the files of a set."""


@dataclass(frozen=True)
class StimulusTask:
    """A stimulus that is to be made.

    Parameters
    ----------
    folder
        Folder of the set; the worker sees it under the same name.
    request
        Scene and liquid, and whether a film is asked for.
    settings
        How it is made.
    threads
        Threads for it, all that the worker has by default; what comes out doesn't depend on them.
    """

    folder: Path
    request: StimulusRequest
    settings: StimulusSettings
    threads: int | None = None

    @property
    def id(self) -> str:
        """Name of the stimulus, and of its files."""
        return self.request.id

    @property
    def core_count(self) -> int:
        """Threads for it."""
        return self.threads or available_cores()

    @property
    def work(self) -> Path:
        """Folder of what is not finished: the pour, and pictures that are rendered."""
        return self.folder / WORK / self.id

    @property
    def entry(self) -> Path:
        """File of the stimulus's line in the list, once it is there."""
        return self.folder / WORK / f"{self.id}.json"

    @property
    def picture_count(self) -> int:
        """Pictures of the film; 1 without."""
        if not self.request.film:
            return 1
        return max(1, round(self.settings.film_seconds(self.request.liquid) * FRAME_RATE))

    @property
    def pictures_done(self) -> int:
        """Pictures that a slow renderer has made so far."""
        return sum(picture_file(self.work, k).is_file() for k in range(self.picture_count))

    def run(self, on_work: OnWork = no_work) -> TaskResult:
        """Make the stimulus, from where it stopped; never raises an ordinary error.

        What is told of as simulations are moments of the pour, one a picture.
        """
        try:
            self.work.mkdir(parents=True, exist_ok=True)
            with FileLock(self.folder / WORK / f"{self.id}.lock", blocking=False):
                self._make(on_work)
        except Timeout:
            return TaskResult(self.id, "busy")
        except (InputError, StoreError, OSError) as error:
            return TaskResult(self.id, "store", str(error))
        except Exception as error:
            return TaskResult(self.id, "failed", told(error))
        return TaskResult(self.id, "done")

    def _make(self, on_work: OnWork) -> None:
        request, settings = self.request, self.settings
        pour = self._pour(on_work)
        picture = settings.renderer.picture_maker(
            request.scene, request.liquid, pour, self.work, threads=self.core_count
        )
        made = [self.folder / f"{self.id}.png"]
        with replacing(made[0]) as temporary:
            Image.fromarray(picture(0)).save(temporary)
        if request.film:
            for suffix in (".mp4", ".webm") if settings.webm else (".mp4",):
                made.append(self.folder / f"{self.id}{suffix}")
                with replacing(made[-1]) as temporary:
                    write_film(
                        temporary, picture, self.picture_count, self._metadata(),
                        threads=self.core_count,
                    )  # fmt: skip
        stimulus = Stimulus(
            scene=request.scene.digest,
            liquid=request.liquid.name,
            still=made[0].name,
            film=made[1].name if request.film else None,
            webm=made[2].name if len(made) > 2 else None,
            outcome=round(pour.outcome, 6) if request.film else None,
            stranded=round(pour.stranded, 6) if request.film else None,
            checksums={path.name: checksum(path) for path in made},
        )
        write_text(self.entry, stimulus.model_dump_json() + "\n")
        shutil.rmtree(self.work)

    def _pour(self, on_work: OnWork) -> RecordedPour:
        """The pour, from an earlier try if there was one."""
        told = 0

        def report(_what: str, done: int, _total: int) -> None:
            nonlocal told
            on_work(done - told, 0.0)
            told = done

        path = self.work / "pour.npz"
        kept = load_pour(path)
        if kept is not None and len(kept.moments) == self.picture_count:
            return kept
        pour = self.settings.solver.pour(
            self.request.scene,
            self.request.liquid,
            self.picture_count / FRAME_RATE,
            threads=self.core_count,
            report=report,
        )
        if self.settings.renderer.slow:
            save_pour(path, pour)
        return pour

    def _metadata(self) -> dict[str, str]:
        """What the film's file says of itself; nothing of how it ends."""
        scene, liquid = self.request.scene, self.request.liquid
        about = {
            "scene": scene.digest,
            "liquid": liquid.name,
            "solver": self.settings.solver.name,
            "renderer": self.settings.renderer.name,
            "seed": 0,
        }
        return {"title": f"{scene.digest} {liquid.name}", "comment": json.dumps(about)}
