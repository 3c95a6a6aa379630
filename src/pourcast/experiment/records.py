"""What a record of each kind of step may say: checked when it comes, described when it goes out.

Times are in seconds, since the step was shown.
"""

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

MAX_BODY = 65536
"""Bytes of the largest request."""

_Seconds = Annotated[float, Field(ge=0.0, le=1e7, allow_inf_nan=False)]
_Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
_Count = Annotated[int, Field(ge=0, le=10**7)]
_Pixels = Annotated[float, Field(ge=0.0, le=1e5, allow_inf_nan=False)]
_Word = Annotated[str, Field(max_length=200)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=False)

    rt: _Seconds = Field(description="Time until the step was done [s]")
    window_width: _Pixels = Field(default=0.0, description="Width of the window [points]")
    window_height: _Pixels = Field(default=0.0, description="Height of the window [points]")
    focus_losses: _Count = Field(
        default=0, description="How often the page lost the focus or was hidden"
    )
    dropped_frames: _Count = Field(
        default=0, description="Pictures that the screen did not show in time"
    )


class Judgment(_Body):
    """An answer by the slider."""

    stimulus: _Word = Field(description="Name of the picture that was shown")
    response: _Share = Field(
        description="Share in the right basin or in the cup of the scene as it was shown"
    )
    start: _Share | None = Field(description="Where the handle stood at first; none without one")
    first_move: _Seconds | None = Field(description="Time of the first movement [s]")
    moves: _Count = Field(description="Number of the handle's movements")
    input: Literal["mouse", "touch", "keyboard", "none"] = Field(
        description="What moved the handle last"
    )
    trajectory: list[tuple[_Seconds, _Share]] | None = Field(
        default=None, max_length=2000, description="Times [s] and places of the handle"
    )


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


def canonical(kind: str, content: Any) -> str:
    """A record's body, checked, as the JSON that is stored: the same for the same content.

    Raises
    ------
    pydantic.ValidationError
        If it is not what such a step's record says.
    """
    body = BODIES[kind].model_validate(content).model_dump(mode="json")
    return json.dumps(body, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
