"""What a renderer is: it draws the pictures of a pour."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

from pourcast.frozen import Frozen
from pourcast.pictures.video import Picture
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.scene import Scene
from pourcast.stimuli.recording import RecordedPour


class Renderer(Frozen, ABC):
    """Draws pours; its fields are its settings."""

    name: ClassVar[str]
    """Name of its file, and on the command line."""
    fidelity: ClassVar[int] = 0
    """An experiment shows the set of stimuli of the renderer with the highest one."""
    slow: ClassVar[bool] = False
    """Whether a picture takes seconds, on all cores: films are then made one at a time, and each
    picture is kept as `picture_file` says, so that interrupted work goes on with the next."""

    @abstractmethod
    def picture_maker(
        self, scene: Scene, liquid: Liquid, pour: RecordedPour, folder: Path, *, threads: int = 0
    ) -> Picture:
        """What gives the pictures of a pour.

        Parameters
        ----------
        scene
            The scene.
        liquid
            What flows.
        pour
            The pour.
        folder
            For files of its own until all pictures are taken.
        threads
            Threads that it may use; all cores by default.

        Returns
        -------
        callable
            From a picture's number to red, green, blue, shape [height, width, 3].
        """

    @abstractmethod
    def liquid_identity(self, liquid: Liquid) -> dict[str, Any]:
        """All of a liquid that its pictures depend on, by the liquid's own names."""

    def check_available(self) -> None:
        """Look for the programs that it needs.

        Raises
        ------
        InputError
            If one is missing.
        """


def picture_file(folder: Path, number: int) -> Path:
    """File of a picture that took long."""
    return folder / f"{number:04d}.png"
