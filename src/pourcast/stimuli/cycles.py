"""Pictures by Blender's path tracer Cycles, with the paper's look.

Blender is a program of its own, and runs in a process of its own: an installed `blender`, or the
package `bpy` in this environment or another. What it does is in `blender/scene.py`, which needs
nothing of pourcast.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pourcast.errors import InputError, StoreError
from pourcast.extras import require_extra
from pourcast.progress import Report
from pourcast.scenes.scene import Scene
from pourcast.stimuli.poured import Poured
from pourcast.stimuli.recipe import CyclesRecipe
from pourcast.stimuli.surface import liquid_mesh

VARIABLE = "POURCAST_BLENDER"
"""Environment variable that names Blender, or a Python that has `bpy`."""

SCRIPT = Path(__file__).parent / "blender" / "scene.py"


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


def render(
    scene: Scene,
    liquid: str,
    poured: Poured,
    recipe: CyclesRecipe,
    pictures: Sequence[Path],
    *,
    threads: int = 0,
    report: Report | None = None,
) -> None:
    """Render those pictures of a pour that are not there yet.

    Parameters
    ----------
    scene
        The scene.
    liquid
        `water` or `honey`.
    poured
        The pour.
    recipe
        Settings.
    pictures
        File names (.png), one for each picture of the pour.
    threads
        Threads of the renderer; all cores by default.
    report
        Told of the pictures that are done.

    Raises
    ------
    InputError
        If there is no Blender.
    StoreError
        If it fails. Pictures that were done stay.
    """
    missing = [k for k, path in enumerate(pictures) if not path.is_file()]
    if not missing:
        return
    blender = find_blender()
    folder = pictures[0].parent
    meshes = {k: folder / f"mesh-{k:04d}.npz" for k in missing}
    for k, path in meshes.items():
        mesh = liquid_mesh(poured, k)
        np.savez(path, vertices=mesh.vertices, triangles=mesh.triangles)
    job = {
        "box": scene.box.model_dump(),
        "obstacles": scene.obstacles,
        "goal": scene.goal.solids,
        "liquid": liquid,
        "size": [recipe.width, recipe.height],
        "samples": recipe.samples,
        "denoise": recipe.denoise,
        "threads": threads,
        "pictures": [[str(meshes[k].absolute()), str(pictures[k].absolute())] for k in missing],
    }
    job_file = folder / "job.json"
    job_file.write_text(json.dumps(job), encoding="utf-8")
    _run(
        [*blender, str(SCRIPT), "--", str(job_file.absolute())],
        folder,
        len(pictures),
        len(missing),
        report,
    )
    for path in (*meshes.values(), job_file):
        path.unlink(missing_ok=True)


def _run(command: list[str], folder: Path, count: int, missing: int, report: Report | None) -> None:
    """Run Blender; tell of each picture that it says is done."""
    done = count - missing
    with (folder / "blender.log").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
        )
        assert process.stdout is not None
        try:
            for line in process.stdout:
                log.write(line)
                if line.startswith("picture done"):
                    done += 1
                    if report is not None:
                        report("rendering", done, count)
        finally:
            process.terminate()
            process.wait()
    if done < count:
        lines = (folder / "blender.log").read_text(encoding="utf-8").strip().splitlines()
        reason = lines[-1] if lines else "it said nothing"
        raise StoreError(f"Blender stopped after {done} of {count} pictures: {reason}")
