"""Databases that an older pourcast made, brought to the tables of this one.

The steps are written with Alembic's operations, which know how a table is rebuilt in SQLite, as it
can't change one. Alembic's environment of a folder of scripts isn't used: a study's database has no
project around it, and the version stands beside its other words.
"""

import secrets
from collections.abc import Callable
from typing import TYPE_CHECKING

import sqlalchemy as sa

from pourcast.errors import InputError
from pourcast.experiment.storage.schema import BROWSERS, META, REFUSALS, SCHEMA, TABLES

if TYPE_CHECKING:
    from alembic.operations import Operations

_VERSION = "schema"
"""Name of the schema's version among the words of a database."""


def schema_version(connection: sa.Connection, name: str) -> int | None:
    """The version of a database's tables; None if it has none yet.

    Raises
    ------
    InputError
        If a newer pourcast made them.
    """
    if not sa.inspect(connection).has_table("sessions"):
        return None
    text = connection.scalar(sa.select(META.c.value).where(META.c.name == _VERSION))
    version = 1 if text is None else int(text)
    if version > SCHEMA:
        raise InputError(
            f"{name}: a newer pourcast made it (schema {version}, and this one knows {SCHEMA}); "
            "update pourcast: pip install -U pourcast"
        )
    return version


def make_tables(connection: sa.Connection) -> None:
    """The tables of a new database."""
    TABLES.create_all(connection)
    connection.execute(META.insert().values(name=_VERSION, value=str(SCHEMA)))


def migrate(connection: sa.Connection, version: int) -> None:
    """Bring tables of an older version to ours, in the transaction that is open.

    SQLite must not look after foreign keys in it: tables are put in the place of others.
    """
    from alembic.migration import MigrationContext  # noqa: PLC0415 - seldom needed, slow to import
    from alembic.operations import Operations  # noqa: PLC0415

    operations = Operations(MigrationContext.configure(connection))
    for older in range(version, SCHEMA):
        _STEPS[older](operations, connection)
    connection.execute(META.delete().where(META.c.name == _VERSION))
    connection.execute(META.insert().values(name=_VERSION, value=str(SCHEMA)))


def _name_sessions(operations: "Operations", connection: sa.Connection) -> None:
    """From 1 to 2: every session has a key, and no number is given out twice."""
    reached = _last_number(connection)
    columns = {column["name"] for column in sa.inspect(connection).get_columns("sessions")}
    if "key" not in columns:
        operations.add_column("sessions", sa.Column("key", sa.Text))
        for number in connection.scalars(sa.text("SELECT id FROM sessions")).all():
            connection.execute(
                sa.text("UPDATE sessions SET key = :key WHERE id = :number"),
                {"key": secrets.token_hex(16), "number": number},
            )
    # SQLite counts on only in a table that was made so.
    with operations.batch_alter_table(
        "sessions",
        recreate="always" if connection.dialect.name == "sqlite" else "never",
        table_kwargs={"sqlite_autoincrement": True},
    ) as sessions:
        if "key" not in columns:
            sessions.alter_column("key", nullable=False)
            sessions.create_unique_constraint("sessions_key_key", ["key"])
    if reached is not None:
        for statement in (
            "DELETE FROM sqlite_sequence WHERE name = 'sessions'",
            "INSERT INTO sqlite_sequence (name, seq) VALUES ('sessions', :seq)",
        ):
            connection.execute(sa.text(statement), {"seq": reached})


def _last_number(connection: sa.Connection) -> int | None:
    """The last number that SQLite gave to a session, be it deleted; None where nothing counts."""
    if connection.dialect.name != "sqlite":
        return None
    counters = "SELECT count(*) FROM sqlite_master WHERE name = 'sqlite_sequence'"
    if not connection.scalar(sa.text(counters)):
        return None
    last = "SELECT seq FROM sqlite_sequence WHERE name = 'sessions'"
    number = connection.scalar(sa.text(last))
    return None if number is None else int(number)


def _count_visits(_: "Operations", connection: sa.Connection) -> None:
    """From 2 to 3: it is noted who took turns with a session, and who was refused."""
    for table in (BROWSERS, REFUSALS):
        table.create(connection)


_STEPS: dict[int, Callable[["Operations", sa.Connection], None]] = {
    1: _name_sessions,
    2: _count_visits,
}
"""What brings a version's tables to the next one's."""
