"""All stimuli of a set at a glance, for the researcher's eyes: how each begins and ends."""

import textwrap
from collections.abc import Sequence
from pathlib import Path

import av
from PIL import Image, ImageDraw, ImageFont

from pourcast.files import replacing
from pourcast.scenes.scene import Scene
from pourcast.stimuli.manifest import Stimulus, StimulusSet

NAME = "contact-sheet.png"

_ROWS_BESIDE = 3
"""Scenes side by side."""
_WIDTH = 150
_GAP = 8
_LINE = 20
_LETTERS = 22
"""As many letters are as wide as a picture."""
_PAPER, _INK = (255, 255, 255), (40, 40, 40)


def write_contact_sheet(stimuli: StimulusSet, scenes: Sequence[Scene]) -> Path:
    """Picture the start of each scene and the end of each of its films, with the outcomes.

    Parameters
    ----------
    stimuli
        The set.
    scenes
        Its scenes; those without stimuli are left out, and mirror images stand for them.

    Returns
    -------
    Path
        The picture, in the set's folder. It tells the outcomes: not for participants.
    """
    rows = [one for scene in scenes if (one := _row(stimuli, scene)) is not None]
    columns = max((len(row) for _, row in rows), default=0)
    height = max((image.height for _, row in rows for image, _ in row), default=0)
    lines = max((words.count("\n") + 1 for _, row in rows for _, words in row), default=1)
    cell = (columns * (_WIDTH + _GAP) + 2 * _GAP, height + (1 + lines) * _LINE + _GAP)
    beside = min(_ROWS_BESIDE, max(1, len(rows)))
    down = -(-len(rows) // beside)
    sheet = Image.new("RGB", (beside * cell[0] + _GAP, down * cell[1] + _GAP), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for number, (name, row) in enumerate(rows):
        left = _GAP + number % beside * cell[0]
        top = _GAP + number // beside * cell[1]
        draw.text((left, top), name, _INK, font)
        for k, (image, words) in enumerate(row):
            place = left + k * (_WIDTH + _GAP)
            sheet.paste(image, (place, top + _LINE))
            draw.text((place, top + _LINE + image.height + 1), words, _INK, font)
    path = stimuli.folder / NAME
    with replacing(path) as temporary:
        sheet.save(temporary)
    return path


def _row(stimuli: StimulusSet, scene: Scene) -> tuple[str, list[tuple[Image.Image, str]]] | None:
    """Name of a scene; its start and its ends, and what each is."""
    stimuli_of_scene = _of_scene(stimuli, scene)
    if not stimuli_of_scene:
        return None
    first, caption = stimuli_of_scene[0]
    start = _small(Image.open(stimuli.folder / first.still).convert("RGB"))
    ends = [
        (_small(last_picture(stimuli.folder / stimulus.film)), _with_outcome(caption, stimulus))
        for stimulus, caption in stimuli_of_scene
        if stimulus.film is not None
    ]
    return scene.id, [(start, _wrapped(f"{caption} starts")), *ends]


def _of_scene(stimuli: StimulusSet, scene: Scene) -> list[tuple[Stimulus, str]]:
    """A scene's stimulus with each liquid, in a mirror if there is none without; captions."""
    of_liquid: dict[str, tuple[Stimulus, str]] = {}
    for seen, how in ((scene.mirrored(), ", mirrored"), (scene, "")):
        digest = seen.digest
        for stimulus in stimuli.manifest.stimuli:
            if stimulus.scene == digest:
                of_liquid[stimulus.liquid] = stimulus, stimulus.liquid + how
    return [of_liquid[name] for name in stimuli.manifest.liquids if name in of_liquid]


def _with_outcome(caption: str, stimulus: Stimulus) -> str:
    if stimulus.outcome is None:
        return _wrapped(caption)
    stuck = f", {stimulus.stranded:.0%} stuck" if (stimulus.stranded or 0.0) >= 0.01 else ""
    return f"{_wrapped(caption)}\n{stimulus.outcome:.2f}{stuck}"


def _wrapped(caption: str) -> str:
    """A caption in lines that are no wider than a picture."""
    return textwrap.fill(caption, _LETTERS)


def _small(image: Image.Image) -> Image.Image:
    size = (_WIDTH, round(image.height * _WIDTH / image.width))
    return image.resize(size, Image.Resampling.LANCZOS)


def last_picture(film: Path) -> Image.Image:
    """The last picture of a film."""
    with av.open(str(film)) as container:
        *_, last = container.decode(video=0)
        return Image.fromarray(last.to_ndarray(format="rgb24"))
