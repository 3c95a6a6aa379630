"""Long work says how far it is and how long it will take."""

import sys

import pytest

from pourcast.cli import terminal
from pourcast.progress import TimeLeft, meanwhile


def left_after(*seen, total=100):
    """Seconds left by (time, done) pairs, at the time of the last."""
    left = TimeLeft()
    for now, done in seen:
        left.see(now, done, total)
    return left.seconds(seen[-1][0])


def test_the_time_left_goes_by_the_rate_that_is_measured():
    assert left_after((0, 0), (10, 20)) == pytest.approx(40)
    assert left_after(*((t, 2 * t) for t in range(31))) == pytest.approx(20)
    assert left_after((0, 0), (10, 100)) == 0


def test_time_in_which_nothing_gets_done_counts():
    left = TimeLeft()
    left.see(0, 0, 100)
    left.see(10, 50, 100)
    assert left.seconds(20) == pytest.approx(20)


def test_a_slow_start_is_forgotten():
    # A minute for the first piece, in which kernels were compiled; one a second since.
    seen = [(0, 0), (60, 1), *((60 + t, 1 + t) for t in range(1, 70))]
    assert left_after(*seen) == pytest.approx(30, rel=0.1)


def test_what_was_done_before_is_not_counted():
    assert left_after((0, 80), (10, 90)) == pytest.approx(10)


def test_work_that_begins_anew_is_measured_anew():
    left = TimeLeft()
    for now, done, total in ((0, 0, 10), (10, 10, 10), (10, 0, 10)):
        left.see(now, done, total)
    assert left.seconds(15) is None
    left.see(30, 5, 10)
    assert left.seconds(30) == pytest.approx(20)
    left.see(31, 6, 99)
    assert left.seconds(40) is None


def test_no_time_is_told_before_there_is_a_rate():
    assert TimeLeft().seconds(100) is None
    assert left_after((0, 0), (100, 0)) is None
    assert left_after((0, 0), (0.5, 1)) is None


def test_a_burst_counts_as_seen_at_once():
    left = TimeLeft()
    for k in range(100_000):
        left.see(k * 1e-5, k, 200_000)
    assert len(left._seen) < 10
    assert left.seconds(1.0) == pytest.approx(1.0, rel=0.01)


class Ended:
    """An event that is waited for some times before it is set."""

    def __init__(self, times):
        self.times, self.pauses = times, []

    def wait(self, pause):
        self.pauses.append(pause)
        return len(self.pauses) > self.times


def test_without_a_terminal_lines_come_early_and_then_every_minute(capsys):
    work, ended = terminal._Work(), Ended(6)
    work.tell("judging: 3 of 12", 3, 12)
    terminal._print_lines(work, ended)
    assert ended.pauses == [5, 10, 20, 40, 60, 60, 60]
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines() == ["judging: 3 of 12, 0 s so far"] * 6


def test_a_line_says_how_long_it_will_take(monkeypatch):
    clock = iter((0.0, 1.0, 11.0, 21.0))
    monkeypatch.setattr(terminal.time, "monotonic", lambda: next(clock))
    work = terminal._Work()
    work.tell("judging: 0 of 12", 0, 12)
    work.tell("judging: 3 of 12", 3, 12)
    assert work.line() == ("judging: 3 of 12, 60 s left", 3, 12)


def test_short_work_says_nothing(capsys):
    with terminal.progress_bar() as report:
        report("judging", 3, 12)
    assert capsys.readouterr() == ("", "")


def test_work_goes_on_if_nobody_reads_its_progress(monkeypatch):
    class Broken:
        def write(self, text):
            raise BrokenPipeError

        flush = write

    monkeypatch.setattr(sys, "stderr", Broken())
    ended = Ended(3)
    terminal._print_lines(terminal._Work(), ended)
    assert len(ended.pauses) == 1


def test_what_work_waits_for_is_said_while_it_does():
    work = terminal._Work()
    work.tell("judging: 0 of 12", 0, 12)
    with meanwhile("compiling"):
        assert work.line()[0].startswith("judging: 0 of 12 (compiling), ")
    assert "(" not in work.line()[0]
