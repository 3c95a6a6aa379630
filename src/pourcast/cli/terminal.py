"""What the commands print: progress, tables, JSON."""

import json
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from pourcast.cli.interruption import said_if_interrupted
from pourcast.progress import Report, TimeLeft, duration_in_words, waits_for

if TYPE_CHECKING:
    from rich.table import Table

FIRST_BAR = 1.0
"""Work that takes longer shows a bar on a terminal [s] ..."""

FIRST_LINE = 5.0
"""... and prints a line where there is none [s], ..."""

LONGEST_PAUSE = 60.0
"""... then again after twice the time, but after so long at the latest [s]."""

_REDRAWN = 0.25
"""How often the bar is drawn [s]."""

Tell = Callable[[str, float, float], None]
"""Called with words, and how much is done and how much there is, in any unit."""


class InterruptedWorkError(Exception):
    """Ctrl-C in long work that can be gone on with; the message says how far it is."""


@contextmanager
def resumable(folder: Path) -> Iterator[None]:
    """Long work in a folder that the same command goes on with after Ctrl-C; says so."""
    words = f"interrupted: what is done lies in {folder}; the same command goes on from there"
    try:
        with said_if_interrupted(words):
            yield
    except KeyboardInterrupt:
        raise InterruptedWorkError(words) from None


class _Work:
    """How far some work is, in words."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._begin = time.monotonic()
        self._left = TimeLeft()
        self._now: tuple[str, float, float] = "starting", 0.0, 0.0

    def tell(self, words: str, done: float, total: float) -> None:
        """Take in how far it is; called from any thread, as often as anybody likes."""
        with self._lock:
            self._now = words, done, total
            self._left.see(time.monotonic(), done, total)

    def line(self) -> tuple[str, float, float]:
        """One line, and how much is done and how much there is."""
        with self._lock:
            (words, done, total), now = self._now, time.monotonic()
            words += f" ({waiting})" if (waiting := waits_for()) else ""
            left = self._left.seconds(now)
        if left is None:
            return f"{words}, {duration_in_words(now - self._begin)} so far", done, total
        return f"{words}, {duration_in_words(left)} left", done, total


@contextmanager
def told_on_stderr() -> Iterator[Tell]:
    """Progress of long work on stderr: a bar, or a line now and then where there is no terminal.

    A thread writes it, so that it goes on while a long piece of work has nothing to tell. Short
    work writes nothing, and waits for nothing.
    """
    work, ended = _Work(), threading.Event()
    terminal = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    write = _draw_bar if terminal else _print_lines
    thread = threading.Thread(target=write, args=(work, ended), daemon=True)
    thread.start()
    try:
        yield work.tell
    finally:
        ended.set()
        thread.join()


def _print_lines(work: _Work, ended: threading.Event) -> None:
    pause = FIRST_LINE
    while not ended.wait(pause):
        try:
            typer.echo(work.line()[0], err=True)
        except (OSError, ValueError):  # nobody reads it: no reason to end the work
            return
        pause = min(2 * pause, LONGEST_PAUSE)


def _draw_bar(work: _Work, ended: threading.Event) -> None:
    if ended.wait(FIRST_BAR):
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task("", total=None)
        while True:
            line, done, total = work.line()
            bar.update(task, description=line, completed=done, total=total or None)
            bar.refresh()
            if ended.wait(_REDRAWN):
                return


@contextmanager
def progress_bar() -> Iterator[Report]:
    """Progress of work that is counted; see `told_on_stderr`."""
    with told_on_stderr() as tell:
        yield lambda what, done, total: tell(f"{what}: {done} of {total}", done, total)


def print_table(frame: Any, *, decimals: int = 2) -> None:
    """Print a small table of pandas, its index first."""
    labels = {str(frame.index.name or ""): frame.index.tolist()}
    values = {str(name): frame[name].tolist() for name in frame.columns}
    print_columns(labels | values, decimals=decimals)


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a small table from its rows, all with the same names of columns."""
    print_columns({name: [row[name] for row in rows] for name in rows[0]})


def print_columns(columns: Mapping[str, Sequence[Any]], *, decimals: int = 2) -> None:
    """Print a small table with rich from its columns, of which the first names the rows.

    One that is too wide for the terminal is printed part by part, as rich would break numbers.
    """
    from rich.console import Console

    console = Console(markup=False, emoji=False)  # A unit such as [m2/s] is no markup.
    (name, labels), *others = (
        (name, [_cell(value, decimals) for value in values]) for name, values in columns.items()
    )
    first = _Column(name, labels, numeric=False)
    parts: list[list[_Column]] = [[first]]
    for name, cells in others:
        numeric = {type(value) for value in columns[name]} <= {int, float}
        column = _Column(name, cells, numeric)
        part = [*parts[-1], column]
        too_wide = sum(one.least + _GAP for one in part) - _GAP > console.width
        if too_wide and len(parts[-1]) > 1:
            parts.append([first, column])
        else:
            parts[-1] = part
    for number, part in enumerate(parts):
        if number:
            console.print()
        console.print(_rich_table(part))


_GAP = 2
"""Between columns, in characters."""

_LONGEST_WORD = 20
"""Longer words may be broken."""


class _Column(NamedTuple):
    """A column of a printed table."""

    name: str
    cells: list[str]
    numeric: bool

    @property
    def least(self) -> int:
        """Width that breaks no number, and no word but a long one."""
        words = [word for text in (self.name, *self.cells) for word in text.split()]
        numbers = self.cells if self.numeric else []
        longest = min(max(map(len, words), default=1), _LONGEST_WORD)
        return max(longest, *map(len, numbers), 1)


def _cell(value: Any, decimals: int) -> str:
    text = f"{value:.{decimals}f}" if isinstance(value, float) else str(value)
    return "-" if text == "nan" else text


def _rich_table(part: Sequence[_Column]) -> "Table":
    from rich.table import Table

    first, *others = part
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column(first.name)
    for column in others:
        least = column.least if column.numeric else None
        table.add_column(
            column.name, justify="right" if column.numeric else "left", overflow="fold",
            min_width=least,
        )  # fmt: skip
    for cells in zip(*(column.cells for column in part), strict=True):
        table.add_row(*cells)
    return table


def print_json(content: Any) -> None:
    """Print JSON, numbers that are none as null."""
    import math

    def clean(value: Any) -> Any:
        if isinstance(value, dict):
            return {str(k): clean(v) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [clean(v) for v in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    typer.echo(json.dumps(clean(content), indent=2))


def records(table: Any) -> Any:
    """A table as a list of rows, for `print_json`."""
    return json.loads(table.to_json(orient="records"))
