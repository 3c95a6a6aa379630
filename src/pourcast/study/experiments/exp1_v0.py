"""Experiment 1 as pourcast 0.1 had it: its scenes and liquids, to repeat older studies."""

from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.study.experiments._v0 import FILTER, presets_with, words_of
from pourcast.study.experiments.base import Experiment
from pourcast.study.selection import FilteredScenes

HONEY = "honey-exp1-v0"

EXPERIMENT = Experiment(
    name="exp1-v0",
    title="Experiment 1 of pourcast 0.1, to repeat older studies",
    family=VoronoiFamily(
        cell_count=60,
        band_bottom=0.3,
        band_top=1.25,
        solid_area=0.12,
        wall_gap=0.0,
        liquid_y=1.4,
        liquid_spread=0.3,
    ),
    choice=FilteredScenes(FILTER),
    goal="basins",
    scene_count=120,
    practice_count=15,
    practice_filter=FILTER,
    participants=65,
    groups=(("water-v0",), (HONEY,)),
    grid="paper-exp1",
    heading="Experiment 1 (basins) of pourcast 0.1",
    observers={"water-v0": "water-ife:liquid=water-v0", HONEY: "honey-ife-2:liquid=water-v0"},
    truths={"water-v0": "truth-water:liquid=water-v0", HONEY: f"truth-honey:liquid={HONEY}"},
    models=presets_with(HONEY),
    words=words_of(HONEY),
)
