"""A real SLURM cluster of one node: job arrays by submitit, the printed script, dask-jobqueue.

Skipped where there is no SLURM, or no right to start it; `.ci/run` installs it.
"""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pourcast import cli
from pourcast.scenes.scene_file import write_scenes
from pourcast.stimuli.manifest import read_set, set_folder
from pourcast.sweep.store import Store
from tests.make import ramp_scene
from tests.sweep.test_executors import LONGER, call, started, study_with, table_of

SCRIPT = Path(__file__).parent / "slurm.sh"

pytestmark = pytest.mark.skipif(
    shutil.which("slurmctld") is None or os.getuid() != 0,
    reason="no SLURM here (Debian: apt-get install slurm-wlm munge), or not root",
)


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A running cluster; SLURM_CONF points to it."""
    folder = tmp_path_factory.mktemp("slurm")
    begun = subprocess.run(
        ["bash", str(SCRIPT), "start", str(folder)], capture_output=True, text=True, check=False
    )
    try:
        assert begun.returncode == 0, begun.stderr
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("SLURM_CONF", begun.stdout.strip())
            yield folder
    finally:
        subprocess.run(["bash", str(SCRIPT), "stop", str(folder)], check=False)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    study, grid = study_with(tmp_path_factory.mktemp("reference"), LONGER)
    assert call(study, grid, "--workers", 2) == 0
    return table_of(study)


def jobs():
    answer = subprocess.run(
        ["squeue", "--noheader", "--array", "--format=%F_%K %T"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return [line.split() for line in answer.stdout.splitlines()]


def test_a_sweep_through_submitit(slurm, tmp_path, reference, capsys):
    # Seven tasks, not 21: each of them starts a Python, which takes seconds.
    study, grid = study_with(tmp_path, LONGER.replace("0.15", "0.5"))
    assert call(study, grid, "--executor", "slurm", "--workers", 2) == 0
    assert table_of(study) == reference
    assert "judgments" in capsys.readouterr().out
    assert not list((study / "sweep" / "slurm").glob("*.pkl"))


def test_a_cancelled_task_is_done_again(slurm, tmp_path, reference, monkeypatch):
    text = LONGER.replace("0.15", "1.0")
    study, grid = study_with(tmp_path, text)
    process = started(study, grid, "--executor", "slurm", "--workers", "1")
    deadline = time.monotonic() + 60
    while not any(state == "RUNNING" for _, state in jobs()):
        assert time.monotonic() < deadline
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    running = next(name for name, state in jobs() if state == "RUNNING")
    subprocess.run(["scancel", "--signal=KILL", "--full", running], check=True)
    _, said = process.communicate(timeout=200)
    assert process.returncode == 0, said
    assert table_of(study) == reference


def test_an_interrupted_sweep_cancels_its_jobs(slurm, tmp_path):
    study, grid = study_with(tmp_path, LONGER)
    process = started(study, grid, "--executor", "slurm", "--workers", "1")
    deadline = time.monotonic() + 60
    while not jobs():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.terminate()
    _, said = process.communicate(timeout=200)
    assert process.returncode == 130
    assert "the same command goes on from there" in said
    while jobs():
        assert time.monotonic() < deadline + 30
        time.sleep(0.2)


def test_the_printed_script_through_sbatch(slurm, tmp_path, reference, capsys):
    study, grid = study_with(tmp_path, LONGER.replace("0.15", "1.0"))
    cluster = tmp_path / "cluster.toml"
    cluster.write_text(
        f'[slurm]\npartition = "test"\nmem = 0\ntime = 5\n'
        f'additional_parameters = {{ output = "{tmp_path}/%a.txt" }}\n'
    )
    assert call(study, grid, "--print-script", "--workers", 2, "--cluster", cluster) == 0
    script = tmp_path / "job.sh"
    script.write_text(capsys.readouterr().out)
    subprocess.run(["sbatch", "--wait", str(script)], check=True, capture_output=True)
    assert call(study, grid) == 0
    assert "ran 0 (0 shards)" in capsys.readouterr().out
    assert table_of(study) == reference


def test_workers_that_dask_jobqueue_starts(slurm, tmp_path, reference):
    study, grid = study_with(tmp_path, LONGER)
    cluster = tmp_path / "cluster.toml"
    cluster.write_text(
        f'[dask]\nqueue = "test"\nlog_directory = "{tmp_path}/logs"\nwalltime = "00:10:00"\n'
        'memory = "1GB"\nscheduler_options = { dashboard_address = ":0" }\n'
    )
    process = started(study, grid, "--executor", "dask", "--cluster", cluster, "--workers", "2")
    _, said = process.communicate(timeout=200)
    assert process.returncode == 0, said
    assert table_of(study) == reference
    assert len(Store(study / "sweep").paths()) > 3


def test_a_wrong_option_and_a_refused_job_are_said_in_one_line(slurm, tmp_path, capfd):
    study, grid = study_with(tmp_path, LONGER)
    cluster = tmp_path / "cluster.toml"
    cluster.write_text("[slurm]\npartitoin = 'test'\n")
    options = ("--executor", "slurm", "--cluster", cluster)
    assert call(study, grid, *options) == 2
    said = capfd.readouterr().err
    assert f"{cluster}: slurm: Unavailable parameter(s): ['partitoin']" in said
    assert said.count("\n") == 1
    cluster.write_text("[slurm]\npartition = 'no-such'\n")
    assert call(study, grid, *options) == 2
    said = capfd.readouterr().err
    assert "pourcast: sbatch: error: " in said
    assert "Invalid partition" in said
    assert said.count("\n") == 1


def test_a_worker_that_slurm_refuses_is_said_in_one_line(slurm, tmp_path, capfd):
    study, grid = study_with(tmp_path, LONGER)
    cluster = tmp_path / "cluster.toml"
    cluster.write_text("[dask]\nqueue = 'no-such'\n")
    assert call(study, grid, "--executor", "dask", "--cluster", cluster) == 2
    said = capfd.readouterr().err
    assert "cluster.toml: dask: SLURM refuses a worker's job" in said
    assert "no-such" in said
    assert said.count("\n") == 1


def test_without_slurm_it_is_said(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent))
    study, grid = study_with(tmp_path, LONGER)
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--executor", "slurm"]) == 2
    assert 'Could not detect "srun"' in capsys.readouterr().err


def test_films_are_made_on_the_cluster(slurm, tmp_path, capsys):
    write_scenes(tmp_path / "scenes.json", [ramp_scene()])
    call = ["stimuli", str(tmp_path), "--resolution", "24", "--seconds", "0.2", "--size", "80"]
    assert cli.run([*call, "--executor", "slurm", "--workers", "2"]) == 0
    assert "2 stimuli" in capsys.readouterr().out
    made = read_set(set_folder(tmp_path, "lbm-preview"))
    assert all(made.is_whole(one) and one.film for one in made.manifest.stimuli)
