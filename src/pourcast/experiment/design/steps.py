"""What a participant does in a session, step by step."""

from collections.abc import Callable, Sequence
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

Kind = Literal["consent", "check", "instructions", "judgment", "film", "break", "debrief"]
"""What is to be done in a step."""


class Step(BaseModel):
    """One thing that a participant does, and is kept one record of.

    Parameters
    ----------
    seq
        Number of the step in its session; with the session's the key of the record.
    kind
        What is to be done.
    phase, trial
        Of judgments and films: `practice` or `test`, and the number in it from 1.
    block
        Of test trials and breaks, from 1.
    liquid, scene, mirrored
        What is judged. Participants' browsers are not told the scene's id.
    still, film
        Names under which the server publishes them.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    seq: int
    kind: Kind
    phase: str = ""
    trial: int = 0
    block: int = 0
    liquid: str = ""
    scene: str = ""
    mirrored: bool = False
    still: str = ""
    film: str = ""

    def for_participant(self) -> dict[str, Any]:
        """The step as the browser gets it."""
        return self.model_dump(exclude={"scene", "mirrored"}, exclude_defaults=True) | {
            "seq": self.seq
        }


Schedule = Callable[[int, int], Sequence[Step]]
"""From a participant's group and place, each from 0, to the steps of the session."""
