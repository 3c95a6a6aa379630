"""The commands that compare models with people, on the small study of `conftest`."""

import json
import shutil

import pandas as pd
import pytest

from pourcast import cli
from tests.report.conftest import CHEAP

MODELS = [word for spec in CHEAP for word in ("-m", spec)]


def call(*arguments):
    return cli.run([str(argument) for argument in arguments])


def test_simulate_writes_the_same_bytes_for_the_same_seed(study, tmp_path, capsys):
    one, two, other = (tmp_path / f"{name}.csv" for name in ("one", "two", "other"))
    simulate = [
        "experiment",
        "simulate",
        study,
        "--observers",
        6,
        "-m",
        "gravity",
        "-m",
        "honey=water-simple",
    ]
    simulate += ["--vary", "m=0.02", "--precision", 9]
    assert call(*simulate, "-o", one) == call(*simulate, "-o", two) == 0
    assert call(*simulate, "--seed", 1, "-o", other) == 0
    assert one.read_bytes() == two.read_bytes() != other.read_bytes()
    assert "6 simulated observers, 10 trials each" in capsys.readouterr().out
    table = pd.read_csv(one)
    assert table["simulated"].all()
    assert table["model"].nunique() > 2


def test_compare_prints_and_writes_tables(study, tmp_path, capsys):
    out = tmp_path / "tables"
    assert call("compare", study, *MODELS, "--exclude", "max-rt=9", "-o", out) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("SIMULATED observers")
    assert "excluded by max-rt=9: " in printed
    assert "over participants and scenes" in printed
    assert "Not told from the chosen values:" in printed
    table = pd.read_csv(out / "agreement.csv")
    assert set(table["model"]) == set(CHEAP)
    assert (out / "choice.csv").is_file()


def test_compare_as_json(study, capsys):
    assert (
        call(
            "compare",
            study,
            "-m",
            "gravity",
            "-m",
            "water-simple",
            "--over",
            "participants",
            "--json",
        )
        == 0
    )
    found = json.loads(capsys.readouterr().out)
    assert found["simulated"] is True
    assert {row["over"] for row in found["tables"]["agreement"]} == {"participants"}


def test_carried_parameters(study, tmp_path, capsys):
    other = tmp_path / "other"
    tables = other / "report" / "tables"
    assert call("compare", study, "-m", "gravity", "-o", tables) == 0
    choice = pd.read_csv(tables / "choice.csv")
    choice[choice["model"].str.endswith("simple")].to_csv(tables / "choice.csv", index=False)
    assert call("compare", study, "-m", "gravity", "--carry-from", other) == 0
    assert "carried over unchanged" in capsys.readouterr().out


def test_recover_and_power(study, tmp_path, capsys):
    assert call("recover", "parameters", study, "--studies", 20, "-o", tmp_path / "p") == 0
    table = pd.read_csv(tmp_path / "p" / "parameters_recovery.csv")
    assert len(table) == 17
    assert table["within_one_step"].mean() > 0.9
    assert (
        call(
            "recover",
            "models",
            study,
            "-m",
            "gravity",
            "-m",
            "water-simple",
            "--studies",
            5,
            "--json",
        )
        == 0
    )
    rows = json.loads(capsys.readouterr().out.partition("\n[")[2].join(["[", ""]))
    assert [row["planted"] for row in rows] == ["gravity", "water-simple"]
    power = [
        "power",
        study,
        "-m",
        "gravity",
        "-m",
        "water-simple",
        "--observers",
        6,
        "--studies",
        5,
    ]
    assert call(*power, "-o", tmp_path / "w") == 0
    assert sorted(path.name for path in (tmp_path / "w").iterdir()) == [
        "power.csv",
        "power.png",
        "power.svg",
    ]


def test_a_study_without_a_sweep_is_compared_all_the_same(study, tmp_path, capsys):
    bare = tmp_path / "bare"
    shutil.copytree(study, bare, ignore=shutil.ignore_patterns("judgments", "sweep"))
    assert call("compare", bare, "-m", "gravity", "-m", "water-simple") == 0
    printed = capsys.readouterr().out
    assert "no parameters were chosen: no grid was swept" in printed
    assert call("recover", "parameters", bare) == 2
    assert "run `pourcast sweep STUDY --grid ...` first" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["compare", "{study}", "--responses", "none.csv"], "none.csv: cannot be read"),
        (["compare", "{study}", "--exclude", "min-st=1"], "did you mean 'min-sd'"),
        (["compare", "{study}", "-m", "gravty"], "did you mean 'gravity'"),
        (["compare", "{study}", "--carry-from", "nowhere"], "not a table of chosen parameters"),
        (["report", "nowhere"], "nowhere: expected a study folder"),
        (["report", "{study}", "-o", "/proc/report"], "cannot be written"),
        (["experiment", "simulate", "{study}", "--lapse", "2"], "lapse: expected 0 to 1, found 2"),
        (
            ["experiment", "simulate", "{study}", "--vary", "zeta"],
            "expected PARAMETER=SD, found 'zeta'",
        ),
        (
            ["experiment", "simulate", "{study}", "-o", "r.xlsx"],
            "expected a name that ends in .csv or .parquet",
        ),
        (
            ["recover", "parameters", "{study}", "-p", "zeta"],
            "there is no 'zeta'; did you mean 'zeta_sigma'? known: n_particles, damping_zeta",
        ),
        (["recover", "models", "{study}", "-m", "gravity"], "expected at least two models"),
        (["power", "{study}", "-m", "gravity"], "expected two models to tell apart, found 1"),
        (["reproduce", "exp1", "-o", "{study}"], "exists and is not an empty folder"),
        (
            [
                "reproduce",
                "exp1",
                "--quick",
                "-n",
                "3",
                "-o",
                "{study}-new",
                "--responses",
                "none.csv",
            ],
            "none.csv: cannot be read",
        ),
    ],
)
def test_bad_calls(study, capsys, monkeypatch, tmp_path, arguments, said):
    monkeypatch.chdir(tmp_path)
    assert call(*(word.format(study=study) for word in arguments)) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
