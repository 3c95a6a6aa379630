"""What a goal is: what is asked of a scene, and all that depends on it."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self

from pydantic import Field, model_validator

from pourcast.frozen import Frozen
from pourcast.scenes.geometry import Polygon


class Column(NamedTuple):
    """A column of liquid in the small picture of an answer, in shares of the picture's size."""

    x: float
    """Its left edge."""
    width: float
    judged: bool
    """Whether it grows with the share that is judged, or with what is left of the liquid."""
    full: float = 1.0
    """Its height when that share is 1."""


class Question(Frozen):
    """A question about the instructions; `right` is the number of the right choice, from 0."""

    question: str
    choices: list[str] = Field(min_length=2)
    right: int = Field(ge=0)

    @model_validator(mode="after")
    def _has_its_answer(self) -> Self:
        if self.right >= len(self.choices):
            raise ValueError(f"right: expected 0 to {len(self.choices) - 1}, found {self.right}")
        return self


class GoalWords(Frozen):
    """What participants read of a goal, in one language."""

    instructions: list[str] = Field(min_length=1)
    quiz: list[Question]
    question: str
    slider: str
    low: str
    high: str
    value: str


@dataclass(frozen=True)
class AnswerPicture:
    """The small picture under the slider that shows what an answer says.

    Parameters
    ----------
    columns
        Where the liquid stands.
    parts
        The goal's parts: polygons in shares of the picture's size, y upwards.
    """

    columns: tuple[Column, ...] = (Column(0.0, 1.0, judged=True),)
    parts: tuple[Polygon, ...] = ()


class Goal(Frozen, ABC):
    """What is asked of a scene: which share of the liquid ends where.

    A goal is one file: a subclass whose field `kind` is a `Literal` of its name. Fields
    are in metres. Nothing else in the house asks which kind of goal a scene has.

    Examples
    --------
    >>> from pourcast import Basins
    >>> Basins().holds(0.7, 0.02), Basins().mirrored_judgment(0.25)
    (True, 0.75)
    """

    kind: str

    share: ClassVar[str]
    """What a judgment is, in a table's heading: "share of the liquid in the cup"."""
    words: ClassVar[Mapping[str, Mapping[str, Any]]]
    """Language -> what participants read of it: `instructions` (pages), `quiz` (questions),
    `question`, `slider` (its name), `low` and `high` (its ends), `value` (what an answer says);
    see `basins.py`. {liquid}, {share} and {rest} are filled in. English is needed."""

    answer_picture: ClassVar[AnswerPicture] = AnswerPicture()

    @property
    @abstractmethod
    def solids(self) -> tuple[Polygon, ...]:
        """The goal's own parts, as convex polygons [m]; the box is none of them."""

    @property
    @abstractmethod
    def rim(self) -> float:
        """Height [m] that liquid must climb to change a judgment, once it is below."""

    @abstractmethod
    def holds(self, x: float, y: float) -> bool:
        """Whether liquid at a point [m] counts towards the judgment."""

    @abstractmethod
    def mirrored(self, width: float) -> Self:
        """The same goal seen in a mirror, in a box of a width [m]."""

    @abstractmethod
    def mirrored_judgment(self, judgment: Any) -> Any:
        """Judgment of a scene from that of its mirror image, or the other way round.

        Parameters
        ----------
        judgment
            A share 0..1, or an array of them.
        """
