"""Data as they really come: one person, few scenes, yes or no, gaps, groups that share nothing."""

import shutil

import numpy as np
import pandas as pd
import pytest

from pourcast import cli
from pourcast.scenes.scene_file import read_scenes
from tests.report.conftest import CHEAP

MODELS = [part for model in CHEAP for part in ("-m", model)]
TRUTH = ["-m", "truth-water"]


@pytest.fixture
def answered(study, tmp_path):
    """A study whose responses are made from an array, and how."""
    folder = tmp_path / "odd"
    shutil.copytree(study, folder, ignore=shutil.ignore_patterns("responses*"))
    scenes = read_scenes(folder / "scenes.json")
    truth = np.linspace(0.05, 0.95, len(scenes))

    def write(people, answers=None, there=None, shown=None):
        rng = np.random.default_rng(1)
        noisy = np.clip(truth + 0.15 * rng.standard_normal((people, len(scenes))), 0, 1)
        answers = noisy if answers is None else answers(noisy)
        rows = [
            {
                "participant": f"p{p}",
                "scene": scene.id,
                "liquid": "water",
                "response": answers[p, k],
            }
            for p in range(people)
            for k, scene in enumerate(scenes[:shown])
            if there is None or there(p, k)
        ]
        (folder / "responses").mkdir(exist_ok=True)
        pd.DataFrame(rows).to_csv(folder / "responses" / "odd.csv", index=False)
        return folder

    return write


def compared(folder, capsys, *options):
    """Tables, and what was printed."""
    tables = folder / "tables"
    assert cli.run(["compare", str(folder), *MODELS, *options, "-o", str(tables)]) == 0
    printed = capsys.readouterr().out
    assert "[-, -]" not in printed
    assert "nan" not in printed.lower()
    return {path.stem: pd.read_csv(path) for path in tables.glob("*.csv")}, printed


CASES = {
    "one person": ({"people": 1}, "at least 5 of them, not 1 (--over scenes has them)"),
    "four people": ({"people": 4}, "at least 5 of them, not 4"),
    "three scenes": ({"people": 12, "shown": 3}, "an interval over scenes needs at least 5"),
    "a person, three scenes": ({"people": 1, "shown": 3}, "not 1"),
    "groups that share no scene": (
        {"people": 12, "there": lambda p, k: (p < 6) == (k < 5)}, "",
    ),
    "half of the cells": ({"people": 12, "there": lambda p, k: (p + k) % 2 == 0}, ""),
    "each scene by one person": (
        {"people": 10, "there": lambda p, k: p == k}, "too few scenes have two answers",
    ),
    "yes or no": ({"people": 12, "answers": np.round}, ""),
    "all alike": (
        {"people": 12, "answers": lambda noisy: np.tile(noisy[:1], (12, 1))}, "",
    ),
    "answers that differ in one scene": (
        {"people": 12, "answers": lambda noisy: np.where(np.arange(10) == 4, noisy, 0.5)},
        "without one of the scenes",
    ),
    "all the same": (
        {"people": 12, "answers": lambda noisy: np.full_like(noisy, 0.5)},
        "all answers are the same",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_odd_data_are_compared_as_far_as_they_go_and_it_is_said_why_no_further(
    answered, capsys, case
):
    how, said = CASES[case]
    truth = TRUTH if case == "all the same" else []
    found, printed = compared(answered(**how), capsys, *truth)
    assert said in " ".join(printed.split())
    table = found["agreement"]
    if case == "all the same":
        assert table["r"].isna().all()
    else:
        assert table["r"].notna().all()
    if "needs at least" in said or "at least 5" in said:
        assert table["r_low"].isna().all()
        assert found["differences"]["p_holm"].isna().all()


def test_how_a_table_was_read_is_told(answered, capsys):
    folder = answered(12)
    path = folder / "responses" / "odd.csv"
    pd.read_csv(path).to_csv(path, index=False, sep=";", decimal=",")
    found, printed = compared(folder, capsys)
    assert "odd.csv was read as separated by semicolons, with decimal commas" in printed
    assert found["agreement"]["r_low"].notna().all()


def test_one_person_has_intervals_over_scenes(answered, capsys):
    found, _ = compared(answered(1), capsys, "--over", "scenes")
    table = found["agreement"]
    assert (table["r_low"] < table["r"]).all()
    assert (table["r"] < table["r_high"]).all()


def test_yes_or_no_keeps_the_comparison_with_chance(answered, capsys):
    found, _ = compared(answered(12, np.round), capsys, *TRUTH)
    (row,) = found["chance"].to_dict("records")
    assert row["beta_a"] == row["beta_b"] == 0.0
    assert 0.0 < row["permutation_p"] < 1.0
