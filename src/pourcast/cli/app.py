"""The application that the commands are added to."""

import typer

app = typer.Typer(
    name="pourcast",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="How do people think this liquid will flow? Start with: pourcast demo",
)
