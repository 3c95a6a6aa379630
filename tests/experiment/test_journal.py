"""The second copy: complete after crashes, and never the reason that something is lost."""

import json
import os

from pourcast.experiment.storage import journal as journal_module
from pourcast.experiment.storage.journal import Journal
from pourcast.experiment.storage.records import Record


def records(*numbers, session=1):
    return [Record(session, seq, "judgment", f'{{"response":0.{seq}}}', 5.0) for seq in numbers]


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


def test_removing_takes_out_one_session_alone(tmp_path):
    journal = Journal.of_study(tmp_path)
    journal.append([*records(0, 1), *records(0, session=2)])
    assert journal.remove(lambda line: line["session"] == 1) == 2
    assert [json.loads(line)["session"] for line in journal.path.read_text().splitlines()] == [2]
