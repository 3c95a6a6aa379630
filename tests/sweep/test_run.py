"""Driving sweeps: the right judgments, nothing done twice, nothing lost, failures told."""

import json
import sys

import numpy as np
import pandas as pd
import pytest

from pourcast import cli
from pourcast.prediction import predict
from pourcast.simulation.run import simulate
from pourcast.sweep import shard as shard_module
from pourcast.sweep.plan import make_plan
from pourcast.sweep.run import run_part
from pourcast.sweep.store import Store
from pourcast.sweep.survey import survey
from pourcast.sweep.task import TaskResult
from pourcast.sweep.trajectories import read_trajectories
from tests.make import random_scenes
from tests.sweep.make import SMALL, Inline, small_grid, small_plan, small_study, swept


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Table of the small grid, from one uninterrupted run."""
    return swept(small_plan(), tmp_path_factory.mktemp("reference"))[0].table


def judged(table, model, **parameters):
    chosen = table["model"] == model
    for name, value in parameters.items():
        chosen &= table[name] == value
    return table.loc[chosen, "judgment"].to_numpy()


def test_judgments_are_those_of_predict_to_the_last_bit(reference):
    scenes = random_scenes(5, seed=31)
    same = {
        "ife:n_particles=15,damping_zeta=6,zeta_sigma=1": {
            "n_particles": 15, "damping_zeta": 6, "zeta_sigma": 1,
        },
        "marble:n_particles=15,damping_zeta=3,zeta_sigma=1": {},
        "simple:g=0.5": {"g": 0.5},
        "position-uncertainty:n_particles=15,n_draws=3,damping_zeta=6": {},
    }  # fmt: skip
    for spec, parameters in same.items():
        name = spec.partition(":")[0]
        for liquid in ("water", "honey"):
            for seed in (0, 1):
                table = reference[reference["seed"] == seed]
                table = table[table["liquid"].str.startswith(liquid)]
                found = judged(table, name, **parameters)
                if len(found):
                    expected = predict(scenes, [spec], liquid, seed).set_index("scene")["judgment"]
                    ids = table.loc[table["model"] == name, "scene"].drop_duplicates()
                    assert (found == expected.loc[ids].to_numpy()).all()


def test_the_table_is_tidy(reference):
    columns = ["scene", "digest", "liquid", "model", "parameters", "seed", "judgment"]
    assert list(reference.columns[:7]) == columns
    assert {"n_particles", "damping_zeta", "zeta_sigma", "model_liquid", "g", "m"} <= set(reference)
    assert len(reference) == 5 * (24 + 1 + 6 + 1)
    assert not reference.duplicated(columns[:-1]).any()
    assert reference["judgment"].between(0, 1).all()
    parameters = [json.loads(text) for text in reference["parameters"]]
    assert [p.get("damping_zeta", np.nan) for p in parameters] == pytest.approx(
        reference["damping_zeta"].to_list(), nan_ok=True
    )


def test_a_finished_grid_is_not_simulated_again(tmp_path, monkeypatch, reference):
    swept(small_plan(), tmp_path)

    def fail(*args, **kwargs):
        raise AssertionError("something was simulated")

    monkeypatch.setattr(shard_module, "simulate", fail)
    result, executor = swept(small_plan(), tmp_path)
    assert executor.did == []
    assert result.reused_simulations == small_plan().simulations
    assert result.done_simulations == 0
    assert result.table.equals(reference)


def test_a_grid_that_overlaps_an_older_one_runs_only_what_is_new(tmp_path, monkeypatch, reference):
    older = SMALL.replace("n_particles = [15, 20]", "n_particles = 15").replace("to = 8", "to = 6")
    swept(small_plan(4, older), tmp_path)
    ran = []

    def watched(pours, **options):
        ran.extend(pours)
        return simulate(pours, **options)

    monkeypatch.setattr(shard_module, "simulate", watched)
    before = small_plan(4, older).simulations
    result, _ = swept(small_plan(), tmp_path)
    assert result.reused_simulations == before
    assert result.done_simulations == small_plan().simulations - before
    judged_without_pours = 6  # SimpleSim in the new scene
    assert len(ran) == result.done_simulations - judged_without_pours
    assert result.table.equals(reference)
    assert survey(small_plan(), Store(tmp_path)).left == ()
    # And back: the older one needs nothing.
    assert swept(small_plan(4, older), tmp_path)[1].did == []


def test_the_cut_into_shards_is_of_no_account(tmp_path, reference):
    for seconds in (0.005, 1000.0):
        plan = small_plan(text=SMALL.replace("= 0.02", f"= {seconds}"))
        assert swept(plan, tmp_path / str(seconds))[0].table.equals(reference)


def test_results_of_another_version_are_left_alone(tmp_path, monkeypatch):
    swept(small_plan(), tmp_path)
    monkeypatch.setattr("pourcast.sweep.settings.engine_version", lambda: "later")
    monkeypatch.setattr("pourcast.sweep.settings.model_version", lambda model: "later")
    result, executor = swept(small_plan(), tmp_path)
    assert result.reused_simulations == 0
    assert len(executor.did) == len(small_plan().shards)


# Failures --------------------------------------------------------------------------------


class Unreliable(Inline):
    """Loses the shards of its list, each as often as it says."""

    def __init__(self, losses):
        super().__init__()
        self.losses = dict(losses)

    def run(self, tasks, heartbeat):
        for task in tasks:
            name = task.shard.id
            if self.losses.get(name, 0) > 0:
                self.losses[name] -= 1
                self.did.append(name)
                yield TaskResult(name, "lost", "its worker died")
            else:
                yield from super().run([task], heartbeat)


def test_a_lost_shard_is_tried_again(tmp_path, reference):
    names = [shard.id for shard in small_plan().shards]
    result, executor = swept(small_plan(), tmp_path, Unreliable({names[0]: 2, names[3]: 1}))
    assert result.failures == ()
    assert executor.did.count(names[0]) == 3
    assert result.table.equals(reference)


def test_a_poisoned_shard_is_given_up_and_the_rest_is_done(tmp_path):
    names = [shard.id for shard in small_plan().shards]
    result, executor = swept(small_plan(), tmp_path, Unreliable({names[1]: 99}), attempts=2)
    assert executor.did.count(names[1]) == 2
    assert [failure.shard for failure in result.failures] == [names[1]]
    assert result.failures[0].message == "its worker died"
    assert len(Store(tmp_path).paths()) == len(names) - 1
    missing = result.table["judgment"].isna()
    assert 0 < missing.sum() < len(result.table) / 2
    # The next run tries it again, and forgets the failure.
    result, executor = swept(small_plan(), tmp_path)
    assert executor.did == [names[1]]
    assert result.failures == ()
    assert Store(tmp_path).failures(names) == []
    assert not result.table["judgment"].isna().any()


def test_a_model_that_raises_is_reported_with_its_error(tmp_path, monkeypatch, capsys):
    study, grid = small_study(tmp_path), tmp_path / "small.toml"
    grid.write_text(SMALL)

    def fail(self, *args, **kwargs):
        raise ValueError("no such corner")

    monkeypatch.setattr("pourcast.models.simple.SimpleSim.judge", fail)
    result, _ = swept(small_plan(), study / "sweep")
    message = result.failures[0].message
    assert message.startswith(
        "model 'simple' failed: ValueError: no such corner (test_run.py, line"
    )
    assert result.failures[0].attempts == 3
    assert result.table.loc[result.table["model"] != "simple", "judgment"].notna().all()
    assert cli.run(["sweep", str(study), "--status"]) == 0
    assert (
        "failed 3 times: model 'simple' failed: ValueError: no such corner"
        in capsys.readouterr().out
    )


def test_a_disk_that_spoils_every_file_is_not_written_to_for_ever(tmp_path, monkeypatch, capsys):
    study, grid = small_study(tmp_path), tmp_path / "small.toml"
    grid.write_text(SMALL)

    class Spoiling(Inline):
        def run(self, tasks, heartbeat):
            for result in super().run(tasks, heartbeat):
                path = Store(study / "sweep").path_of(result.task)
                path.write_bytes(path.read_bytes()[:-1])
                yield result

    monkeypatch.setattr(
        "pourcast.sweep.executors.choose.make_executor", lambda *arguments: Spoiling()
    )
    assert cli.run(["sweep", str(study), "--grid", str(grid)]) == 1
    assert "160 judgments are missing" in capsys.readouterr().err
    names = [path.name for path in (study / "judgments").iterdir()]
    assert names == ["small-incomplete.parquet"]
    monkeypatch.undo()
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--workers", "1"]) == 0
    names = [path.name for path in (study / "judgments").iterdir()]
    assert names == ["small.parquet"]


def test_a_part_of_an_array_that_fails_is_told_by_status(tmp_path, monkeypatch):
    def fail(self, *args, **kwargs):
        raise ValueError("no such corner")

    monkeypatch.setattr("pourcast.models.simple.SimpleSim.judge", fail)
    plan, store = small_plan(), Store(tmp_path)
    assert {result.outcome for result in run_part(plan, store, 0, 1)} == {"done", "failed"}
    failures = store.failures(shard.id for shard in plan.shards)
    assert all("no such corner" in failure.message for failure in failures)
    assert failures


def test_a_worker_of_another_version_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("pourcast.sweep.settings.engine_version", lambda: "planner's")
    tasks = [shard_module.task_of(small_plan(), small_plan().shards[0], tmp_path)]
    monkeypatch.setattr("pourcast.sweep.settings.engine_version", lambda: "worker's")
    result = shard_module.run_shard(tasks[0])
    assert result.outcome == "failed"
    assert "another version of pourcast" in result.message


def test_progress_counts_up_to_all(tmp_path):
    seen = []
    swept(small_plan(), tmp_path, report=seen.append)
    last = seen[-1]
    assert (last.shards, last.simulations) == (last.all_shards, last.all_simulations)
    assert last.all_simulations == small_plan().simulations
    assert last.seconds == pytest.approx(last.all_seconds)
    done = [now.simulations for now in seen]
    assert done == sorted(done)


def test_a_part_that_fails_is_told_before_the_next_shard_begins(tmp_path, monkeypatch):
    def fail(self, *args, **kwargs):
        raise ValueError("no such corner")

    monkeypatch.setattr("pourcast.models.simple.SimpleSim.judge", fail)
    plan, store = small_plan(), Store(tmp_path)
    for result in run_part(plan, store, 0, 1):
        if result.outcome == "failed":
            break
    assert [failure.shard for failure in store.failures([result.task])] == [result.task]
    assert len(store.paths()) < len(plan.shards) - 1


# Parts of an array, trajectories -----------------------------------------------------------


@pytest.mark.parametrize("parts", [3, 7])
def test_parts_of_an_array_make_the_whole(tmp_path, parts, reference):
    for part in range(parts):
        assert {r.outcome for r in run_part(small_plan(), Store(tmp_path), part, parts)} == {"done"}
        assert list(run_part(small_plan(), Store(tmp_path), part, parts)) == []
    result, executor = swept(small_plan(), tmp_path)
    assert executor.did == []
    assert result.table.equals(reference)


def test_trajectories_are_the_simulations(tmp_path, reference):
    swept(small_plan(), tmp_path)
    plan = make_plan(small_grid().with_trajectories(), random_scenes(5, seed=31))
    result, executor = swept(plan, tmp_path)
    assert len(executor.did) == len(plan.shards)  # Judgments alone are not enough.
    assert result.table.equals(reference)
    store = Store(tmp_path)
    for shard in plan.shards:
        rows = store.read(store.path_of(shard.id)).to_pandas()
        path = store.trajectory_paths().get(shard.id)
        poured = rows["time"].notna().to_numpy()
        assert (path is not None) == poured.any()
        if path is None:
            continue
        array = read_trajectories(path)
        assert array.attrs["shard"] == shard.id
        assert array.shape[0] == len(rows)
        for k in np.flatnonzero(poured)[:3]:
            frames = np.asarray(array[k])
            count = np.isfinite(frames[:, 0, 0]).sum()
            assert count == round(rows["time"][k] * array.attrs["frame_rate"]) + 1
            scene = plan.scenes[plan.scene_digests.index(rows["scene"][k])]
            ends = frames[count - 1]
            held = [scene.goal.holds(x, y) for x, y, _ in ends[np.isfinite(ends[:, 0])]]
            assert np.mean(held) == rows["judgment"][k]
    # They are part of what is done.
    name, path = next(iter(store.trajectory_paths().items()))
    path.write_bytes(path.read_bytes()[:-1])
    result, executor = swept(plan, tmp_path)
    assert executor.did == [name]
    assert [damage.path for damage in result.damaged] == [path]
    assert len(list(store.trajectories.glob(f"{name}-*"))) == 1
    store.trajectory_paths()[name].unlink()
    result, executor = swept(plan, tmp_path)
    assert executor.did == [name]
    assert [damage.reason for damage in result.damaged] == ["gone"]


def test_trajectories_without_zarr_are_refused_before_anything_runs(tmp_path, monkeypatch, capsys):
    study = small_study(tmp_path)
    monkeypatch.setitem(sys.modules, "zarr", None)
    assert cli.run(["sweep", str(study), "--grid", "quick", "--trajectories"]) == 2
    assert "this needs zarr; install pourcast's extra" in capsys.readouterr().err
    assert [path.name for path in study.iterdir()] == ["scenes.json"]


def test_the_command_line_gathers_a_table(tmp_path, capsys, reference):
    study, grid = small_study(tmp_path), tmp_path / "small.toml"
    grid.write_text(SMALL)
    call = ["sweep", str(study), "--grid", str(grid), "--workers", "2"]
    assert cli.run(call) == 0
    total = small_plan().simulations
    assert f"reused 0 of {total} simulations (0 shards); ran {total}" in capsys.readouterr().out
    path = study / "judgments" / "small.parquet"
    once = path.read_bytes()
    assert pd.read_parquet(path)["judgment"].to_list() == reference["judgment"].to_list()
    assert cli.run(call) == 0
    assert f"reused {total} of {total} simulations" in capsys.readouterr().out
    assert path.read_bytes() == once
    assert cli.run([*call, "--status", "--json"]) == 0
    (status,) = json.loads(capsys.readouterr().out)
    assert status["done_shards"] == status["shards"] == len(small_plan().shards)
    assert status["running"] == 0


def test_a_dry_run_says_how_much_it_is_and_writes_nothing(tmp_path, capsys):
    study, grid = small_study(tmp_path), tmp_path / "small.toml"
    grid.write_text(SMALL)
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--dry-run", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["simulations"] == facts["to_do"] == small_plan().simulations
    assert facts["shards"] == len(small_plan().shards)
    assert 0 < facts["minutes"] < 1
    assert facts["bytes"] > 10_000
    assert sum(part["simulations"] for part in facts["parts"]) == facts["simulations"]
    assert [path.name for path in study.iterdir()] == ["scenes.json"]
    swept(small_plan(), study / "sweep")
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--dry-run"]) == 0
    assert "0 to do, in 0 shards" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no-study", "--grid", "quick"], "no-study: expected a study folder"),
        (["study"], "expected --grid FILE or NAME"),
        (["study", "--grid", "quick", "--shard", "99999"], "shard: expected a number from 0 to"),
        (["study", "--grid", "quick", "--shard", "3/2"], "shard: expected a number"),
        (["study", "--grid", "quick", "--shard", "x"], "shard: expected a number"),
        (["study", "--grid", "quick", "--executor", "dask"], "expected --scheduler ADDRESS"),
        (["study", "--grid", "quick", "--cluster", "no.toml"], "no.toml: cannot be read"),
        (["study", "--grid", "quick", "--cluster", "bad.toml"], "bad.toml: there is no 'slrum'; did you mean 'slurm'"),
        (["study", "--grid", "quick", "--cluster", "flat.toml"], "flat.toml: slurm: expected a table"),
    ],
)  # fmt: skip
def test_a_wrong_call_is_one_line(tmp_path, monkeypatch, capsys, arguments, message):
    small_study(tmp_path)
    (tmp_path / "bad.toml").write_text("[slrum]\n")
    (tmp_path / "flat.toml").write_text("slurm = 1\n")
    monkeypatch.chdir(tmp_path)
    assert cli.run(["sweep", *arguments]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert message in said
