"""Files are written whole or not at all."""

import os
import stat
import threading
import time

import pytest

from pourcast.errors import InputError
from pourcast.files import check_writable, finished_files, replacing, write_text


def test_a_crash_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(RuntimeError), replacing(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_new_files_have_ordinary_permissions(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, "x")
    umask = os.umask(0)
    os.umask(umask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~umask


def test_writing_in_threads_changes_no_other_files_permissions(tmp_path, monkeypatch):
    umask = os.umask

    def slow_umask(mask):
        before = umask(mask)
        time.sleep(0.002)  # the other threads' turn, where it does most harm
        return before

    before = umask(0o027)
    monkeypatch.setattr(os, "umask", slow_umask)
    try:
        writers = [
            threading.Thread(target=_write_often, args=(tmp_path / f"{k}.txt",)) for k in range(4)
        ]
        for writer in writers:
            writer.start()
        count = 0
        while any(writer.is_alive() for writer in writers):
            count += 1
            os.close(os.open(tmp_path / f"other-{count}", os.O_WRONLY | os.O_CREAT, 0o666))
            time.sleep(0.001)
        modes = {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    finally:
        after = umask(before)
    assert count > 0
    assert modes == {0o640}
    assert after == 0o027


def _write_often(path):
    for k in range(10):
        write_text(path, str(k))


def test_what_cannot_be_written_is_refused_at_once(tmp_path):
    (tmp_path / "file").write_text("x")
    for path in (tmp_path, tmp_path / "file" / "below.json"):
        with pytest.raises(InputError, match="cannot be written"):
            check_writable(path)
    check_writable(tmp_path / "fine.json")
    assert os.listdir(tmp_path) == ["file"]


def test_a_file_that_is_being_written_is_not_listed(tmp_path):
    write_text(tmp_path / "b.json", "2")
    with replacing(tmp_path / "a.json") as temporary:
        temporary.write_text("1")
        assert finished_files(tmp_path, "*.json") == [tmp_path / "b.json"]
    assert finished_files(tmp_path, "*.json") == [tmp_path / "a.json", tmp_path / "b.json"]
