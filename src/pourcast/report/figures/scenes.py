"""Figures that look rather than count: stimuli, the particle engine, the heuristics."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from pourcast.engine.smoothing import NORMALISATION, weight
from pourcast.pictures.drawing import draw_scene, draw_start
from pourcast.pictures.panels import draw_pour, draw_predicted_paths
from pourcast.pictures.predictions import (
    PredictedPaths,
    PredictedPour,
    make_predictions,
    predict_pours,
)
from pourcast.pictures.style import BLUE, PAGE, RC, new_figure
from pourcast.pictures.video import FRAME_RATE
from pourcast.scenes.liquids.base import Liquid
from pourcast.scenes.liquids.registry import WATER, resolve_liquid
from pourcast.scenes.scene import Scene
from pourcast.simulation.pour import Pour
from pourcast.simulation.settings import EngineSettings

PARTICLE_COUNTS = (15, 50, 100, 200)

_MOMENT = 1.0
"""Moment of the pictures of the particle engine [s]."""


def stimuli(scenes: Sequence[Scene], most: int = 5) -> Figure:
    """Scenes as participants see them first, spread evenly over the set."""
    places = np.unique(np.linspace(0, len(scenes) - 1, min(most, len(scenes))).round().astype(int))
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, PAGE / len(places) * 1.5 + 0.25)
        panels = figure.subplots(1, len(places), squeeze=False)[0]
        for axes, place in zip(panels, places, strict=True):
            draw_scene(axes, scenes[place])
            draw_start(axes, scenes[place], WATER.rgb)
            axes.set_title(scenes[place].id, fontsize=7)
    return figure


def particle_engine(
    scene: Scene, liquids: Sequence[str] = ("water", "honey"), own: Sequence[Liquid] = ()
) -> Figure:
    """The smoothing kernel; one moment with few particles and with many; and other liquids.

    Parameters
    ----------
    scene
        The scene.
    liquids
        What is poured: the first with few particles and many, the others with 50.
    own
        The study's own liquids.
    """
    shown = [*((liquids[0], n) for n in PARTICLE_COUNTS), *((name, 50) for name in liquids[1:])]
    pours = {
        f"{liquid}, N = {count}": Pour(scene, resolve_liquid(liquid, scene, own), count)
        for liquid, count in shown
    }
    poured = predict_pours(pours, settings=EngineSettings(max_duration=_MOMENT)).values()
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 2.1)
        panels = figure.subplots(1, len(poured) + 1, width_ratios=[1.25] + [1.0] * len(poured))
        distance = np.linspace(0.0, 1.0, 101)
        values = [NORMALISATION * weight(max(0.0, 1.0 - q)) for q in distance]
        panels[0].plot(distance, values, color=BLUE)
        panels[0].set(xlabel="r / support radius", ylabel="kernel W", title="Wendland C2")
        for axes, pour in zip(panels[1:], poured, strict=True):
            draw_scene(axes, scene)
            _draw_particles(axes, scene, pour)
            axes.set_title(pour.name, fontsize=7)
            axes.set_xlabel(f"{_MOMENT:g} s", fontsize=7)
    return figure


def _draw_particles(axes: Any, scene: Scene, pour: PredictedPour) -> None:
    frame = min(round(_MOMENT * FRAME_RATE), len(pour.frames) - 1)
    draw_pour(axes, scene, pour, frame)
    position = pour.frames[frame]
    axes.plot(position[:, 0], position[:, 1], ".", markersize=1.5, color="black", zorder=5)


def heuristics(scene: Scene) -> Figure:
    """The gravity heuristic, SimpleSim with and without wrong turns, blobs, and marbles."""
    panels_of = {
        "gravity heuristic": "gravity",
        "SimpleSim, m = 0.1": "simple:g=0,m=0.1,m_sigma=0",
        "SimpleSim, m = 0.1, g = 0.5": "simple:g=0.5,m=0.1,m_sigma=0",
        "Blobs, N = 100": "blobs",
        "MarbleSim, N = 25": "marble:n_particles=25,damping_zeta=2,zeta_sigma=0",
    }
    predictions = make_predictions(scene, list(panels_of.values()), WATER)
    with mpl.rc_context(RC):
        figure = new_figure(PAGE, 2.9)
        panels = figure.subplots(1, len(panels_of))
        for axes, label, one in zip(panels, panels_of, predictions, strict=True):
            draw_scene(axes, scene)
            if isinstance(one, PredictedPaths):
                draw_predicted_paths(axes, scene, one)
            elif one.look == "cells":
                draw_pour(axes, scene, one, len(one.frames) // 2)
            else:
                _draw_particles(axes, scene, one)
            axes.set_title(label, fontsize=7)
            axes.set_xlabel(f"J = {one.judgment:.2f}", fontsize=7)
    return figure
