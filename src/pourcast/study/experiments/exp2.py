"""Experiment 2: a cup below three shapes; all see water and mirrored honey (Bates et al.)."""

from pourcast.scenes.families.shapes import ShapesFamily
from pourcast.study.contrast import SteadyContrast
from pourcast.study.experiments.base import Experiment

EXPERIMENT = Experiment(
    name="exp2",
    title="a cup below three shapes; scenes on which water and honey disagree, honey mirrored",
    family=ShapesFamily(min_radius=0.12, max_radius=0.22, band_bottom=0.6, band_top=1.15),
    choice=SteadyContrast(),
    goal="cup",
    scene_count=60,
    practice_count=15,
    participants=21,
    groups=(("water", "honey"),),
    mirrored=("honey",),
    grid="paper-exp2",
    heading="Experiment 2 (cup)",
    observers={"water": "water-ife", "honey": "honey-ife-2"},
    truths={"water": "truth-water", "honey": "truth-honey"},
)
