"""Executors: the same table whoever does the work, and workers and parents that are killed."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from pourcast import cli
from pourcast.errors import InputError
from pourcast.sweep.executors import dask
from pourcast.sweep.executors.choose import ClusterOptions, make_executor
from pourcast.sweep.executors.slurm import LONGEST_ARRAY, sbatch_script
from pourcast.sweep.store import Store
from tests.sweep.make import SMALL, small_plan, small_study, swept

LONGER = """
shard_seconds = 0.15

[[models]]
model = "ife"
liquids = ["water", "honey"]
parameters.n_particles = [25, 40]
parameters.damping_zeta = { from = 0, to = 12, step = 1 }
parameters.zeta_sigma = [0, 2]

[[models]]
model = "simple"
"""


def study_with(folder, text, count=5):
    study, grid = small_study(folder, count), folder / "grid.toml"
    grid.write_text(text)
    return study, grid


def table_of(study):
    return (study / "judgments" / "grid.parquet").read_bytes()


def call(study, grid, *arguments):
    return cli.run(["sweep", str(study), "--grid", str(grid), *map(str, arguments)])


def started(study, grid, *arguments):
    """A sweep in a process of its own."""
    command = [sys.executable, "-m", "pourcast", "sweep", study, "--grid", grid, *arguments]
    return subprocess.Popen(
        [str(part) for part in command],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def children_of(process):
    """Its worker processes, without the one that tracks semaphores."""
    path = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    with_names = ((int(pid), Path(f"/proc/{pid}/cmdline")) for pid in path.read_text().split())
    return [pid for pid, name in with_names if b"spawn_main" in name.read_bytes()]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Table of the longer grid from one uninterrupted run with one worker, and its shards."""
    study, grid = study_with(tmp_path_factory.mktemp("reference"), LONGER)
    assert call(study, grid, "--workers", 1) == 0
    return table_of(study), set(Store(study / "sweep").paths())


def test_two_workers_give_the_table_of_one(tmp_path, reference):
    study, grid = study_with(tmp_path, LONGER)
    assert call(study, grid, "--workers", 2) == 0
    assert table_of(study) == reference[0]


# Kill -9 -----------------------------------------------------------------------------------


def killed_at_random(study, grid, victim, rng):
    """Start a sweep, and kill somebody at a random moment of it; whether that came in time."""
    store = Store(study / "sweep")
    before = len(store.paths())
    process = started(study, grid, "--workers", "2")
    deadline = time.monotonic() + 60
    while not store.locks_held() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(rng.uniform(0, 0.8))
    try:
        pids = [process.pid] if victim == "parent" else rng.sample(children_of(process), 1)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
    except (FileNotFoundError, ProcessLookupError, ValueError):
        pids = []
    _, said = process.communicate(timeout=120)
    if victim == "worker":
        assert process.returncode == 0, said
    return bool(pids) and len(store.paths()) >= before


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="finds workers in /proc")
def test_killed_at_ten_random_moments_the_table_is_the_same(tmp_path, reference):
    rng = random.Random(4)
    kills, rounds, orphans = 0, 0, []
    while kills < 10:
        rounds += 1
        assert rounds < 30
        study, grid = study_with(tmp_path / str(rounds), LONGER)
        for victim in ("parent", "parent", "worker"):
            kills += killed_at_random(study, grid, victim, rng)
            orphans += [half for half in study.rglob(".*-*") if half.is_file()]
        assert call(study, grid, "--workers", 2) == 0
        assert table_of(study) == reference[0]
        assert not list(study.rglob(".*-*"))


def test_workers_end_when_their_parent_is_killed(tmp_path):
    study, grid = study_with(tmp_path, LONGER)
    process = started(study, grid, "--workers", "2")
    store = Store(study / "sweep")
    while not store.locks_held():
        time.sleep(0.05)
    workers = children_of(process)
    process.kill()
    process.communicate()
    deadline = time.monotonic() + 60
    while workers and time.monotonic() < deadline:
        workers = [pid for pid in workers if Path(f"/proc/{pid}/exe").exists()]
        time.sleep(0.05)
    assert workers == []
    assert store.locks_held() == []


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_an_interrupted_sweep_says_how_far_it_is_and_goes_on(tmp_path, reference, name):
    study, grid = study_with(tmp_path, LONGER)
    process = started(study, grid, "--workers", "2")
    store = Store(study / "sweep")
    while len(store.paths()) < 3:
        time.sleep(0.02)
    os.killpg(process.pid, getattr(signal, name))  # As a terminal does: all of them.
    _, said = process.communicate(timeout=200)
    assert process.returncode == 130
    *told, last = said.splitlines()
    assert f"of {len(reference[1])} shards are done; the same command goes on from there" in last
    assert all(line.endswith((" left", " so far")) for line in told), said
    done = len(store.paths())
    assert store.locks_held() == []
    assert call(study, grid, "--workers", 2, "--json") == 0
    assert table_of(study) == reference[0]
    assert len(store.paths()) == len(reference[1]) > done


def test_on_a_terminal_there_is_a_bar_with_rate_and_time_left(tmp_path):
    study, grid = study_with(tmp_path, LONGER)
    command = [sys.executable, "-m", "pourcast", "sweep", study, "--grid", grid, "--workers", "2"]
    ours, its = os.openpty()
    process = subprocess.Popen(
        [str(part) for part in command], stdout=subprocess.PIPE, stderr=its,
        env={**os.environ, "COLUMNS": "120", "TERM": "xterm"},
    )  # fmt: skip
    os.close(its)
    shown = b""
    with open(ours, "rb", buffering=0) as terminal:
        try:
            while part := terminal.read(4096):
                shown += part
        except OSError:  # The other end is closed.
            pass
    process.communicate(timeout=60)
    total = small_plan(text=LONGER).simulations
    assert re.search(rb"[1-9]\d* of \d+ shards, [1-9]\d* of %d simulations, \d+/s" % total, shown)
    assert re.search(rb"/s, \d+ s left", shown)


def test_two_sweeps_at_once_share_the_work(tmp_path, reference):
    study, grid = study_with(tmp_path, LONGER)
    both = [started(study, grid, "--workers", "1", "--json") for _ in range(2)]
    answers = [process.communicate(timeout=200) for process in both]
    assert [process.returncode for process in both] == [0, 0], answers
    assert table_of(study) == reference[0]
    assert set(Store(study / "sweep").paths()) == reference[1]


def test_nothing_is_done_twice_by_two_sweeps_at_once(tmp_path):
    # Counted in the workers: a line for every shard that is really computed.
    study, grid = study_with(tmp_path, LONGER)
    log = tmp_path / "log"
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from pourcast.sweep import shard\n"
        "from pourcast.sweep.grid import read_grid\n"
        "from pourcast.study.folder import load_scenes\n"
        "from pourcast.sweep.plan import make_plan\n"
        "from tests.sweep.make import swept\n"
        "compute = shard.compute\n"
        "def counted(task, **options):\n"
        "    with open(sys.argv[3], 'a') as stream:\n"
        "        stream.write(task.shard.id + '\\n')\n"
        "    return compute(task, **options)\n"
        "shard.compute = counted\n"
        "study = Path(sys.argv[1])\n"
        "swept(make_plan(read_grid(sys.argv[2]), load_scenes(study)), study / 'sweep')\n"
    )
    command = [sys.executable, "-c", code, str(study), str(grid), str(log)]
    both = [subprocess.Popen(command) for _ in range(2)]
    assert [process.wait(200) for process in both] == [0, 0]
    did = log.read_text().split()
    assert len(did) == len(set(did)) == len(Store(study / "sweep").paths())


# Poison ----------------------------------------------------------------------------------

POISON = '''
import os
from dataclasses import dataclass
import numpy as np
from pourcast import Model, parameter

@dataclass(frozen=True)
class Poison(Model):
    """Kills its process."""
    dose: float = parameter(0.0, low=0, high=1, doc="1 kills")

    def judge(self, scenes, liquid, seed=0, *, progress=None):
        if self.dose == 1:
            os.kill(os.getpid(), 9)
        return np.full(len(scenes), self.dose)
'''


def test_a_shard_that_kills_its_workers_is_given_up_and_the_rest_is_done(tmp_path):
    site = tmp_path / "site"
    info = site / "poison_model-1.dist-info"
    info.mkdir(parents=True)
    (site / "poison_model.py").write_text(POISON)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: poison-model\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[pourcast.models]\npoison = poison_model:Poison\n")
    text = 'shard_seconds = 0.05\n[[models]]\nmodel = "poison"\nparameters.dose = [0, 0.5, 1]\n'
    study, grid = study_with(tmp_path, text)
    command = [sys.executable, "-m", "pourcast", "sweep", study, "--grid", grid, "--attempts", "2"]
    run = subprocess.run(
        [*map(str, command), "--json"], env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 1
    assert "failed 2 times: its worker died" in run.stderr
    assert "5 judgments are missing; the same command tries them again" in run.stderr
    assert '"missing": 5' in run.stdout


# Dask ------------------------------------------------------------------------------------


@contextmanager
def dask_cluster(workers):
    import distributed

    with distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, protocol="tcp://",
        dashboard_address=None,
    ) as cluster:  # fmt: skip
        yield cluster


@pytest.mark.filterwarnings("ignore")
def test_dask_workers_give_the_same_table_and_may_be_killed(tmp_path, reference):
    study, grid = study_with(tmp_path, LONGER)
    with dask_cluster(2) as cluster:
        address = cluster.scheduler_address
        assert address.startswith("tcp://")
        process = started(study, grid, "--executor", "dask", "--scheduler", address)
        store = Store(study / "sweep")
        while len(store.paths()) < 3:
            time.sleep(0.02)
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        _, said = process.communicate(timeout=200)
        assert process.returncode == 0, said
    assert table_of(study) == reference[0]


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_dies_is_said_in_one_line_and_nothing_is_lost(
    tmp_path, reference, monkeypatch, capsys
):
    monkeypatch.setattr(dask, "_CONNECT_SECONDS", 3)
    study, grid = study_with(tmp_path, LONGER)
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    command += ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(tmp_path / "s.json")]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--no-dashboard"]
    worker += ["--nthreads", "1", "--scheduler-file", str(tmp_path / "s.json")]
    cluster = [subprocess.Popen(c, stderr=subprocess.DEVNULL) for c in (command, worker)]
    store = Store(study / "sweep")

    def kill_in_the_middle():
        while len(store.paths()) < 2:
            time.sleep(0.02)
        cluster[0].kill()

    try:
        while not (tmp_path / "s.json").exists():
            time.sleep(0.1)
        address = json.loads((tmp_path / "s.json").read_text())["address"]
        threading.Thread(target=kill_in_the_middle).start()
        assert call(study, grid, "--executor", "dask", "--scheduler", address) == 1
    finally:
        for process in cluster:
            process.kill()
            process.wait()
    said = capsys.readouterr().err
    assert "the Dask scheduler is gone" in said
    assert "the same command goes on from there" in said
    assert call(study, grid) == 0
    assert table_of(study) == reference[0]


def test_a_scheduler_that_is_not_there_is_said_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(dask, "_CONNECT_SECONDS", 1)
    study, grid = study_with(tmp_path, SMALL)
    assert call(study, grid, "--executor", "dask", "--scheduler", "tcp://127.0.0.1:9") == 2
    said = capsys.readouterr().err
    assert "scheduler tcp://127.0.0.1:9: no answer" in said
    assert said.count("\n") == 1


def test_what_is_not_installed_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"needs distributed; .* pip install '\.\[cluster\]'"):
        make_executor("dask", 1, tmp_path, "tcp://127.0.0.1:9", ClusterOptions())


# A plain script --------------------------------------------------------------------------


def test_the_printed_script_does_the_sweep_under_bash(tmp_path, capsys):
    text = SMALL.replace("= 0.02", "= 0.5")
    study, grid = study_with(tmp_path, text)
    assert call(study, grid, "--executor", "slurm", "--print-script", "--workers", 3) == 0
    script = capsys.readouterr().out
    plan = small_plan(text=text)
    assert f"#SBATCH --array=0-{len(plan.shards) - 1}%3\n" in script
    path = tmp_path / "job.sh"
    path.write_text(script)
    for task in range(len(plan.shards)):
        subprocess.run(
            ["bash", str(path)], env={**os.environ, "SLURM_ARRAY_TASK_ID": str(task)},
            capture_output=True, check=True, cwd="/",
        )  # fmt: skip
    assert call(study, grid) == 0
    assert "ran 0 (0 shards)" in capsys.readouterr().out
    result, _ = swept(plan, tmp_path / "again")
    import pandas as pd

    there = pd.read_parquet(study / "judgments" / "grid.parquet")["judgment"]
    assert there.to_list() == result.table["judgment"].to_list()


def test_a_script_of_many_shards_keeps_to_slurms_limit_and_the_labs_options():
    options = {
        "partition": "short", "time": 30, "setup": ["module load python"],
        "additional_parameters": {"mail-type": "END"},
    }  # fmt: skip
    script = sbatch_script(["sweep", "s p"], "big", 12_345, 8, options)
    assert f"#SBATCH --array=0-{LONGEST_ARRAY - 1}%8\n" in script
    assert '--shard "$SLURM_ARRAY_TASK_ID/1000"' in script
    for line in ("--partition=short", "--time=30", "--mem=2G", "--mail-type=END", "--requeue"):
        assert f"#SBATCH {line}\n" in script
    assert "\nmodule load python\n" in script
    assert "'s p'" in script
    assert script.startswith("#!/bin/bash\n")
