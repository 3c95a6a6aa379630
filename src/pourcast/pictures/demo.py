"""The first contact: one scene of each experiment, every model's judgment, a film."""

from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

import pandas as pd

from pourcast.models.registry import complete_presets
from pourcast.pictures.show import show
from pourcast.prediction import predict
from pourcast.progress import Report, no_report
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import read_scenes

FILM_MODELS = ("truth-water", "water-ife", "truth-honey")
PICTURE_MODELS = ("water-ife", "honey-ife-1", "water-simple")


@dataclass(frozen=True)
class DemoResult:
    """What the demo made."""

    table: pd.DataFrame
    """Judgments, a row a model, a column a scene."""
    files: dict[Path, str]
    """Files written, and what each shows."""
    shares: dict[str, str]
    """Scene -> what its judgments are."""


def demo_scenes() -> list[Scene]:
    """The two scenes of the demo, one of each experiment."""
    with as_file(files("pourcast.pictures").joinpath("demo.json")) as path:
        return read_scenes(path)


def run_demo(folder: Path, report: Report = no_report) -> DemoResult:
    """Judge the demo's scenes with every built-in preset; make pictures and a film.

    Parameters
    ----------
    folder
        Folder to write to.
    report
        Told of the progress.

    Returns
    -------
    DemoResult
        Judgments and files.
    """
    scenes = demo_scenes()
    names = complete_presets()
    table = predict(
        scenes,
        names,
        record=dict.fromkeys([*PICTURE_MODELS, *FILM_MODELS]),
        report=lambda name, done, total: report(f"judging: {name}", done, total),
    )
    wide = table.pivot(index="model", columns="scene", values="judgment").loc[names]
    made: dict[Path, str] = {}
    for scene in scenes:
        picture = folder / f"{scene.id}.png"
        report(f"drawing {picture.name}", 0, 1)
        show(scene, picture, PICTURE_MODELS)
        made[picture] = "six moments of a pour: " + ", ".join(PICTURE_MODELS)
    film = folder / f"{scenes[0].id}.gif"
    show(scenes[0], film, FILM_MODELS, report=report)
    made[film] = "side by side: " + ", ".join(FILM_MODELS)
    return DemoResult(wide, made, {scene.id: scene.goal.share for scene in scenes})
