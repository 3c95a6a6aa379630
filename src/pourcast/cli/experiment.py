"""Commands of the experiment with people: serve, status, data."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pourcast.cli.observers import experiment_app
from pourcast.cli.options import JsonOption, StudyArgument
from pourcast.cli.terminal import print_json, print_table, progress_bar, records
from pourcast.errors import InputError

if TYPE_CHECKING:
    from pourcast.experiment.storage.storage import Storage


class DataFormat(StrEnum):
    """Formats that people's data come in."""

    CSV = "csv"
    PSYCH_DS = "psych-ds"


DatabaseOption = Annotated[
    str | None,
    typer.Option(
        metavar="URL", envvar="POURCAST_DATABASE",
        help="Database, such as postgresql://user@host/name [SQLite in the study folder].",
    ),
]  # fmt: skip


@contextmanager
def _storage(study: Path, database: str | None, *, must_exist: bool = True) -> "Iterator[Storage]":
    """A study's database, closed at the end."""
    from pourcast.extras import require_extra
    from pourcast.study.folder import DATABASE, study_scenes

    require_extra("experiment")
    from pourcast.experiment.storage.storage import Storage

    study_scenes(study)
    if must_exist and database is None and not (study / DATABASE).is_file():
        raise InputError(f"{study / DATABASE}: not there; nobody has taken part yet")
    storage = Storage.of_study(study, database)
    try:
        yield storage
    finally:
        storage.close()


@experiment_app.command()
def serve(
    study: StudyArgument,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen to.")] = 8000,
    host: Annotated[
        str, typer.Option(help="Address to listen to; 0.0.0.0 for all in your network.")
    ] = "127.0.0.1",
    public_url: Annotated[
        str, typer.Option(metavar="URL", help="How participants reach it, for the links.")
    ] = "",
    behind_proxy: Annotated[
        bool, typer.Option("--behind-proxy", help="A web server of yours stands before it.")
    ] = False,
    admin: Annotated[
        bool | None,
        typer.Option("--admin/--no-admin", help="The admin page [only on this machine]."),
    ] = None,
    sessions_per_address: Annotated[
        int, typer.Option(min=1, help="Sessions that an address may open in an hour.")
    ] = 200,
    check: Annotated[
        bool, typer.Option("--check", help="Make the stimuli, check everything, and stop.")
    ] = False,
    database: DatabaseOption = None,
) -> None:
    """Run the experiment in people's browsers: prints the links to give away.

    The design is in STUDY/experiment.toml; the first call writes it, with the paper's values.
    Every answer is on the disk before the participant moves on. Ctrl-C ends it; started again, it
    goes on where it was.

    Example: pourcast experiment serve my-study --port 8000
    """
    from pourcast.extras import require_extra

    require_extra("experiment")
    from pourcast.experiment.design.links import links
    from pourcast.experiment.design.settings import NAME
    from pourcast.experiment.server.admin import admin_routes
    from pourcast.experiment.server.app import create_app
    from pourcast.experiment.server.serve import Address, lock_study
    from pourcast.experiment.server.serve import serve as serve_app
    from pourcast.experiment.server.service import Experiment

    address = Address(host, port, public_url, behind_proxy)
    with _storage(study, database, must_exist=False) as storage, lock_study(study):
        with progress_bar() as report:
            experiment = Experiment(
                study, storage, report, sessions_per_address=sessions_per_address
            )
        with_admin = not address.is_public if admin is None else admin
        app = create_app(experiment, extra=admin_routes(experiment) if with_admin else ())
        groups = " | ".join("+".join(group) for group in experiment.design.groups)
        typer.echo(
            f"{study}: {len(experiment.scenes)} scenes, {experiment.design.practice} practice "
            f"trials, groups: {groups}\ndesign: {study / NAME}\n"
            f"stimuli: {experiment.stock.stimuli.folder}\n"
            f"responses: {storage.url.render_as_string()}"
        )

        def ready(base: str) -> None:
            given = links(base, storage.secret)
            if with_admin:
                given["admin"] = f"{base}/admin?token={storage.admin_token}"
            for name, link in given.items():
                typer.echo(f"{name:9}{link}")
            typer.echo("Ctrl-C ends it.")

        try:
            if not check:
                serve_app(app, address, ready)
        except KeyboardInterrupt:
            pass
        finally:
            saved = len(storage.records())
            experiment.close()
    if not check:
        typer.echo(f"stopped; {saved} records are saved")


@experiment_app.command()
def status(
    study: StudyArgument, database: DatabaseOption = None, as_json: JsonOption = False
) -> None:
    """How it goes: who is in, who has left, how long trials take.

    Example: pourcast experiment status my-study
    """
    import math
    import time

    with _storage(study, database) as storage:
        from pourcast.experiment.data.overview import overview
        from pourcast.experiment.design.settings import read_design

        storage.drop_stale(read_design(study).largest_gap, time.time())
        seen = overview(storage)
    if as_json:
        print_json(
            {
                "groups": records(seen.states.reset_index()),
                "judgments": seen.judgments,
                "median_rt": seen.median_rt,
                "kept_aside": seen.kept_aside,
                "scenes": [
                    {"liquid": liquid, "scene": scene, "responses": answers}
                    for (liquid, scene), answers in seen.responses.items()
                ],
            }
        )
        return
    if len(seen.states):
        print_table(seen.states)
    else:
        typer.echo("nobody has come yet")
    seconds = "" if math.isnan(seen.median_rt) else f", {seen.median_rt:.1f} s a test trial"
    typer.echo(f"{seen.judgments} judgments saved{seconds}")
    if seen.kept_aside:
        typer.echo(
            f"{seen.kept_aside} records came under a key that had another one; they are kept aside"
        )


@experiment_app.command()
def data(
    study: StudyArgument,
    out: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder to write [STUDY/data].")
    ] = None,
    form: Annotated[
        DataFormat, typer.Option("--format", help="csv: two tables; psych-ds: a whole dataset.")
    ] = DataFormat.CSV,
    identifiers: Annotated[
        bool,
        typer.Option("--identifiers", help="With the platform's ids, which nobody else may see."),
    ] = False,
    preview: Annotated[
        bool, typer.Option("--preview", help="With those who came by the preview link.")
    ] = False,
    import_files: Annotated[
        list[Path] | None,
        typer.Option("--import", metavar="FILE", help="Take in a participant's or JATOS's file."),
    ] = None,
    withdraw: Annotated[
        str | None,
        typer.Option(metavar="ID", help="Delete a participant everywhere; say what was deleted."),
    ] = None,
    database: DatabaseOption = None,
) -> None:
    """Take the data out: a row a trial and a row a participant, as CSV or as a Psych-DS dataset.

    `pourcast compare` and `pourcast report` read the study's database by themselves.

    Example: pourcast experiment data my-study --format psych-ds -o my-data
    """
    with _storage(study, database, must_exist=not import_files) as storage:
        if import_files:
            _import(study, storage, import_files)
        if withdraw is not None:
            _withdraw(study, storage, withdraw)
        if out is None and (import_files or withdraw is not None):
            return
        _write(study, storage, out or study / "data", form, identifiers, preview)


@experiment_app.command()
def export(
    study: StudyArgument,
    jatos: Annotated[
        Path | None, typer.Option(metavar="FILE.jzip", help="Study archive for JATOS.")
    ] = None,
    static: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for any web host.")
    ] = None,
    datapipe: Annotated[
        str,
        typer.Option(metavar="ID", help="static: DataPipe's id; without it, files by hand."),
    ] = "",
    database: DatabaseOption = None,
) -> None:
    """Write the experiment as files that run without this server: for JATOS, or any web host.

    What is collected there comes back by `pourcast experiment data STUDY --import FILE`.

    Example: pourcast experiment export my-study --jatos my-study.jzip
    """
    if (jatos is None) == (static is None):
        raise InputError("export: expected either --jatos FILE.jzip or --static DIR")
    if datapipe and static is None:
        raise InputError("export: --datapipe goes with --static")
    with _storage(study, database, must_exist=False) as storage, progress_bar() as report:
        from pourcast.experiment.page.export import export_jatos, export_static
        from pourcast.experiment.server.service import prepare_stock

        stock = prepare_stock(study, storage, report)
    if jatos is not None:
        export_jatos(jatos, stock)
        typer.echo(f"{jatos}: import it in JATOS; its results come back by --import")
    if static is not None:
        export_static(static, stock, datapipe=datapipe)
        typer.echo(f"{static}: put it on a web host; index.html is the link")


def _import(study: Path, storage: "Storage", paths: list[Path]) -> None:
    import time

    from pourcast.experiment.data.intake import import_records
    from pourcast.experiment.server.service import prepare_stock
    from pourcast.experiment.storage.journal import Journal

    with progress_bar() as report:
        stock = prepare_stock(study, storage, report)
    journal = Journal.of_study(study)
    for path in paths:
        found = import_records(path, storage, journal, stock.plan, time.time())
        typer.echo(
            f"{path}: {found.sessions} sessions, {found.new} new records, {found.repeated} that "
            f"were there, {found.kept_aside} kept aside"
        )


def _withdraw(study: Path, storage: "Storage", who: str) -> None:
    from pourcast.experiment.data.withdrawal import withdraw
    from pourcast.experiment.storage.journal import Journal

    for line in withdraw(study, storage, Journal.of_study(study), who):
        typer.echo(f"deleted: {line}")
    typer.echo("tables that you wrote elsewhere are as they were; write them again")


def _write(
    study: Path, storage: "Storage", out: Path, form: DataFormat, identifiers: bool, preview: bool
) -> None:
    from pourcast.experiment.data.psych_ds import write_psych_ds
    from pourcast.experiment.data.tables import participants_table, trials_table, write_csv
    from pourcast.experiment.design.settings import read_design

    trials = trials_table(storage, preview=preview)
    people = participants_table(storage, preview=preview, identifiers=identifiers)
    if form is DataFormat.PSYCH_DS:
        written = write_psych_ds(out, study, read_design(study), trials, people)
    else:
        written = [out / "trials.csv", out / "participants.csv"]
        for path, table in zip(written, (trials, people), strict=True):
            write_csv(path, table)
    for path in written:
        typer.echo(str(path))
    typer.echo(f"{len(people)} participants, {len(trials)} judgments")
