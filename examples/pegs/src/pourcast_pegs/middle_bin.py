"""A goal: three bins on the floor, and the share that ends in the middle one."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Self

from pourcast import AnswerPicture, Column, Goal
from pourcast.scenes.geometry import Length, Polygon


class MiddleBin(Goal):
    """Two walls part the floor into three bins; the judgment is the share in the middle one."""

    share: ClassVar[str] = "share of the liquid in the middle bin"
    words: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "en": {
            "instructions": [
                "A liquid is held at the top of a box. In a moment it will be let go, fall, run "
                "past the grey pegs, and gather in the three bins at the bottom.",
                "Your task: judge how much of it will end up in the middle bin.\n\nMove the mouse "
                "over the slider below the picture to set your answer, from nothing of it to "
                "everything. The picture under the slider shows your answer.",
            ],
            "quiz": [
                {
                    "question": "What do you judge?",
                    "choices": ["How fast the liquid falls", "How much ends in the middle bin"],
                    "right": 1,
                },
                {
                    "question": "You think that nothing ends there. Where do you put the slider?",
                    "choices": ["All the way to the left", "All the way to the right"],
                    "right": 0,
                },
                {
                    "question": "How do you hand in an answer?",
                    "choices": ["I wait", "I press ENTER or the button"],
                    "right": 1,
                },
            ],
            "question": "How much of the {liquid} will end up in the middle bin?",
            "slider": "Share of the liquid in the middle bin",
            "low": "nothing",
            "high": "everything",
            "value": "{share} % in the middle",
        }
    }
    answer_picture: ClassVar[AnswerPicture] = AnswerPicture(
        columns=(
            Column(0.0, 0.3, judged=False, full=0.5),
            Column(0.3, 0.4, judged=True),
            Column(0.7, 0.3, judged=False, full=0.5),
        ),
        parts=(((0.29, 0.0), (0.31, 0.0), (0.3, 0.8)), ((0.69, 0.0), (0.71, 0.0), (0.7, 0.8))),
    )

    kind: Literal["middle-bin"] = "middle-bin"
    left: Length = 0.3
    """Where the left wall stands [m]."""
    right: Length = 0.7
    """Where the right wall stands [m]."""
    height: Length = 0.25

    @property
    def solids(self) -> tuple[Polygon, ...]:
        """The two walls, as wedges."""
        return tuple(
            ((x - 0.02, 0.0), (x + 0.02, 0.0), (x, self.height)) for x in (self.left, self.right)
        )

    @property
    def rim(self) -> float:
        """Height of the walls [m]."""
        return self.height

    def holds(self, x: float, y: float) -> bool:
        """Whether a point is between the walls."""
        return self.left < x < self.right

    def mirrored(self, width: float) -> Self:
        """The walls exchanged."""
        return self.model_copy(update={"left": width - self.right, "right": width - self.left})

    def mirrored_judgment(self, judgment: Any) -> Any:
        """The middle stays the middle."""
        return judgment
