"""Experiment 2 as pourcast 0.1 had it: its scenes and liquids, to repeat older studies."""

from dataclasses import replace

from pourcast.scenes.families.shapes import ShapesFamily
from pourcast.study.experiments._v0 import FILTER, presets_with, words_of
from pourcast.study.experiments.base import Experiment
from pourcast.study.selection import ContrastingScenes

HONEY = "honey-exp2-v0"

EXPERIMENT = Experiment(
    name="exp2-v0",
    title="Experiment 2 of pourcast 0.1, to repeat older studies",
    family=ShapesFamily(
        shape_count=3,
        min_radius=0.08,
        max_radius=0.16,
        band_bottom=0.45,
        band_top=1.12,
        gap=0.05,
        liquid_y=1.38,
        liquid_spread=0.25,
    ),
    choice=ContrastingScenes(
        rule=replace(FILTER, min_touched=0.5),
        candidates=1000,
        models=("water-ife:liquid=water-v0", f"honey-ife-1:liquid={HONEY}"),
        screens=("water-v0", HONEY),
        confirm_factor=2.5,
    ),
    goal="cup",
    scene_count=60,
    practice_count=15,
    practice_filter=FILTER,
    participants=21,
    groups=(("water-v0", HONEY),),
    mirrored=(HONEY,),
    grid="paper-exp2",
    heading="Experiment 2 (cup) of pourcast 0.1",
    observers={"water-v0": "water-ife:liquid=water-v0", HONEY: "honey-ife-2:liquid=water-v0"},
    truths={"water-v0": "truth-water:liquid=water-v0", HONEY: f"truth-honey:liquid={HONEY}"},
    models=presets_with(HONEY),
    words=words_of(HONEY),
)
