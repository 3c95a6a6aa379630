"""Models of how people think that a liquid will flow.

Scenes go in at one end, judgments come out at the other:

>>> import pourcast
>>> scenes = pourcast.demo_scenes()
>>> table = pourcast.predict(scenes, ["gravity"])
>>> bool(table["judgment"].between(0, 1).all())
True
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pourcast.errors import InputError
    from pourcast.models.base import Model, SimulationModel, parameter
    from pourcast.models.registry import make_model, model_names
    from pourcast.pictures.demo import demo_scenes
    from pourcast.pictures.show import show
    from pourcast.prediction import predict, summarise
    from pourcast.scenes.goals.base import AnswerPicture, Column, Goal
    from pourcast.scenes.goals.basins import Basins
    from pourcast.scenes.goals.cup import Cup
    from pourcast.scenes.importers import import_scene
    from pourcast.scenes.liquids.base import Liquid
    from pourcast.scenes.liquids.registry import HONEY_EXP1, HONEY_EXP2, WATER
    from pourcast.scenes.scene import Box, LiquidStart, Scene
    from pourcast.scenes.scene_file import read_scenes, write_scenes
    from pourcast.simulation.pour import Outcome, Pour
    from pourcast.simulation.run import simulate
    from pourcast.simulation.settings import EngineSettings
    from pourcast.study.experiments.base import Experiment

__version__ = "0.2.0.dev0"

_HOMES = {
    "errors": ("InputError",),
    "models.base": ("Model", "SimulationModel", "parameter"),
    "models.registry": ("make_model", "model_names"),
    "pictures.demo": ("demo_scenes",),
    "pictures.show": ("show",),
    "prediction": ("predict", "summarise"),
    "scenes.goals.base": ("AnswerPicture", "Column", "Goal"),
    "scenes.goals.basins": ("Basins",),
    "scenes.goals.cup": ("Cup",),
    "scenes.importers": ("import_scene",),
    "scenes.liquids.base": ("Liquid",),
    "scenes.liquids.registry": ("HONEY_EXP1", "HONEY_EXP2", "WATER"),
    "scenes.scene": ("Box", "LiquidStart", "Scene"),
    "scenes.scene_file": ("read_scenes", "write_scenes"),
    "simulation.pour": ("Outcome", "Pour"),
    "simulation.run": ("simulate",),
    "simulation.settings": ("EngineSettings",),
    "study.experiments.base": ("Experiment",),
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "HONEY_EXP1", "HONEY_EXP2", "WATER", "AnswerPicture", "Basins", "Box", "Column", "Cup",
    "EngineSettings", "Experiment", "Goal", "InputError", "Liquid", "LiquidStart", "Model",
    "Outcome", "Pour", "Scene", "SimulationModel", "demo_scenes", "import_scene", "make_model",
    "model_names", "parameter", "predict", "read_scenes", "show", "simulate", "summarise",
    "write_scenes",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    # Numba, pandas and matplotlib are loaded when something needs them, not at import.
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pourcast' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pourcast.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
