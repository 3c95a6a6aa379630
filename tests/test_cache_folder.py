"""What is kept in the user's cache folder is the same as made anew, and nothing depends on it."""

import subprocess
import sys

import numpy as np
import pytest

from pourcast.engine import cache_folder
from pourcast.engine.packing import unit_cylinder_packing


@pytest.fixture
def folder(monkeypatch, tmp_path):
    monkeypatch.setattr(cache_folder, "cache_folder", lambda: tmp_path)
    unit_cylinder_packing.cache_clear()
    yield tmp_path
    unit_cylinder_packing.cache_clear()


def test_an_array_is_made_once(folder):
    made = []

    def make():
        made.append(1)
        return np.arange(6.0).reshape(2, 3)

    for _ in range(3):
        found = cache_folder.kept_array("numbers", make)
        np.testing.assert_array_equal(found, [[0, 1, 2], [3, 4, 5]])
        assert not found.flags.writeable
    assert len(made) == 1
    assert len(list(folder.iterdir())) == 1


@pytest.mark.parametrize("fault", ["empty", "cut", "changed", "folder"])
def test_what_is_damaged_is_made_anew(folder, fault):
    path = folder / "numbers.npy"
    cache_folder.kept_array("numbers", lambda: np.arange(50.0))
    content = path.read_bytes()
    path.unlink()
    if fault == "folder":
        path.mkdir()
    else:
        path.write_bytes({"empty": b"", "cut": content[:-9], "changed": content[:-1] + b"?"}[fault])
    again = cache_folder.kept_array("numbers", lambda: np.arange(50.0))
    np.testing.assert_array_equal(again, np.arange(50.0))


def test_where_nothing_can_be_written_all_is_made_anew(monkeypatch, tmp_path):
    monkeypatch.setattr(cache_folder, "cache_folder", lambda: tmp_path / "gone")
    found = cache_folder.kept_array("numbers", lambda: np.arange(3.0))
    np.testing.assert_array_equal(found, [0, 1, 2])


def test_nothing_is_left_of_an_array_that_cannot_be_kept(folder, monkeypatch):
    def full(*_names):
        raise OSError("no space left")

    monkeypatch.setattr(cache_folder.os, "replace", full)
    cache_folder.kept_array("numbers", lambda: np.arange(3.0))
    assert list(folder.iterdir()) == []


def test_a_kept_packing_has_the_bits_of_a_new_one(folder):
    new = unit_cylinder_packing(20, 2.0).tobytes()
    unit_cylinder_packing.cache_clear()
    assert len(list(folder.iterdir())) == 1
    assert unit_cylinder_packing(20, 2.0).tobytes() == new


def test_several_processes_may_keep_the_same_at_once(tmp_path):
    code = (
        "from pathlib import Path; import numpy as np; from pourcast.engine import cache_folder\n"
        f"cache_folder.cache_folder = lambda: Path({str(tmp_path)!r})\n"
        "print(cache_folder.kept_array('big', lambda: np.arange(1e5)).sum())"
    )
    runs = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    assert {run.communicate(timeout=60)[0] for run in runs} == {"4999950000.0\n"}
    assert [path.name for path in tmp_path.iterdir()] == ["big.npy"]
