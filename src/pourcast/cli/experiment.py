"""Commands of the experiment with people: serve, status, data."""

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, closing
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pourcast.cli.observers import experiment_app
from pourcast.cli.options import JsonOption, StudyArgument
from pourcast.cli.terminal import print_json, print_table, progress_bar
from pourcast.errors import InputError, StoreError

if TYPE_CHECKING:
    from pourcast.experiment.design.steps import Schedule
    from pourcast.experiment.storage.storage import Storage


class DataFormat(StrEnum):
    """Formats that people's data come in."""

    CSV = "csv"
    PSYCH_DS = "psych-ds"


def _tell_of_password(
    context: typer.Context, parameter: typer.CallbackParam, url: str | None
) -> str | None:
    """Say that a password on the command line can be read by others."""
    source = context.get_parameter_source(parameter.name or "")
    if url is None or source is None or source.name != "COMMANDLINE":
        return url
    from pourcast.extras import require_extra

    require_extra("experiment")
    from pourcast.experiment.storage.database import has_password

    if has_password(url):
        typer.echo(
            "note: others on this computer can read the password in the list of processes; put "
            "the URL into the variable POURCAST_DATABASE, or the password into ~/.pgpass",
            err=True,
        )
    return url


DatabaseOption = Annotated[
    str | None,
    typer.Option(
        metavar="URL", envvar="POURCAST_DATABASE", callback=_tell_of_password,
        help="Database, such as postgresql://user@host/name [SQLite in the study folder].",
    ),
]  # fmt: skip


def _storage(
    study: Path, database: str | None, *, must_exist: bool = True
) -> "AbstractContextManager[Storage]":
    """A study's database; says first which extra it needs."""
    from pourcast.extras import require_extra

    require_extra("experiment")
    from pourcast.experiment.storage.storage import study_storage

    return study_storage(study, database, must_exist=must_exist)


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
        bool,
        typer.Option(
            "--behind-proxy", help="A web server of yours stands before it; as --proxy-hops 1."
        ),
    ] = False,
    proxy_hops: Annotated[
        int | None,
        typer.Option(min=0, help="How many web servers of yours stand one before the other."),
    ] = None,
    trusted_proxy: Annotated[
        list[str] | None,
        typer.Option(metavar="NETWORK", help="Where they are [this machine]; may be repeated."),
    ] = None,
    admin: Annotated[
        bool | None,
        typer.Option("--admin/--no-admin", help="The admin page [only on this machine]."),
    ] = None,
    sessions_per_address: Annotated[
        int, typer.Option(min=1, help="Sessions that an address may open in an hour.")
    ] = 200,
    allowed_ids: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Ids of Prolific or MTurk to let in, one a line [all]."),
    ] = None,
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
    from pourcast.experiment.design.links import read_ids
    from pourcast.experiment.design.services import prolific_settings
    from pourcast.experiment.design.settings import NAME
    from pourcast.experiment.server.addresses import Proxies
    from pourcast.experiment.server.process import Address, ExperimentServer

    def print_links(links: Mapping[str, str]) -> None:
        for name, link in links.items():
            typer.echo(f"{name:9}{link}")
        typer.echo("Ctrl-C ends it.")

    networks = tuple(trusted_proxy or ())
    hops = int(behind_proxy or bool(networks)) if proxy_hops is None else proxy_hops
    address = Address(host, port, public_url, Proxies(hops, networks))
    ids = None if allowed_ids is None else read_ids(allowed_ids)
    with _storage(study, database, must_exist=False) as storage:
        with progress_bar() as report:
            server = ExperimentServer(
                study, storage, address, admin=admin, sessions_per_address=sessions_per_address,
                allowed_ids=ids, report=report,
            )  # fmt: skip
        with closing(server):
            experiment = server.experiment
            groups = " | ".join("+".join(group) for group in experiment.design.groups)
            typer.echo(
                f"{study}: {len(experiment.scenes)} scenes, {experiment.design.practice} practice "
                f"trials, groups: {groups}\ndesign: {study / NAME}\n"
                f"stimuli: {experiment.materials.stimuli.folder}\n"
                f"responses: {storage.shown_url}"
            )
            if check:
                _say(prolific_settings(experiment.design.recruiting, f"{address.base(port)}/"))
                return
            server.run(print_links)
            saved = len(storage.records())
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
        from pourcast.experiment.data.overview import study_overview

        seen = study_overview(study, storage, time.time())
    if as_json:
        print_json(seen.for_json())
        return
    if len(seen.states):
        print_table(seen.states)
    else:
        typer.echo("nobody has come yet")
    seconds = "" if math.isnan(seen.median_rt) else f", {seen.median_rt:.1f} s a test trial"
    typer.echo(f"{seen.judgments} judgments saved{seconds}")
    for warning in seen.warnings:
        typer.echo(warning)


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
    remarks: Annotated[
        bool, typer.Option("--remarks", help="psych-ds: with what participants wrote at the end.")
    ] = False,
    preview: Annotated[
        bool, typer.Option("--preview", help="With those who came by the preview link.")
    ] = False,
    import_files: Annotated[
        list[Path] | None,
        typer.Option(
            "--import",
            metavar="FILE",
            help="Take in answers: a participant's file, JATOS's or DataPipe's archive or folder, "
            "STUDY/responses.jsonl if the database is lost.",
        ),
    ] = None,
    withdraw: Annotated[
        str | None,
        typer.Option(
            metavar="ID",
            help="Delete a participant in all of STUDY; say what was deleted, and what is left.",
        ),
    ] = None,
    database: DatabaseOption = None,
) -> None:
    """Take the data out: a row a trial and a row a participant, as CSV or as a Psych-DS dataset.

    `pourcast compare` and `pourcast report` read the study's database by themselves.

    Example: pourcast experiment data my-study --format psych-ds -o my-data
    """
    if withdraw is not None and _database_is_lost(study, database):
        _withdraw(study, None, withdraw)
        return
    with _storage(study, database, must_exist=not import_files) as storage:
        left_out = _import(study, storage, import_files) if import_files else 0
        if withdraw is not None:
            _withdraw(study, storage, withdraw)
        if out is not None or not (import_files or withdraw is not None):
            from pourcast.experiment.data.dataset import write_data

            written = write_data(
                out or study / "data", study, storage, form.value, identifiers=identifiers,
                remarks=remarks, preview=preview,
            )  # fmt: skip
            for path in written.paths:
                typer.echo(str(path))
            typer.echo(f"{written.participants} participants, {written.judgments} judgments")
    if left_out:
        raise StoreError(f"{left_out} lines were left out, as said above; the others are taken in")


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
        from pourcast.experiment.design.materials import prepare_materials
        from pourcast.experiment.design.services import (
            datapipe_settings,
            jatos_settings,
            prolific_settings,
        )
        from pourcast.experiment.page.export import export_jatos, export_static

        materials = prepare_materials(study, storage.secret, report)
    recruiting = materials.design.recruiting
    if jatos is not None:
        export_jatos(jatos, materials)
        typer.echo(f"{jatos}: import it in JATOS; its results come back by --import")
        _say(prolific_settings(recruiting, "STUDY-LINK"))
        _say(jatos_settings())
    if static is not None:
        export_static(static, materials, datapipe=datapipe)
        typer.echo(f"{static}: put it on a web host; index.html is the link")
        _say(prolific_settings(recruiting, "https://YOUR-HOST/index.html"))
        if datapipe:
            _say(datapipe_settings(datapipe))


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)


def _import(study: Path, storage: "Storage", paths: list[Path]) -> int:
    """Take in files of answers; returns how many lines were left out."""
    import time

    from pourcast.experiment.data.record_import import import_records, restore
    from pourcast.experiment.design.links import UNFILLED
    from pourcast.experiment.storage.journal import Journal

    journal = Journal.of_study(study, storage.states)
    schedule = _schedule(study, storage)
    left_out = 0
    if not any(path.resolve() == journal.path.resolve() for path in paths):
        # A file may be of a session that the study's own journal alone knows.
        restored = restore(storage, journal, schedule, time.time())
        if restored.opened:
            typer.echo(f"{journal.path}: {restored.opened} sessions are restored")
    known = {session.key for session in storage.sessions()}
    for path in paths:
        summary = import_records(path, storage, journal, schedule, time.time())
        for message in summary.messages:
            typer.echo(message, err=True)
        typer.echo(
            f"{path}: {summary.sessions} sessions ({summary.opened} of them new), {summary.new} "
            f"new records, {summary.repeated} that were there, {summary.conflicts} kept aside"
            + ("" if summary.changes else "; nothing has changed")
        )
        left_out += summary.left_out
    for session in storage.sessions():
        if session.key not in known and UNFILLED in session.identifiers:
            names = session.identifiers[UNFILLED]
            typer.echo(
                f"{session.participant}: came by a link in which nobody had filled in {names}; "
                "is an anonymous participant of their own"
            )
    return left_out


def _schedule(study: Path, storage: "Storage") -> "Schedule":
    """The study's schedule; its materials are made ready when it is first asked."""
    from functools import cache

    from pourcast.experiment.design.materials import Materials, prepare_materials

    @cache
    def materials() -> Materials:
        with progress_bar() as report:
            return prepare_materials(study, storage.secret, report)

    return lambda group, place: materials().steps(group, place)


def _database_is_lost(study: Path, database: str | None) -> bool:
    """Whether a study has a journal, and no database."""
    from pourcast.experiment.storage.journal import NAME
    from pourcast.study.folder import DATABASE, study_scenes

    study_scenes(study)
    return database is None and not (study / DATABASE).exists() and (study / NAME).exists()


def _withdraw(study: Path, storage: "Storage | None", who: str) -> None:
    from pourcast.comparison.compare import TABLES
    from pourcast.experiment.data.withdrawal import withdraw
    from pourcast.experiment.storage.journal import Journal

    done = withdraw(study, storage, Journal.of_study(study), who, tables=TABLES)
    for line in done.deleted:
        typer.echo(f"deleted: {line}")
    for line in done.notes:
        typer.echo(f"note: {line}")
    typer.echo(
        "outside of the study folder (backups, copies, JATOS, DataPipe and the OSF, the recruiting "
        f"platform) look for: {', '.join(done.person.to_look_for)}"
    )
    for line in done.left:
        typer.echo(f"left: {line}")
    if done.left:
        raise StoreError(
            f"withdraw: not all could be cleaned ({len(done.left)} named above); clean or delete "
            "the rest by hand, and say the same command again"
        )
