"""Experiment 1: two basins under cells of a Voronoi tessellation; water or honey (Bates et al.)."""

from pourcast.scenes.families.voronoi import VoronoiFamily
from pourcast.study.experiments.base import Experiment, Published, PublishedResults
from pourcast.study.selection import FilteredScenes

PUBLISHED = PublishedResults(
    source="Bates et al. 2019, PLOS Computational Biology",
    with_people={
        "water": {
            "water-ife": Published(0.92, 0.91, 0.93),
            "honey-ife-1": Published(0.76, 0.74, 0.78),
            "honey-ife-2": Published(0.81, 0.79, 0.82),
            "truth-water": Published(0.76, 0.74, 0.78),
            "truth-honey": Published(0.83, 0.81, 0.84),
            "water-convnet": Published(0.76, 0.74, 0.78),
            "honey-convnet": Published(0.85, 0.83, 0.86),
            "water-marble": Published(0.88, 0.86, 0.89),
            "honey-marble": Published(0.83, 0.81, 0.84),
            "water-simple": Published(0.75, 0.73, 0.77),
            "honey-simple": Published(0.68, 0.66, 0.70),
            "gravity": Published(0.58, 0.55, 0.60),
        },
        "honey": {
            "water-ife": Published(0.74, 0.71, 0.78),
            "honey-ife-1": Published(0.79, 0.76, 0.83),
            "honey-ife-2": Published(0.86, 0.83, 0.88),
            "truth-water": Published(0.48, 0.43, 0.53),
            "truth-honey": Published(0.73, 0.69, 0.76),
            "water-convnet": Published(0.52, 0.46, 0.56),
            "honey-convnet": Published(0.70, 0.65, 0.74),
            "water-marble": Published(0.76, 0.72, 0.79),
            "honey-marble": Published(0.84, 0.81, 0.87),
            "water-simple": Published(0.66, 0.62, 0.71),
            "honey-simple": Published(0.76, 0.73, 0.80),
            "gravity": Published(0.73, 0.70, 0.77),
        },
    },
    with_truth={
        "truth-water": {
            "water-convnet": 0.91,
            "honey-convnet": 0.76,
            "water-simple": 0.56,
            "honey-simple": 0.38,
            "water-marble": 0.79,
            "honey-marble": 0.60,
            "gravity": 0.19,
        },
        "truth-honey": {
            "water-convnet": 0.69,
            "honey-convnet": 0.82,
            "water-simple": 0.60,
            "honey-simple": 0.60,
            "water-marble": 0.78,
            "honey-marble": 0.78,
            "gravity": 0.53,
        },
    },
    split_half={"water": Published(0.96, 0.94, 0.97), "honey": Published(0.81, 0.73, 0.86)},
)
"""Pearson r over 120 scenes, with the 95 % interval over participants where the paper gives it."""

EXPERIMENT = Experiment(
    name="exp1",
    title="two basins under cells of a Voronoi tessellation; one group sees water, one honey",
    family=VoronoiFamily(),
    choice=FilteredScenes(),
    goal="basins",
    scene_count=120,
    practice_count=15,
    participants=65,
    groups=(("water",), ("honey",)),
    grid="paper-exp1",
    heading="Experiment 1 (basins)",
    observers={"water": "water-ife", "honey": "honey-ife-2"},
    truths={"water": "truth-water", "honey": "truth-honey"},
    published=PUBLISHED,
)
