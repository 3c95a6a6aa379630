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
from pourcast.experiment.storage.schema import META, SCHEMA, TABLES

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
    if "key" not in {column["name"] for column in sa.inspect(connection).get_columns("sessions")}:
        operations.add_column("sessions", sa.Column("key", sa.Text))
        for number in connection.scalars(sa.text("SELECT id FROM sessions")).all():
            connection.execute(
                sa.text("UPDATE sessions SET key = :key WHERE id = :number"),
                {"key": secrets.token_hex(16), "number": number},
            )
        with operations.batch_alter_table("sessions") as sessions:
            sessions.alter_column("key", nullable=False)
            sessions.create_unique_constraint("sessions_key_key", ["key"])
    if connection.dialect.name == "sqlite":
        _count_on(operations, connection)


def _count_on(operations: "Operations", connection: sa.Connection) -> None:
    """Let SQLite never give out a session's number again, not even those of deleted ones."""
    has_counters = sa.inspect(connection).has_table("sqlite_sequence")
    last = "SELECT seq FROM sqlite_sequence WHERE name = 'sessions'"
    reached = connection.scalar(sa.text(last)) if has_counters else None
    with operations.batch_alter_table(
        "sessions", recreate="always", table_kwargs={"sqlite_autoincrement": True}
    ):
        pass
    if reached is not None:
        connection.execute(sa.text("DELETE FROM sqlite_sequence WHERE name = 'sessions'"))
        connection.execute(
            sa.text("INSERT INTO sqlite_sequence (name, seq) VALUES ('sessions', :seq)"),
            {"seq": reached},
        )


_STEPS: dict[int, Callable[["Operations", sa.Connection], None]] = {1: _name_sessions}
"""What brings a version's tables to the next one's."""
