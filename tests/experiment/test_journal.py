"""The second copy: complete after crashes, and never the reason that something is lost."""

import json
import os

import pytest
from filelock import FileLock

from pourcast.errors import StoreError
from pourcast.experiment.storage import journal as journal_module
from pourcast.experiment.storage.journal import Journal


def records(*numbers, session="one"):
    return [
        {"session": session, "seq": seq, "kind": "judgment", "body": {"response": seq / 10}}
        for seq in numbers
    ]


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that can be filled and freed."""

    class Disk:
        error = None

        def write(self, handle, content, really=os.write):
            if self.error is not None:
                raise self.error
            return really(handle, content)

        def fill(self):
            self.error = OSError(28, "No space left on device")

        def free(self):
            self.error = None

    disk = Disk()
    monkeypatch.setattr(journal_module.os, "write", disk.write)
    return disk


def test_a_line_each_in_the_order_in_which_they_came(tmp_path):
    journal = Journal.of_study(tmp_path)
    journal.append(records(2, 0))
    journal.append(records(1))
    assert [line["seq"] for line in journal.lines()] == [2, 0, 1]
    assert next(journal.lines())["body"] == {"response": 0.2}


def test_what_a_crash_cut_short_is_written_again(tmp_path):
    journal = Journal.of_study(tmp_path)
    journal.append(records(0, 1))
    whole = journal.path.read_bytes()
    journal.path.write_bytes(whole[:-9])
    again = Journal.of_study(tmp_path)
    assert again.catch_up(records(0, 1, 2)) == 2
    assert [line["seq"] for line in again.lines()] == [0, 1, 2]
    assert again.catch_up(records(0, 1, 2)) == 0


def test_a_full_disk_delays_lines_and_leaves_no_half_of_one(tmp_path, monkeypatch):
    journal = Journal.of_study(tmp_path)
    journal.append(records(0))
    before = journal.path.read_bytes()
    really = os.write

    def write_some(handle, content):
        really(handle, content[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(journal_module.os, "write", write_some)
    journal.append(records(1))
    assert journal.path.read_bytes() == before
    monkeypatch.setattr(journal_module.os, "write", really)
    journal.append(records(2))
    assert [line["seq"] for line in journal.lines()] == [0, 1, 2]


def test_failures_are_counted_and_logged_once_of_a_kind(tmp_path, full_disk, caplog):
    journal = Journal.of_study(tmp_path)
    full_disk.fill()
    for k in range(3):
        journal.append(records(k))
    full_disk.error = OSError(5, "Input/output error")
    journal.append(records(3))
    assert journal.waiting == 4
    assert journal.failures.count == 4
    assert journal.failures.current == f"{journal.path}: cannot be written (Input/output error)"
    consequence = "new records are in the database alone until it can be"
    assert [record.message for record in caplog.records] == [
        f"{journal.path}: cannot be written (No space left on device); {consequence}",
        f"{journal.path}: cannot be written (Input/output error); {consequence}",
    ]
    full_disk.free()
    journal.retry()
    assert (journal.waiting, journal.failures.current) == (0, "")
    assert "works again (failures so far: 4)" in caplog.records[-1].message
    assert [line["seq"] for line in journal.lines()] == [0, 1, 2, 3]
    # The next time is told of again.
    full_disk.fill()
    journal.append(records(4))
    assert len(caplog.records) == 4


def test_a_journal_that_another_process_holds_delays_nobody_for_ever(tmp_path, monkeypatch):
    monkeypatch.setattr(journal_module, "_LONGEST_WAIT", 0.05)
    journal = Journal.of_study(tmp_path)
    with FileLock(tmp_path / "responses.lock"):
        journal.append(records(0))
        assert journal.waiting == 1
        assert "could not be acquired" in journal.failures.current
    journal.retry()
    assert [line["seq"] for line in journal.lines()] == [0]


def test_what_waits_is_taken_out_too(tmp_path, full_disk):
    journal = Journal.of_study(tmp_path)
    journal.append(records(0))
    full_disk.fill()
    journal.append([*records(1), *records(0, session="two"), *records(0, session="three")])
    assert journal.remove(["one"]) == 2
    journal.keep_waiting_of({"one", "three"})
    full_disk.free()
    journal.retry()
    assert [(line["session"], line["seq"]) for line in journal.lines()] == [("three", 0)]


def test_a_line_of_who_was_deleted_in_the_meantime_is_not_appended(tmp_path):
    there = {"one", "two"}
    journal = Journal.of_study(tmp_path, lambda: there)
    journal.append([*records(0, session="one"), *records(0, session="two")])
    there.remove("one")
    journal.append([*records(1, session="one"), *records(1, session="two")])
    assert journal.catch_up([*records(2, session="one"), *records(2, session="two")]) == 2
    assert [(line["session"], line["seq"]) for line in journal.lines()] == [
        ("one", 0), ("two", 0), ("two", 1), ("two", 2),
    ]  # fmt: skip


def test_lines_that_cannot_be_taken_out_are_told_of_and_stay(tmp_path, monkeypatch):
    journal = Journal.of_study(tmp_path)
    journal.append(records(0))

    def full(path, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    with pytest.raises(StoreError, match=r"responses.jsonl: lines cannot be taken out \(No space"):
        journal.remove(["one"])
    assert [line["seq"] for line in journal.lines()] == [0]


def test_a_journal_that_cannot_be_read_is_told_of_in_a_line(tmp_path):
    (tmp_path / "responses.jsonl").mkdir()
    with pytest.raises(StoreError, match=r"responses.jsonl: cannot be read \(Is a directory\)"):
        Journal.of_study(tmp_path).catch_up(records(0))


@pytest.mark.parametrize("damage", ["{", "[1]", "3", '{"session":"one"}', "\x00\x00"])
def test_damaged_lines_are_passed_over_and_told_of(tmp_path, caplog, damage):
    journal = Journal.of_study(tmp_path)
    journal.append(records(0))
    with journal.path.open("a") as stream:
        stream.write(damage)
    assert journal.catch_up(records(0, 1)) == 1
    assert [line["seq"] for line in journal.lines()] == [0, 1]
    assert "1 lines can't be read" in caplog.text


def test_removing_takes_out_one_session_alone(tmp_path):
    journal = Journal.of_study(tmp_path)
    journal.append([*records(0, 1), *records(0, session="two")])
    assert journal.remove(["one"]) == 2
    assert [json.loads(line)["session"] for line in journal.path.read_text().splitlines()] == [
        "two"
    ]
