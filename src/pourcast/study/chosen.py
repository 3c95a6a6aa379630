"""`chosen.json`: how a study's scenes were drawn and chosen, kept beside them.

What an experiment draws may change from one release to the next; this says what was done, and tells
older scenes from those that would be drawn today.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from itertools import count
from pathlib import Path
from typing import Any

from pydantic import ValidationError

import pourcast
from pourcast.errors import InputError, one_line
from pourcast.files import write_text
from pourcast.frozen import Frozen
from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings
from pourcast.study.selection import (
    CoarseFilter,
    FilteredScenes,
    SceneChoice,
    SceneFamily,
    Selection,
    drawn_scene,
)

CHOSEN_FILE = "chosen.json"


class Stage(Frozen):
    """One stage of the choice.

    Parameters
    ----------
    stage
        What it is called.
    scenes
        How many it left.
    how
        What it does.
    """

    stage: str
    scenes: int
    how: str


class HowChosen(Frozen):
    """How scenes were drawn and chosen.

    Parameters
    ----------
    pourcast
        The release that did it.
    family
        Statistics of what was drawn: the fields of the experiment's family.
    rule
        By which numbers was chosen: the fields of the experiment's choice.
    engine
        How pours were computed: the fields of `EngineSettings`.
    pours
        What was poured into each scene: particles, damping and the liquid's numbers.
    stages
        From all draws to the scenes chosen.
    figures
        What the chosen scenes have, by what it is; see `Selection`. None where there is no such
        number: scenes that are all judged alike correlate with nothing.
    """

    pourcast: str
    family: Mapping[str, Any]
    rule: Mapping[str, Any] = {}
    engine: Mapping[str, Any] = {}
    pours: tuple[Mapping[str, Any], ...] = ()
    stages: tuple[Stage, ...]
    figures: Mapping[str, float | None] = {}

    def same_rules(self, family: SceneFamily, choice: SceneChoice) -> bool:
        """Whether these scenes would be drawn and chosen by the same rules."""
        words, today = tuple((one.stage, one.how) for one in self.stages), _numbers(family, choice)
        then = self.model_dump(include=set(today), mode="json")
        return words == choice.stages and then == today


def stages_of(choice: SceneChoice, selection: Selection) -> tuple[Stage, ...]:
    """What each stage of a choice that was just made does, and what it left."""
    return tuple(
        Stage(stage=stage, scenes=left, how=how)
        for (stage, how), left in zip(choice.stages, selection.left, strict=True)
    )


def how_chosen(family: SceneFamily, choice: SceneChoice, selection: Selection) -> HowChosen:
    """What there is to say of a selection that was just made."""
    return HowChosen(
        pourcast=pourcast.__version__,
        **_numbers(family, choice),
        stages=stages_of(choice, selection),
        figures={
            words: value if math.isfinite(value) else None
            for words, value in selection.figures.items()
        },
    )


def write_chosen(folder: Path, chosen: HowChosen) -> None:
    """Keep it beside the scenes."""
    write_text(folder / CHOSEN_FILE, chosen.model_dump_json(indent=2) + "\n")


def read_chosen(folder: Path) -> HowChosen | None:
    """How a study's scenes were chosen; None for one's own, and for those of pourcast 0.1.

    Raises
    ------
    InputError
        One line that names the file, the field and what was expected.
    """
    path = folder / CHOSEN_FILE
    if not path.is_file():
        return None
    try:
        return HowChosen.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ValidationError as error:
        raise InputError(f"{path}: {one_line(error)}") from None


def _numbers(family: SceneFamily, choice: SceneChoice) -> dict[str, Any]:
    """All numbers that decide which scenes are drawn and chosen, as JSON gives them back."""
    scene = next(filter(None, (drawn_scene(family, 0, k) for k in count())))
    numbers = {
        "family": _fields(family),
        "rule": _fields(choice),
        "engine": asdict(choice.rule.settings or EngineSettings()),
        "pours": [_poured(pour) for pour in choice.pours(scene)],
    }
    as_json: dict[str, Any] = json.loads(json.dumps(numbers, default=str))
    return as_json


def filter_numbers(family: SceneFamily, rule: CoarseFilter) -> dict[str, Any]:
    """All numbers that decide which scenes are drawn and pass a filter, for JSON."""
    return _numbers(family, FilteredScenes(rule))


def _fields(one: Any) -> dict[str, Any]:
    return asdict(one)


def _poured(pour: Pour) -> dict[str, Any]:
    liquid = {"liquid": pour.liquid.name, **pour.liquid.engine_identity}
    return {
        "n_particles": pour.n_particles, "damping_zeta": pour.damping_zeta,
        "offset": pour.offset, "kind": pour.kind, **liquid,
    }  # fmt: skip
