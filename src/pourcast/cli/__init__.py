"""The command line: parse, call the library, print.

Exit codes: 0 done; 1 the work failed; 2 the input or the call is wrong.
Errors are one line on stderr; of a table of responses all are told, a line each.
"""

import os
import sys

import typer

from pourcast.cli import (
    compare,
    convnet,
    experiment,
    mixture,
    models,
    multiverse,
    observers,
    recovery,
    scenes,
    stimuli,
    sweep,
)
from pourcast.cli.app import app
from pourcast.cli.interruption import INTERRUPTED, end_interrupted, watch_for_interruptions
from pourcast.cli.terminal import InterruptedWorkError
from pourcast.errors import (
    ClusterError,
    InputError,
    ManyFaultsError,
    ModelError,
    SimulationDivergedError,
    StoreError,
    TrainingError,
)

__all__ = [
    "compare",
    "convnet",
    "experiment",
    "main",
    "mixture",
    "models",
    "multiverse",
    "observers",
    "recovery",
    "run",
    "scenes",
    "stimuli",
    "sweep",
]

_FAILURES = (ClusterError, ModelError, SimulationDivergedError, StoreError, TrainingError)
"""Errors whose message is one line that says what failed."""


def main() -> None:
    """Run the command line; the entry point of `pourcast`."""
    watch_for_interruptions()
    code = run(sys.argv[1:])
    if code == INTERRUPTED:
        end_interrupted()
    sys.exit(code)


def run(arguments: list[str]) -> int:
    """Run a command, print errors as a line each, and return the exit code."""
    try:
        result = typer.main.get_command(app).main(
            arguments or ["--help"], prog_name="pourcast", standalone_mode=False
        )
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except ManyFaultsError as error:
        return [_complain(line, 2) for line in error.lines][-1]
    except (Exception, KeyboardInterrupt) as error:
        return _complain(*_verdict(error))
    if result == INTERRUPTED:  # Typer takes Ctrl-C for an exit code.
        return _complain("interrupted", INTERRUPTED)
    return result if isinstance(result, int) else 0


def _verdict(error: BaseException) -> tuple[str, int]:
    """What to say of an error, and the exit code."""
    if isinstance(error, InputError):
        return str(error), 2
    if isinstance(error, typer.TyperException):
        return error.format_message(), 2
    if isinstance(error, InterruptedWorkError | KeyboardInterrupt | typer.Abort):
        return str(error) or "interrupted", INTERRUPTED
    if isinstance(error, _FAILURES):
        return str(error), 1
    if os.environ.get("POURCAST_TRACEBACK"):
        raise error
    hint = "set POURCAST_TRACEBACK=1 to see where"
    return f"{type(error).__name__}: {error} ({hint})", 1


def _complain(message: str, code: int) -> int:
    typer.echo(f"pourcast: {' '.join(message.split())}", err=True)
    return code
