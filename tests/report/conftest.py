"""A small study with made-up judgments, real cheap models, and simulated observers."""

import pytest

from pourcast.comparison.agreement import Settings
from pourcast.comparison.compare import compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.observers.observers import Observers
from pourcast.observers.responses import rehearse
from pourcast.scenes.scene_file import write_scenes
from pourcast.tables import write_table
from tests.comparison.make import made_up_table, voronoi_scenes

CHEAP = ("water-simple", "gravity", "truth-water:n_particles=15", "ife:n_particles=15,zeta_sigma=0")


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small") / "study"
    scenes = voronoi_scenes(10)
    write_scenes(folder / "scenes.json", scenes)
    write_table(folder / "judgments" / "grid.parquet", made_up_table(scenes))
    observers = Observers(
        12, {"water": "water-simple", "honey": "gravity"}, (("water",), ("honey",)), spreads={}
    )
    rehearse(folder, scenes, observers)
    return folder


@pytest.fixture(scope="session")
def comparison(study):
    return compare_study(study, ComparisonOptions(models=CHEAP, settings=Settings()))
