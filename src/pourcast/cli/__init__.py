"""The command line: parse, call the library, print.

Exit codes: 0 done; 1 the work failed; 2 the input or the call is wrong.
Errors are one line on stderr.
"""

import os
import signal
import sys

import typer

from pourcast.cli import models, scenes, sweep
from pourcast.cli.app import app
from pourcast.errors import InputError, StoreError

__all__ = ["main", "models", "run", "scenes", "sweep"]


def main() -> None:
    """Run the command line; the entry point of `pourcast`."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run a command, print errors as one line, and return the exit code."""
    try:
        result = typer.main.get_command(app).main(
            arguments or ["--help"], prog_name="pourcast", standalone_mode=False
        )
    except (InputError, StoreError) as error:
        return _complain(str(error), 2 if isinstance(error, InputError) else 1)
    except (KeyboardInterrupt, typer.Abort) as error:
        return _complain(str(error) or "interrupted", 128 + signal.SIGINT)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except typer.TyperException as error:
        return _complain(error.format_message(), 2)
    except Exception as error:
        if os.environ.get("POURCAST_TRACEBACK"):
            raise
        hint = "set POURCAST_TRACEBACK=1 to see where"
        return _complain(f"{type(error).__name__}: {error} ({hint})", 1)
    return result if isinstance(result, int) else 0


def _complain(message: str, code: int) -> int:
    typer.echo(f"pourcast: {' '.join(message.split())}", err=True)
    return code
