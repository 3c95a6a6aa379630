"""What a solver is: it pours a liquid, and records the pour for the pictures."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from pourcast.frozen import Frozen
from pourcast.progress import Report, no_report
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.recording import RecordedPour


class Solver(Frozen, ABC):
    """Pours a liquid; its fields are its settings."""

    name: ClassVar[str]
    """Name of its file, and on the command line."""
    fidelity: ClassVar[int] = 0
    """Of two sets of stimuli by one renderer, an experiment shows that of the higher one."""
    independent: ClassVar[bool] = False
    """Whether it shares nothing with the models, so that its outcomes are a truth of their own."""

    @abstractmethod
    def pour(
        self,
        scene: Scene,
        liquid: Liquid,
        seconds: float,
        *,
        threads: int = 1,
        report: Report = no_report,
    ) -> RecordedPour:
        """Pour a liquid into a scene.

        Parameters
        ----------
        scene
            The scene.
        liquid
            What flows.
        seconds
            Length of the film [s].
        threads
            Threads; the result doesn't depend on them.
        report
            Told of the pictures that are done.
        """

    @abstractmethod
    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """All of a liquid that its pours depend on, by the liquid's own names."""
