"""The store: what is written stays, what is damaged is found, what can't be written is said."""

import hashlib
import multiprocessing
import os
import subprocess

import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pourcast import cli
from pourcast.errors import InputError, StoreError
from pourcast.sweep.shard import run_shard, task_of
from pourcast.sweep.store import SCHEMA, Failure, Store
from tests.sweep.make import Inline, small_plan, small_study, swept


@pytest.fixture(scope="module")
def plan():
    return small_plan()


@pytest.fixture(scope="module")
def whole(plan, tmp_path_factory):
    """A finished store, its table, and the files' content."""
    folder = tmp_path_factory.mktemp("store")
    result, _ = swept(plan, folder)
    files = {path: path.read_bytes() for path in Store(folder).paths().values()}
    return folder, result.table, files


@pytest.fixture
def store(whole):
    """The finished store; mended afterwards."""
    folder, _, files = whole
    yield Store(folder)
    for path in Store(folder).paths().values():
        path.unlink()
    for path, content in files.items():
        path.write_bytes(content)


def damage_and_repair(plan, store, spoil, whole):
    """Spoil a shard's file, sweep again; what is reported, and what was done."""
    _, table, files = whole
    path = store.path_of(plan.shards[2].id)
    spoil(path)
    result, executor = swept(plan, store.folder)
    assert [damage.path for damage in result.damaged] == [path]
    assert executor.did == [plan.shards[2].id]
    assert result.table.equals(table)
    assert path.read_bytes() == files[path]
    return str(result.damaged[0])


def test_a_truncated_file_is_found_and_done_again(plan, store, whole):
    said = damage_and_repair(plan, store, lambda path: os.truncate(path, 300), whole)
    assert "its checksum is wrong" in said


def test_an_emptied_file_is_found_and_done_again(plan, store, whole):
    assert "damaged (empty)" in damage_and_repair(
        plan, store, lambda path: os.truncate(path, 0), whole
    )


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_any_flipped_bit_is_found_and_done_again(plan, store, whole, data):
    def flip(path):
        content = bytearray(path.read_bytes())
        bit = data.draw(st.integers(0, 8 * len(content) - 1))
        content[bit // 8] ^= 1 << bit % 8
        path.write_bytes(content)

    damage_and_repair(plan, store, flip, whole)


def test_damage_is_told_by_status_which_changes_nothing(tmp_path, capsys):
    study = small_study(tmp_path)
    grid = tmp_path / "small.toml"
    grid.write_text(small_plan().grid.text)
    swept(small_plan(), study / "sweep")
    path = next(iter(Store(study / "sweep").paths().values()))
    os.truncate(path, 10)
    assert cli.run(["sweep", str(study), "--status"]) == 0
    assert f"{path}: damaged" in capsys.readouterr().out
    assert path.stat().st_size == 10
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--workers", "1"]) == 0
    assert f"{path}: damaged (its checksum is wrong); removed, and done again" in (
        capsys.readouterr().out
    )


def test_files_are_ordinary_parquet_named_by_their_content(plan, store):
    path = store.path_of(plan.shards[0].id)
    shard, _, checksum = path.stem.partition("-")
    assert checksum == hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    table = pq.read_table(path)
    assert table.schema.equals(SCHEMA)
    assert shard == plan.shards[0].id
    everything = pq.read_table(store.shards).to_pandas()
    assert everything["judgment"].between(0, 1).all()


def test_a_file_cut_off_while_it_was_written_is_removed(plan, store):
    half = store.path_of(plan.shards[0].id).parent / f".{plan.shards[0].id}-abc.parquet"
    half.write_bytes(b"half")
    swept(plan, store.folder)
    assert not half.exists()


def _hold(folder, shard, taken, leave):
    with Store(folder).locked(shard) as mine:
        taken.put(mine)
        leave.wait(30)


def test_a_shard_is_locked_to_one_process_and_freed_when_that_dies(tmp_path):
    context = multiprocessing.get_context("spawn")
    taken, leave, store = context.Queue(), context.Event(), Store(tmp_path)
    holder = context.Process(target=_hold, args=(tmp_path, "abc", taken, leave))
    holder.start()
    assert taken.get(timeout=30)
    with store.locked("abc") as mine:
        assert not mine
    with store.locked("other") as mine:
        assert mine
    assert store.locks_held() == ["abc"]
    holder.kill()
    holder.join()
    assert store.locks_held() == []
    with store.locked("abc") as mine:
        assert mine
    assert list((tmp_path / "locks").iterdir()) == []


def test_where_there_are_no_locks_work_goes_on(plan, tmp_path, monkeypatch):
    def refuse(self, *args, **kwargs):
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr("pourcast.sweep.store.FileLock.acquire", refuse)
    assert run_shard(task_of(plan, plan.shards[0], tmp_path)).outcome == "done"


def test_a_shard_that_somebody_is_at_is_left_to_them(plan, tmp_path):
    with Store(tmp_path).locked(plan.shards[0].id):
        assert run_shard(task_of(plan, plan.shards[0], tmp_path)).outcome == "busy"


def test_failures_are_kept_until_they_are_mended(plan, tmp_path):
    store, shard = Store(tmp_path), plan.shards[0]
    failure = Failure(shard.id, 3, "it broke")
    store.keep_failure(failure)
    assert store.failures([shard.id]) == [failure]
    assert store.failures(["other"]) == []
    run_shard(task_of(plan, shard, tmp_path))
    assert store.failures([shard.id]) == []


# Disks ---------------------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("no right to mount a file system here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def test_a_full_disk_is_said_and_what_was_done_stays(small_disk, capsys, tmp_path):
    study, grid = small_study(small_disk), tmp_path / "small.toml"
    grid.write_text(small_plan().grid.text)
    call = ["sweep", str(study), "--grid", str(grid), "--workers", "1"]
    (small_disk / "ballast").write_bytes(bytes(900_000))
    assert cli.run(call) == 1
    said = capsys.readouterr().err
    assert said.count("pourcast: ") == 1  # beside progress, on a slow machine
    assert said.splitlines()[-1].startswith("pourcast: ")
    assert "No space left on device" in said
    store = Store(study / "sweep")
    kept = store.paths()
    assert 0 < len(kept) < len(small_plan().shards)
    assert store.damaged(kept) == []
    assert not list(store.shards.glob("*/.*"))
    (small_disk / "ballast").unlink()
    assert cli.run([*call, "--json"]) == 0
    assert f'"reused_shards": {len(kept)}' in capsys.readouterr().out


def test_a_read_only_store_is_said_before_anything_runs(small_disk, capsys, tmp_path):
    study, grid = small_study(small_disk), tmp_path / "small.toml"
    grid.write_text(small_plan().grid.text)
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--workers", "1"]) == 2
    said = capsys.readouterr().err
    assert said.count("pourcast: ") == 1  # beside progress, on a slow machine
    assert said.splitlines()[-1].startswith("pourcast: ")
    assert "cannot be written (Read-only file system)" in said
    assert cli.run(["sweep", str(study), "--grid", str(grid), "--status"]) == 0


def test_a_store_that_becomes_read_only_stops_the_sweep(small_disk, tmp_path):
    plan, store = small_plan(), Store(small_disk / "sweep")

    class Remounting(Inline):
        def run(self, tasks, heartbeat):
            for count, result in enumerate(super().run(tasks, heartbeat)):
                yield result
                if count == 2:
                    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)

    executor = Remounting()
    with pytest.raises(StoreError, match="Read-only file system"):
        swept(plan, store.folder, executor)
    assert len(store.paths()) == 3
    assert len(executor.did) == 4


def test_a_vanished_scene_file_is_said_and_what_was_done_stays(tmp_path, capsys):
    study, grid = small_study(tmp_path), tmp_path / "small.toml"
    grid.write_text(small_plan().grid.text)
    swept(small_plan(), study / "sweep")
    kept = Store(study / "sweep").paths()
    (study / "scenes.json").rename(tmp_path / "gone.json")
    assert cli.run(["sweep", str(study), "--grid", str(grid)]) == 2
    assert "scenes.json: cannot be read" in capsys.readouterr().err
    assert Store(study / "sweep").paths() == kept


def test_a_store_in_the_way_of_a_file_is_refused(tmp_path):
    (tmp_path / "sweep").write_text("a file")
    with pytest.raises(InputError, match="cannot be written"):
        Store(tmp_path / "sweep").prepare()
