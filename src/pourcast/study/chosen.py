"""`chosen.json`: how a study's scenes were drawn and chosen, kept beside them.

What an experiment draws may change from one release to the next; this says what was done, and tells
older scenes from those that would be drawn today.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import ValidationError

import pourcast
from pourcast.errors import InputError, one_line
from pourcast.files import write_text
from pourcast.frozen import Frozen
from pourcast.study.selection import SceneChoice, SceneFamily, Selection

CHOSEN_FILE = "chosen.json"


class Stage(Frozen):
    """One stage of the choice.

    Parameters
    ----------
    stage, how
        What it is called, and what it does.
    scenes
        How many it left.
    """

    stage: str
    how: str
    scenes: int


class HowChosen(Frozen):
    """How scenes were drawn and chosen.

    Parameters
    ----------
    pourcast
        The release that did it.
    family
        Statistics of what was drawn: the fields of the experiment's family.
    stages
        From all draws to the scenes chosen.
    figures
        What the chosen scenes have, by what it is; see `Selection`.
    """

    pourcast: str
    family: Mapping[str, Any]
    stages: tuple[Stage, ...]
    figures: Mapping[str, float] = {}

    def same_rules(self, family: SceneFamily, choice: SceneChoice) -> bool:
        """Whether these scenes would be drawn and chosen by the same rules."""
        words = tuple((one.stage, one.how) for one in self.stages)
        return words == choice.stages and dict(self.family) == _statistics(family)


def how_chosen(family: SceneFamily, choice: SceneChoice, selection: Selection) -> HowChosen:
    """What there is to say of a selection that was just made."""
    stages = tuple(
        Stage(stage=stage, how=how, scenes=left)
        for (stage, how), left in zip(choice.stages, selection.left, strict=True)
    )
    return HowChosen(
        pourcast=pourcast.__version__,
        family=_statistics(family),
        stages=stages,
        figures=dict(selection.figures),
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


def _statistics(family: SceneFamily) -> dict[str, Any]:
    """Fields of a family, as JSON gives them back."""
    fields: Any = family
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in asdict(fields).items()
    }
