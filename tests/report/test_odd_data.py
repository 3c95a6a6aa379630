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
    assert "odd.csv: read as separated by semicolons, with decimal commas" in printed
    assert found["agreement"]["r_low"].notna().all()


def test_repeated_trials_tell_how_well_people_agree_with_themselves(answered, capsys):
    folder = answered(8)
    path = folder / "responses" / "odd.csv"
    table = pd.read_csv(path)
    rng = np.random.default_rng(2)
    again = (table["response"] + 0.05 * rng.standard_normal(len(table))).clip(0, 1)
    pd.concat([table, table.assign(response=again)]).to_csv(path, index=False)
    found, printed = compared(folder, capsys)
    assert "80 trials of 8 participants repeat a scene" in printed
    (row,) = found["retest"].to_dict("records")
    assert (row["participants"], row["repeated"], row["over"]) == (8, 80, "participants")
    assert 0.9 < row["retest_r_low"] < row["retest_r"] < row["retest_r_high"] < 1.0
    assert row["noise_low"] < row["noise"] < 0.1
    assert "Within-person reliability" in printed
    _, printed = compared(folder, capsys, "--exclude", "repeats=first")
    assert "Within-person" not in printed
    assert "repeat a scene" not in printed


def test_few_repeated_trials_have_no_reliability_and_it_is_said_why(answered, capsys):
    folder = answered(8)
    path = folder / "responses" / "odd.csv"
    table = pd.read_csv(path)
    pd.concat([table, table.iloc[[3]]]).to_csv(path, index=False)
    _, printed = compared(folder, capsys)
    said = " ".join(printed.split())
    assert "water: no within-person reliability: nobody answered 10 scenes twice" in said
    pd.concat([table, table.iloc[:20]]).to_csv(path, index=False)
    found, printed = compared(folder, capsys)
    assert "has no interval: it needs at least 5 participants" in " ".join(printed.split())
    assert found["retest"]["retest_r_low"].isna().all()


@pytest.fixture
def means(answered):
    """A study of which only means are known."""
    folder = answered(8)
    path = folder / "responses" / "odd.csv"
    table = pd.read_csv(path).groupby("scene", as_index=False)["response"].agg(["mean", "size"])
    table.rename(columns={"size": "n"}).to_csv(path, index=False)
    return folder, ["--columns", "response=mean,liquid:water,means:true,answers=n"]


def test_means_alone_are_compared_and_it_is_said_what_they_cannot_tell(means, capsys):
    folder, mapping = means
    found, printed = compared(folder, capsys, *mapping)
    said = " ".join(printed.split())
    why = "an interval over participants needs their answers, and only means are known"
    assert (
        f"no intervals, and no model is told from another: {why} (--over scenes has them)" in said
    )
    assert "no reliability of all participants: only means are known" in said
    assert "single participants are not compared with chance: only means are known" in said
    assert "1 participants" not in said
    table = found["agreement"]
    assert table["r"].notna().all()
    assert table["r_low"].isna().all()
    assert found["reliability"]["participants"].tolist() == [0]
    assert found["judgments"]["answers"].tolist() == [8] * 10
    assert found["judgments"]["sd"].isna().all()
    found, _ = compared(folder, capsys, *mapping, "--over", "scenes")
    assert (found["agreement"]["r_low"] < found["agreement"]["r"]).all()


def test_a_report_on_means_alone(means, tmp_path, capsys):
    folder, mapping = means
    out = tmp_path / "report"
    options = [*MODELS[:4], "--films", "0", "--studies", "0", "-o", str(out)]
    assert cli.run(["report", str(folder), *mapping, *options]) == 0
    page = (out / "report.html").read_text()
    assert "water: means alone, 10 scenes" in page
    assert "Only means were known of people&#39;s answers to 10 scenes of water" in page
    assert "response=mean,liquid:water,means:true,answers=n" in page
    assert "1 participants" not in page


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--exclude", "min-trials=3"], "exclude: only means are known"),
        (["--bayes"], "--bayes needs single answers, and only means are known"),
    ],
)
def test_what_means_alone_cannot_do_is_refused(means, capsys, options, said):
    folder, mapping = means
    assert cli.run(["compare", str(folder), "-m", "gravity", *mapping, *options]) == 2
    assert said in capsys.readouterr().err


def test_a_mean_that_stands_twice_is_refused(means, capsys):
    folder, mapping = means
    path = folder / "responses" / "odd.csv"
    table = pd.read_csv(path)
    pd.concat([table, table.iloc[[2]]]).to_csv(path, index=False)
    assert cli.run(["compare", str(folder), "-m", "gravity", *mapping]) == 2
    assert "row 12: a second mean of scene s02 (water)" in capsys.readouterr().err


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
