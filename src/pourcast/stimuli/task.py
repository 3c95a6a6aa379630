"""A worker's part: pour a liquid, picture it, and keep still, film and outcome."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from filelock import FileLock, Timeout
from PIL import Image

from pourcast.engine.batch import available_cores
from pourcast.errors import InputError, StoreError
from pourcast.files import replacing, write_text
from pourcast.pictures.video import FRAME_RATE, Picture, write_film
from pourcast.stimuli import cycles
from pourcast.stimuli.manifest import Stimulus, Wanted, checksum
from pourcast.stimuli.poured import Poured, load_poured, save_poured
from pourcast.stimuli.preview import picture_maker
from pourcast.stimuli.recipe import CyclesRecipe, LatticeRecipe, Recipe
from pourcast.stimuli.solvers import lbm, sph
from pourcast.sweep.task import OnWork, TaskResult, told

WORK = "work"
"""Folder of what is not finished."""


@dataclass(frozen=True)
class StimulusTask:
    """A stimulus that is to be made.

    Parameters
    ----------
    folder
        Folder of the set; the worker sees it under the same name.
    wanted
        Scene and liquid, and whether a film is wanted.
    recipe
        How it is made.
    threads
        Threads for it, all that the worker has by default; what comes out doesn't depend on them.
    """

    folder: Path
    wanted: Wanted
    recipe: Recipe
    threads: int | None = None

    @property
    def id(self) -> str:
        """Name of the stimulus, and of its files."""
        return f"{self.wanted.scene.digest}-{self.wanted.liquid}"

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
        if not self.wanted.film:
            return 1
        return max(1, round(self.recipe.film_seconds(self.wanted.liquid) * FRAME_RATE))

    @property
    def pictures_done(self) -> int:
        """Pictures that are rendered so far."""
        return len(list(self.work.glob("[0-9]*.png"))) if self.work.is_dir() else 0

    def run(self, on_work: OnWork | None = None) -> TaskResult:
        """Make the stimulus, from where it stopped; never raises an ordinary error."""
        try:
            self.work.mkdir(parents=True, exist_ok=True)
            with FileLock(self.folder / WORK / f"{self.id}.lock", blocking=False):
                self._make()
        except Timeout:
            return TaskResult(self.id, "busy")
        except (InputError, StoreError, OSError) as error:
            return TaskResult(self.id, "store", str(error))
        except Exception as error:
            return TaskResult(self.id, "failed", told(error))
        return TaskResult(self.id, "done")

    def _make(self) -> None:
        poured = self._poured()
        picture = self._picture(poured)
        made = [self.folder / f"{self.id}.png"]
        with replacing(made[0]) as temporary:
            Image.fromarray(picture(0)).save(temporary)
        if self.wanted.film:
            for suffix in (".mp4", ".webm") if self.recipe.webm else (".mp4",):
                made.append(self.folder / f"{self.id}{suffix}")
                with replacing(made[-1]) as temporary:
                    write_film(temporary, picture, self.picture_count, self._metadata())
        stimulus = Stimulus(
            scene=self.wanted.scene.digest,
            liquid=self.wanted.liquid,
            still=made[0].name,
            film=made[1].name if self.wanted.film else None,
            webm=made[2].name if len(made) > 2 else None,
            outcome=round(poured.outcome, 6) if self.wanted.film else None,
            stranded=round(poured.stranded, 6) if self.wanted.film else None,
            checksums={path.name: checksum(path) for path in made},
        )
        write_text(self.entry, stimulus.model_dump_json() + "\n")
        shutil.rmtree(self.work)

    def _poured(self) -> Poured:
        """The pour, from an earlier try if there was one."""
        path = self.work / "pour.npz"
        if path.is_file():
            kept = load_poured(path)
            if len(kept.moments) == self.picture_count:
                return kept
        scene, liquid, flow = self.wanted.scene, self.wanted.liquid, self.recipe.flow
        seconds = self.picture_count / FRAME_RATE
        if isinstance(flow, LatticeRecipe):
            poured = lbm.pour(scene, liquid, flow, seconds, threads=self.core_count)
        else:
            poured = sph.pour(scene, liquid, seconds)
        if isinstance(self.recipe.look, CyclesRecipe):
            save_poured(path, poured)
        return poured

    def _picture(self, poured: Poured) -> Picture:
        """What gives the pictures, all of which Cycles renders first."""
        scene, liquid, look = self.wanted.scene, self.wanted.liquid, self.recipe.look
        if not isinstance(look, CyclesRecipe):
            return picture_maker(scene, liquid, poured, look.width)
        paths = [self.work / f"{k:04d}.png" for k in range(self.picture_count)]
        cycles.render(scene, liquid, poured, look, paths, threads=self.core_count)
        return lambda number: np.asarray(Image.open(paths[number]).convert("RGB"))

    def _metadata(self) -> dict[str, str]:
        """What the film's file says of itself; nothing of how it ends."""
        scene, liquid = self.wanted.scene, self.wanted.liquid
        about = {
            "scene": scene.digest,
            "liquid": liquid,
            "solver": self.recipe.flow.solver,
            "renderer": self.recipe.look.renderer,
            "seed": 0,
        }
        return {"title": f"{scene.digest} {liquid}", "comment": json.dumps(about)}
