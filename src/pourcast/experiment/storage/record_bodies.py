"""What a record of each kind of step may say. Times are in seconds, since the step was shown."""

import json
import re
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

MAX_BODY = 65536
"""Bytes of the largest request."""

_UNSTORABLE = re.compile("[\ud800-\udfff\x00]")
"""Halves of characters, and NUL: no database takes them, nor does a text file."""

_Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
_Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=0, le=10**7)]
_Pixels = Annotated[float, Field(ge=0.0, le=1e5, allow_inf_nan=False)]
_Word = Annotated[str, Field(max_length=200)]


class _Body(BaseModel):
    """What a record of any step says; `data.TRIAL_COLUMNS` tells what the fields mean."""

    model_config = ConfigDict(extra="forbid")

    rt: _Seconds
    window_width: _Pixels = 0.0
    window_height: _Pixels = 0.0
    focus_losses: _Count = 0
    dropped_frames: _Count = 0


class Judgment(_Body):
    """An answer by the slider. `stimulus` is the name of the picture."""

    stimulus: _Word
    response: _Share
    start: _Share | None
    first_move: _Seconds | None
    moves: _Count
    input: Literal["mouse", "touch", "keyboard", "none"]
    trajectory: list[tuple[_Seconds, _Share]] | None = Field(default=None, max_length=2000)
    picture_width: _Pixels | None = None
    picture_height: _Pixels | None = None
    pixel_ratio: _Pixels | None = None


class Film(_Body):
    """A film of what happens, after practice."""

    stimulus: _Word
    played: bool
    stalls: _Count = 0


class Check(_Body):
    """The browser and the screen."""

    browser: _Word = ""
    browser_version: _Word = ""
    system: _Word = ""
    mobile: bool = False
    refresh_rate: Annotated[float, Field(ge=0.0, le=1e4)] | None = None
    language: _Word = ""
    tries: _Count = 1


class Instructions(_Body):
    """Answers to the questions about the instructions, an attempt a list."""

    attempts: list[list[Annotated[int, Field(ge=-1, le=20)]]] = Field(max_length=50)


class Debrief(_Body):
    """What a participant has to say."""

    remarks: str = Field(default="", max_length=5000)


class Plain(_Body):
    """A step in which nothing is asked."""


BODIES: dict[str, type[_Body]] = {
    "consent": Plain,
    "check": Check,
    "instructions": Instructions,
    "judgment": Judgment,
    "film": Film,
    "break": Plain,
    "debrief": Debrief,
}
"""What a record says, by the kind of its step."""


_LATER = {"picture_width", "picture_height", "pixel_ratio"}
"""What records of earlier releases lack. Without a value it is left out, so that such a record is
the same however often it comes in."""


def storable(value: Any) -> Any:
    """Something of JSON's types, with U+FFFD for what no database and no text file takes."""
    if isinstance(value, str):
        return _UNSTORABLE.sub("\N{REPLACEMENT CHARACTER}", value)
    if isinstance(value, list):
        return [storable(item) for item in value]
    if isinstance(value, dict):
        return {storable(name): storable(item) for name, item in value.items()}
    return value


def canonical(kind: str, content: Any) -> str:
    """A record's body, checked, as the JSON that is stored: the same for the same content.

    Raises
    ------
    pydantic.ValidationError
        If it is not what such a step's record says.
    """
    body = BODIES[kind].model_validate(storable(content)).model_dump(mode="json")
    body = {name: value for name, value in body.items() if value is not None or name not in _LATER}
    return json.dumps(body, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
