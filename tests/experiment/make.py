"""Small experiments for tests: scenes, stimuli that are made in no time, answers."""

from pathlib import Path

import numpy as np
from PIL import Image

from pourcast.experiment.design.schedule import PRACTICE
from pourcast.experiment.storage.sessions import Arrival
from pourcast.files import write_text
from pourcast.pictures.video import write_film
from pourcast.scenes.liquids.registry import resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.scenes.scene_file import write_scenes
from pourcast.stimuli.make import QUICK
from pourcast.stimuli.manifest import (
    Manifest,
    Stimulus,
    StimulusSet,
    checksum,
    set_folder,
    write_set,
)
from pourcast.study.experiments.registry import EXPERIMENTS
from tests.make import random_scenes

EXP1 = 'groups = [["water"]]\npractice = 1\nfullscreen = false\n'
EXP2 = 'groups = [["water", "honey"]]\nmirrored = ["honey"]\npractice = 1\nfullscreen = false\n'


def scenes_of(experiment: str, count: int, prefix: str = "scene") -> list[Scene]:
    """Unfiltered scenes of one family."""
    goal = EXPERIMENTS.get(experiment).goal
    of_one = [scene for scene in random_scenes(3 * count + 3, seed=5) if scene.goal.kind == goal]
    return [
        scene.model_copy(update={"id": f"{prefix}-{k + 1}"})
        for k, scene in enumerate(of_one[:count])
    ]


def small_study(
    folder: Path, experiment: str = "exp1", *, scenes: int = 6, design: str = ""
) -> Path:
    """A study whose stimuli are grey, and there at once."""
    test = scenes_of(experiment, scenes + 1)
    write_scenes(folder / "scenes.json", test[:scenes])
    practice = [test[-1].model_copy(update={"id": "practice-1"})]
    write_scenes(folder / "practice.json", practice)
    write_text(folder / "experiment.toml", design or (EXP1 if experiment == "exp1" else EXP2))
    stimuli, liquids = [], []
    place = set_folder(folder, QUICK.name)
    place.mkdir(parents=True, exist_ok=True)
    for scene in [*test[:scenes], *practice]:
        for seen in (scene, scene.mirrored()):
            for name in ("water", "honey"):
                liquids.append(resolve_liquid(name, seen))
                stimuli.append(_stimulus(place, seen, liquids[-1].name, scene in practice))
    manifest = Manifest(settings=QUICK, stimuli=tuple(stimuli)).with_liquids(liquids)
    write_set(StimulusSet(place, manifest))
    return folder


def _stimulus(folder: Path, scene: Scene, liquid: str, film: bool) -> Stimulus:
    names = [f"{scene.digest}-{liquid}.png"]
    Image.new("RGB", (40, 60), "grey").save(folder / names[0])
    if film:
        names.append(f"{scene.digest}-{liquid}.mp4")
        write_film(folder / names[1], lambda k: np.full((60, 40, 3), 20 * k, np.uint8), 6)
    return Stimulus(
        scene=scene.digest,
        liquid=liquid,
        still=names[0],
        film=names[1] if film else None,
        checksums={name: checksum(folder / name) for name in names},
    )


def judgment(response: float = 0.25, **changes: object) -> dict[str, object]:
    """What the page posts of a judgment."""
    body: dict[str, object] = {
        "stimulus": "x.png",
        "response": response,
        "start": None,
        "first_move": 0.5,
        "moves": 3,
        "input": "mouse",
        "trajectory": None,
        "rt": 1.25,
        "window_width": 1280,
        "window_height": 720,
        "focus_losses": 0,
        "dropped_frames": 0,
    }
    return body | changes


def answer(kind: str, response: float = 0.25) -> dict[str, object]:
    """What the page posts of any step."""
    return {
        "judgment": judgment(response),
        "film": {"rt": 1.0, "stimulus": "x.mp4", "played": True},
        "instructions": {"rt": 3.0, "attempts": [[1, 0, 1]]},
        "debrief": {"rt": 2.0, "remarks": "=1+1 <b>fine</b>"},
    }.get(kind, {"rt": 1.0})


def arrival(request: str, entry: str = "lab", **identifiers: str) -> Arrival:
    """Somebody who comes."""
    participant = "-".join(identifiers.values())
    return Arrival(request, entry, identifiers, "tab-00000000", participant)


__all__ = [
    "EXP1", "EXP2", "PRACTICE", "answer", "arrival", "judgment", "scenes_of", "small_study",
]  # fmt: skip
