"""A cup on the floor (Experiment 2)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from pourcast.scenes.geometry import Length, Polygon
from pourcast.scenes.goals.base import AnswerPicture, Column, Goal

_ENGLISH = {
    "instructions": [
        (
            "Each picture shows a container seen from the front. A liquid is held"
            " at the top. In a moment it will be let go, fall, run over the grey "
            "obstacles, and gather at the bottom.\n\nA red cup stands on the floor."
            " Some of the liquid may run into it; the rest ends up on the floor "
            "beside it."
        ),
        (
            "Your task: judge what percentage of the liquid will end up in the "
            "cup.\n\nMove the mouse over the slider below the picture to set your "
            "answer, from 0 % (none of it) to 100 % (all of it). The picture "
            "under the slider shows your answer."
        ),
    ],
    "quiz": [
        {
            "question": "What do you judge?",
            "choices": [
                "How fast the liquid falls",
                "What percentage of the liquid ends up in the cup",
                "How many obstacles there are",
            ],
            "right": 1,
        },
        {
            "question": (
                "You think that none of the liquid ends up in the cup. Where do you put the slider?"
            ),
            "choices": [
                "All the way to the left (0 %)",
                "In the middle (50 %)",
                "All the way to the right (100 %)",
            ],
            "right": 0,
        },
        {
            "question": "How do you hand in an answer?",
            "choices": ["I wait", "I press ENTER or the button", "I close the window"],
            "right": 1,
        },
    ],
    "question": "What percentage of the {liquid} will end up in the cup?",
    "slider": "Percentage of the liquid in the cup",
    "low": "0 % in the cup",
    "high": "100 % in the cup",
    "value": "{share} % in the cup",
}


class Cup(Goal):
    """Experiment 2's goal: a cup on the floor; the judgment is the share inside it."""

    share: ClassVar[str] = "share of the liquid in the cup"
    words: ClassVar[Mapping[str, Mapping[str, Any]]] = {"en": _ENGLISH}
    answer_picture: ClassVar[AnswerPicture] = AnswerPicture(
        # What misses the cup lies on twice its width.
        columns=(
            Column(1 / 3, 1 / 3, judged=True),
            Column(0.0, 1 / 3, judged=False, full=0.5),
            Column(2 / 3, 1 / 3, judged=False, full=0.5),
        ),
        parts=tuple(
            ((x, 0.0), (x + 0.025, 0.0), (x + 0.025, 1.0), (x, 1.0)) for x in (0.3083, 0.6667)
        ),
    )

    kind: Literal["cup"] = "cup"
    centre_x: float = 0.5
    width: Length = 1 / 3
    """Outer width [m]; the paper: a third of the scene."""
    height: Length = 0.18
    wall: Length = 0.015
    """Thickness of the two walls [m]."""

    @model_validator(mode="after")
    def _walls_leave_room(self) -> Self:
        if 2 * self.wall >= self.width:
            raise ValueError("the cup's walls leave no room inside (2 * wall >= width)")
        return self

    @property
    def solids(self) -> tuple[Polygon, ...]:
        """The two walls as polygons; the floor is the bottom."""
        left, right = self.centre_x - self.width / 2, self.centre_x + self.width / 2
        return tuple(
            ((x, 0.0), (x + self.wall, 0.0), (x + self.wall, self.height), (x, self.height))
            for x in (left, right - self.wall)
        )

    @property
    def rim(self) -> float:
        """Height [m] that liquid must climb to enter or to leave."""
        return self.height

    def holds(self, x: float, y: float) -> bool:
        """Whether a point counts towards the judgment."""
        return abs(x - self.centre_x) < self.width / 2 and y < self.height

    def mirrored(self, width: float) -> Self:
        """The same goal seen in a mirror."""
        return self.model_copy(update={"centre_x": width - self.centre_x})

    def mirrored_judgment(self, judgment: Any) -> Any:
        """The same share: a cup has no sides."""
        return judgment


GOAL = Cup
