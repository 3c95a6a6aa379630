"""Pictures by Blender's path tracer Cycles, with the paper's look.

Blender is a program of its own, and runs in a process of its own: an installed `blender`, or the
package `bpy` in this environment or another. What it does is in `stimuli/blender/scene.py`, which
needs nothing of pourcast.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import Field

from pourcast.errors import InputError, StoreError
from pourcast.extras import require_extra
from pourcast.pictures.video import Picture
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.recording import RecordedPour
from pourcast.stimuli.renderers.base import Renderer, picture_file
from pourcast.stimuli.surface import liquid_mesh

VARIABLE = "POURCAST_BLENDER"
"""Environment variable that names Blender, or a Python that has `bpy`."""

SCRIPT = Path(__file__).parents[1] / "blender" / "scene.py"


class Cycles(Renderer):
    """Blender's Cycles.

    Parameters
    ----------
    width, height
        Of the pictures [pixels].
    samples
        Paths per pixel; noise falls with their square root.
    denoise
        Whether to smooth away what noise is left.
    """

    name: ClassVar[str] = "cycles"
    fidelity: ClassVar[int] = 1
    slow: ClassVar[bool] = True

    width: int = Field(default=640, ge=80, le=4000, multiple_of=2)
    height: int = Field(default=960, ge=80, le=4000, multiple_of=2)
    samples: int = Field(default=64, ge=1, le=4096)
    denoise: bool = True

    def picture_maker(
        self, scene: Scene, liquid: Liquid, pour: RecordedPour, folder: Path, *, threads: int = 0
    ) -> Picture:
        """Render all pictures that are not there yet. See `Renderer.picture_maker`.

        Raises
        ------
        InputError
            If there is no Blender.
        StoreError
            If it fails. Pictures that were done stay.
        """
        paths = [picture_file(folder, k) for k in range(len(pour.moments))]
        missing = [k for k, path in enumerate(paths) if not path.is_file()]
        if missing:
            self._render(scene, liquid, pour, folder, missing, threads)

        def picture(number: int) -> NDArray[np.uint8]:
            with Image.open(paths[number]) as image:
                return np.asarray(image.convert("RGB"))

        return picture

    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """The colour of its glass. See `Renderer.liquid_identity`."""
        return {"glass_colour": liquid.glass_rgb}

    def check_available(self) -> None:
        """Look for Blender. See `Renderer.check_available`."""
        find_blender()

    def _render(
        self,
        scene: Scene,
        liquid: Liquid,
        pour: RecordedPour,
        folder: Path,
        missing: Sequence[int],
        threads: int,
    ) -> None:
        blender = find_blender()
        meshes = {k: folder / f"mesh-{k:04d}.npz" for k in missing}
        for k, path in meshes.items():
            mesh = liquid_mesh(pour, k)
            np.savez(path, vertices=mesh.vertices, triangles=mesh.triangles)
        pictures = [
            [str(path.absolute()), str(picture_file(folder, k).absolute())]
            for k, path in meshes.items()
        ]
        job = {
            "box": scene.box.model_dump(),
            "obstacles": scene.obstacles,
            "goal": scene.goal.solids,
            "liquid_colour": liquid.glass_rgb,
            "size": [self.width, self.height],
            "samples": self.samples,
            "denoise": self.denoise,
            "threads": threads,
            "pictures": pictures,
        }
        job_file = folder / "job.json"
        job_file.write_text(json.dumps(job), encoding="utf-8")
        done = _run([*blender, str(SCRIPT), "--", str(job_file.absolute())], folder / "blender.log")
        if done < len(missing):
            count = len(pour.moments)
            raise StoreError(
                f"Blender stopped after {count - len(missing) + done} of {count} pictures: "
                f"{_last_line(folder / 'blender.log')}"
            )
        for path in (*meshes.values(), job_file):
            path.unlink(missing_ok=True)


def find_blender() -> list[str]:
    """Command that runs a script inside Blender; the script's name and arguments come after it.

    Raises
    ------
    InputError
        If there is no Blender.
    """
    require_extra("stimuli")
    named = os.environ.get(VARIABLE)
    if named is not None:
        program = shutil.which(named)
        if program is None:
            raise InputError(f"{VARIABLE}: {named}: no such program")
        return _command(program)
    if importlib.util.find_spec("bpy") is not None:
        return [sys.executable]
    program = shutil.which("blender")
    if program is None:
        raise InputError(
            "--renderer cycles needs Blender: pip install 'pourcast[stimuli]' with Python 3.11, or "
            f"install Blender (blender.org), or name it in {VARIABLE}; --renderer preview does "
            "without"
        )
    return _command(program)


def _command(program: str) -> list[str]:
    if Path(program).name.startswith("python"):
        return [program]
    return [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python"]


def _run(command: list[str], log_file: Path) -> int:
    """Run Blender; returns how many pictures it says are done."""
    done = 0
    with log_file.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
        )
        assert process.stdout is not None
        try:
            for line in process.stdout:
                log.write(line)
                done += line.startswith("picture done")
        finally:
            process.terminate()
            process.wait()
    return done


def _last_line(log_file: Path) -> str:
    lines = log_file.read_text(encoding="utf-8").strip().splitlines()
    return lines[-1] if lines else "it said nothing"


RENDERER = Cycles
