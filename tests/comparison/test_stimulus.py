"""The films' outcomes as one more ground truth of a comparison."""

import shutil

import numpy as np
import pytest

from pourcast.comparison.agreement import Settings
from pourcast.comparison.compare import compare_study
from pourcast.comparison.matching import ComparisonOptions
from pourcast.errors import InputError
from pourcast.scenes.liquids.registry import WATER
from pourcast.scenes.scene_file import read_scenes
from pourcast.statistics.correlation import pearson
from pourcast.stimuli.manifest import Manifest, Stimulus, StimulusSet, set_folder, write_set
from pourcast.stimuli.renderers.preview import Preview
from pourcast.stimuli.settings import StimulusSettings
from pourcast.stimuli.solvers.lbm import LatticeBoltzmann
from tests.report.conftest import study

__all__ = ["study"]

LATTICE = StimulusSettings(solver=LatticeBoltzmann(), renderer=Preview())
QUICK = Settings()


@pytest.fixture
def filmed(study, tmp_path):
    """The small study, all films of water made (their outcomes are made up)."""
    folder = tmp_path / "study"
    shutil.copytree(study, folder)
    scenes = read_scenes(folder / "scenes.json")
    outcomes = np.random.default_rng(1).random(len(scenes)).round(6)
    stimuli = tuple(
        Stimulus(scene=scene.digest, liquid="water", still="x.png", outcome=outcome, checksums={})
        for scene, outcome in zip(scenes, outcomes, strict=True)
    )
    place = set_folder(folder, LATTICE.name)
    manifest = Manifest(settings=LATTICE, stimuli=stimuli).with_liquids([WATER])
    write_set(StimulusSet(place, manifest))
    return folder, outcomes


def test_models_are_compared_with_what_the_films_showed(filmed, monkeypatch):
    folder, outcomes = filmed
    request = ComparisonOptions(models=("gravity", "truth-stimulus"), settings=QUICK)
    with pytest.raises(InputError, match="truth-stimulus: not all scenes were filmed with honey"):
        compare_study(folder, request)
    monkeypatch.setattr("pourcast.comparison.compare.complete_presets", lambda: ["gravity"])
    found = compare_study(folder, ComparisonOptions(settings=QUICK))
    water = next(one for one in found.compared if one.trials.liquid == "water")
    assert water.names[:2] == ["gravity", "truth-stimulus"]
    assert (water.models["truth-stimulus"] == outcomes).all()
    table = found.tables["agreement"].set_index(["liquid", "model"])
    expected = pearson(outcomes, water.models["gravity"][None])[0]
    assert table.loc[("water", "gravity"), "r_truth_stimulus"] == pytest.approx(expected)
    assert table.loc[("water", "truth-stimulus"), "r_truth_stimulus"] == pytest.approx(1.0)
    assert ("honey", "truth-stimulus") not in table.index
