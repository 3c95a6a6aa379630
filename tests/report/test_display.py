import numpy as np
import pandas as pd

from pourcast.report.display import readable


def test_intervals_join_their_values():
    table = pd.DataFrame(
        {"model": ["a", "b"], "r": [0.912, np.nan], "r_low": [0.9, np.nan], "r_high": [0.93, np.nan],
         "difference": [-0.5, 0.25], "low": [-0.6, 0.1], "high": [-0.4, 0.3], "p": [0.0002, 0.04],
         "participants": [20, 3], "spec": ["x", "y"]}
    )  # fmt: skip
    shown = readable(table)
    assert list(shown.columns) == ["model", "r", "difference", "p", "participants"]
    assert shown.iloc[0].tolist() == [
        "a",
        "0.91 [0.90, 0.93]",
        "-0.50 [-0.60, -0.40]",
        "2e-04",
        "20",
    ]
    assert shown.iloc[1].tolist() == ["b", "-", "0.25 [0.10, 0.30]", "0.04", "3"]


def test_parameters_are_shown_as_they_are():
    table = pd.DataFrame(
        {"n_particles": [50.0], "viscosity_alpha": ["own"], "m": [0.14], "variance": [0.0035]}
    )
    assert readable(table).iloc[0].tolist() == ["50", "own", "0.14", "0.0035"]
