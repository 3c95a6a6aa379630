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
    from pourcast.demo import demo_scenes
    from pourcast.errors import InputError
    from pourcast.generate.importers import import_scene
    from pourcast.judgments import predict, summarise
    from pourcast.liquid import HONEY_EXP1, HONEY_EXP2, WATER, Liquid
    from pourcast.model import Model, SimulationModel, make_model, model_names, parameter
    from pourcast.pictures import show
    from pourcast.scene import (
        Basins,
        Box,
        Cup,
        LiquidStart,
        Scene,
        read_scenes,
        write_scenes,
    )
    from pourcast.simulation import EngineSettings, Outcome, Pour, simulate

__version__ = "0.1.0"

_HOMES = {
    "demo": ("demo_scenes",),
    "errors": ("InputError",),
    "generate.importers": ("import_scene",),
    "liquid": ("HONEY_EXP1", "HONEY_EXP2", "WATER", "Liquid"),
    "model": ("Model", "SimulationModel", "make_model", "model_names", "parameter"),
    "judgments": ("predict", "summarise"),
    "scene": ("Basins", "Box", "Cup", "LiquidStart", "Scene", "read_scenes", "write_scenes"),
    "pictures": ("show",),
    "simulation": ("EngineSettings", "Outcome", "Pour", "simulate"),
}
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "HONEY_EXP1", "HONEY_EXP2", "WATER", "Basins", "Box", "Cup", "EngineSettings", "InputError",
    "Liquid", "LiquidStart", "Model", "Outcome", "Pour", "Scene", "SimulationModel", "demo_scenes",
    "import_scene", "make_model", "model_names", "parameter", "predict", "read_scenes", "show",
    "simulate", "summarise", "write_scenes",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    # Numba, pandas and matplotlib are loaded when something needs them, not at import.
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'pourcast' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pourcast.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
