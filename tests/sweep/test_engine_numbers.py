"""NumPy's numbers in what names results."""

from dataclasses import replace

import numpy as np

from pourcast import WATER, Pour, demo_scenes
from pourcast.sweep.settings import PourSetting


def test_a_liquid_of_numpys_numbers_names_results_as_one_of_pythons():
    scene = demo_scenes()[0]
    numpys, pythons = (
        PourSetting.of(Pour(scene, replace(WATER, cohesion=value), 20)).identity
        for value in (np.float32(0.5), 0.5)
    )
    assert numpys == pythons
