"""Film strips: the same scenes poured as water and as honey, some moments of each, in one picture.

    python -m benchmarks.film_strips FOLDER [--experiment exp1] [--scenes 4] [--seed 1]
        [--renderer preview] [--cells 100]

makes `FOLDER/stimulus-<renderer>.png`, which `docs/how-to/make-stimuli.md` shows. FOLDER keeps the
pours, which both renderers draw, and what Cycles has rendered: the same command goes on after an
interruption.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from benchmarks.stimulus_truth import Film
from pourcast.cli.terminal import progress_bar, resumable
from pourcast.cores import available_cores
from pourcast.progress import Report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.recording import RecordedPour, load_pour, save_pour
from pourcast.stimuli.renderers.base import Renderer
from pourcast.stimuli.renderers.cycles import Cycles
from pourcast.stimuli.renderers.preview import Preview
from pourcast.stimuli.solvers.lbm import FRAME_RATE, LatticeBoltzmann
from pourcast.study.folder import SceneRequest, generate_scenes

MOMENTS = {
    "water": (0.2, 0.35, 0.5, 0.7, 1.0, 1.6, 3.9),
    "honey": (0.25, 0.6, 1.2, 2.5, 4.5, 7.0, 9.9),
}
"""When each film is shown [s]."""

WIDTH, HEIGHT = 140, 210
RENDERERS: dict[str, Renderer] = {
    "preview": Preview(width=WIDTH),
    "cycles": Cycles(width=WIDTH, height=HEIGHT, samples=24),
}

_LINE, _GAP = 22, 12
_SEEN_ABOVE = 0.02
"""Share that is still above the goal's rim, from which on a caption tells it."""


def pour_of(film: Film, folder: Path, report: Report) -> RecordedPour:
    """A pour, from the folder if it is kept there."""
    path = folder / f"{film.digest}.npz"
    pour = load_pour(path)
    if pour is None:
        pour = film.solver.pour(
            film.scene,
            film.liquid,
            film.liquid.film_seconds,
            threads=available_cores(),
            report=report,
        )
        save_pour(path, pour)
    return pour


def strip_of(
    scene: Scene, liquid: Liquid, pour: RecordedPour, renderer: Renderer, folder: Path
) -> tuple[Image.Image, str]:
    """Moments of a pour side by side, and what they are."""
    times = MOMENTS[liquid.called]
    shown = tuple(pour.moments[round(time * FRAME_RATE)] for time in times)
    folder.mkdir(parents=True, exist_ok=True)
    picture = renderer.picture_maker(scene, liquid, replace(pour, moments=shown), folder)
    strip = np.concatenate([picture(k)[:HEIGHT] for k in range(len(times))], axis=1)
    caption = (
        f"{liquid.called} at {', '.join(f'{time:g}' for time in times)} s: "
        f"{pour.outcome:.0%} in the goal"
    )
    if pour.stranded > _SEEN_ABOVE:
        caption += f", {pour.stranded:.0%} still above"
    return Image.fromarray(strip), caption


def sheet_of(strips: Sequence[tuple[Image.Image, str]]) -> Image.Image:
    """Strips of two scenes beside one another, each scene's liquids below one another."""
    wide, liquids = strips[0][0].width + _GAP, len(MOMENTS)
    rows = -(-len(strips) // (2 * liquids)) * liquids
    sheet = Image.new("RGB", (2 * wide - _GAP, rows * (HEIGHT + _LINE)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for number, (strip, caption) in enumerate(strips):
        scene, liquid = divmod(number, liquids)
        left = scene % 2 * wide
        top = (scene // 2 * liquids + liquid) * (HEIGHT + _LINE)
        draw.text((left + 3, top + 3), caption, "#282828", font)
        sheet.paste(strip, (left, top + _LINE))
    return sheet


def main() -> None:
    """Make the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="keeps pours and pictures")
    parser.add_argument("--experiment", default="exp1")
    parser.add_argument("-n", "--scenes", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--renderer", choices=RENDERERS, default="preview")
    parser.add_argument("--cells", type=int, default=100)
    chosen = parser.parse_args()
    folder, renderer = chosen.folder, RENDERERS[chosen.renderer]
    renderer.check_available()
    scenes = generate_scenes(SceneRequest(chosen.experiment, chosen.scenes, chosen.seed)).scenes
    solver, strips = LatticeBoltzmann(resolution=chosen.cells), []
    folder.mkdir(parents=True, exist_ok=True)
    with resumable(folder), progress_bar() as report:
        for scene in scenes:
            for name in MOMENTS:
                film = Film(scene, resolve_liquid(name, scene), solver)
                pour = pour_of(film, folder, report)
                own = folder / f"{chosen.renderer}-{film.digest}"
                strips.append(strip_of(scene, film.liquid, pour, renderer, own))
    path = folder / f"stimulus-{chosen.renderer}.png"
    sheet_of(strips).save(path, optimize=True)
    print(path)


if __name__ == "__main__":
    main()
