"""Two basins, parted by a wedge on the floor (Experiment 1)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

from pourcast.scenes.geometry import Length, Polygon
from pourcast.scenes.goals.base import AnswerPicture, Column, Goal

_ENGLISH = {
    "instructions": [
        (
            "Each picture shows a container seen from the front. A liquid is held"
            " at the top. In a moment it will be let go, fall, run over the grey "
            "obstacles, and gather at the bottom.\n\nThe red wedge at the bottom "
            "parts the floor into two basins, one on the left and one on the "
            "right."
        ),
        (
            "Your task: judge how much of the liquid will end up in the right "
            "basin, and how much in the left.\n\nMove the mouse over the slider "
            "below the picture to set your answer. All the way to the right means"
            " that all of the liquid ends up in the right basin; all the way to "
            "the left, all of it in the left one. The picture under the slider "
            "shows your answer."
        ),
    ],
    "quiz": [
        {
            "question": "What do you judge?",
            "choices": [
                "How fast the liquid falls",
                "How much of the liquid ends up in the left and in the right basin",
                "How many obstacles there are",
            ],
            "right": 1,
        },
        {
            "question": (
                "You think that all of the liquid ends up on the left. Where do you put the slider?"
            ),
            "choices": ["All the way to the left", "In the middle", "All the way to the right"],
            "right": 0,
        },
        {
            "question": "How do you hand in an answer?",
            "choices": ["I wait", "I press ENTER or the button", "I close the window"],
            "right": 1,
        },
    ],
    "question": "How much of the {liquid} will end up in each basin?",
    "slider": "Share of the liquid in the right basin",
    "low": "left basin",
    "high": "right basin",
    "value": "left {rest} %, right {share} %",
}


class Basins(Goal):
    """Experiment 1's goal: a wedge divides the floor; the judgment is the share right of it."""

    share: ClassVar[str] = "share of the liquid in the right basin"
    words: ClassVar[Mapping[str, Mapping[str, Any]]] = {"en": _ENGLISH}
    answer_picture: ClassVar[AnswerPicture] = AnswerPicture(
        columns=(Column(0.0, 0.5, judged=False), Column(0.5, 0.5, judged=True)),
        parts=(((0.4625, 0.0), (0.5, 0.857), (0.5375, 0.0)),),
    )

    kind: Literal["basins"] = "basins"
    divider_x: float = 0.5
    """Where the wedge's tip stands [m]."""
    divider_width: Length = 0.1
    """Width of the wedge's foot [m]."""
    divider_height: Length = 0.2

    @property
    def solids(self) -> tuple[Polygon, ...]:
        """The wedge as a polygon."""
        half = self.divider_width / 2
        return (
            (
                (self.divider_x - half, 0.0),
                (self.divider_x + half, 0.0),
                (self.divider_x, self.divider_height),
            ),
        )

    @property
    def rim(self) -> float:
        """Height [m] that liquid must climb to change sides."""
        return self.divider_height

    def holds(self, x: float, y: float) -> bool:
        """Whether a point counts towards the judgment."""
        return x > self.divider_x

    def mirrored(self, width: float) -> Self:
        """The same goal seen in a mirror (the judged basin stays the right one)."""
        return self.model_copy(update={"divider_x": width - self.divider_x})

    def mirrored_judgment(self, judgment: Any) -> Any:
        """What is right in the mirror is left without."""
        return 1.0 - judgment


GOAL = Basins
