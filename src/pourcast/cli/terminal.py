"""What the commands print: progress, tables, JSON."""

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

LOG_EVERY = 60.0
"""Where there is no terminal, a line of progress is printed as often [s]."""


class InterruptedWorkError(Exception):
    """Ctrl-C in long work that can be gone on with; the message says how far it is."""


@contextmanager
def resumable(folder: Path) -> Iterator[None]:
    """Long work in a folder that the same command goes on with after Ctrl-C; says so."""
    try:
        yield
    except KeyboardInterrupt:
        raise InterruptedWorkError(
            f"interrupted: what is done lies in {folder}; the same command goes on from there"
        ) from None


def line_now_and_then(bar: Any) -> Callable[[str], None]:
    """What prints a line on stderr where there is no terminal for a bar, each `LOG_EVERY`."""
    said = time.monotonic()

    def say(line: str) -> None:
        nonlocal said
        if bar.disable and time.monotonic() - said > LOG_EVERY:
            said = time.monotonic()
            typer.echo(line, err=True)

    return say


@contextmanager
def bar_on_stderr(*columns: Any) -> Iterator[Any]:
    """A rich progress bar on stderr; `disable` is set on it if that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        yield bar


@contextmanager
def progress_bar() -> Iterator[Any]:
    """Progress on stderr: a bar, or a line a minute where there is no terminal.

    Yields report(what, done, all).
    """
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), Remaining())
    with bar_on_stderr(*columns) as bar:
        task = bar.add_task("starting", total=None)
        say = line_now_and_then(bar)

        def report(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total)
            say(f"{what}: {done} of {total}")

        yield report


def print_table(frame: Any, *, decimals: int = 2) -> None:
    """Print a small table of pandas, its index first."""
    labels = {str(frame.index.name or ""): frame.index.tolist()}
    values = {str(name): frame[name].tolist() for name in frame.columns}
    print_columns(labels | values, decimals=decimals)


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print a small table from its rows, all with the same names of columns."""
    print_columns({name: [row[name] for row in rows] for name in rows[0]})


def print_columns(columns: Mapping[str, Sequence[Any]], *, decimals: int = 2) -> None:
    """Print a small table with rich from its columns, of which the first names the rows."""
    from rich.console import Console
    from rich.table import Table

    first, *others = columns
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column(first)
    for name in others:
        numeric = {type(value) for value in columns[name]} <= {int, float}
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for label, *row in zip(*columns.values(), strict=True):
        cells = [f"{v:.{decimals}f}" if isinstance(v, float) else str(v) for v in row]
        table.add_row(str(label), *("-" if cell == "nan" else cell for cell in cells))
    # A unit such as [m2/s] is no markup.
    Console(markup=False, emoji=False).print(table)


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
