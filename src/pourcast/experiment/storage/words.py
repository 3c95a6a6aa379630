"""The secrets of a database: random words that links, codes and names of media are made with."""

import secrets
from collections.abc import Callable, Mapping

import sqlalchemy as sa

from pourcast.experiment.storage.schema import META

NAMES = ("secret", "admin")


def secret_words(
    connection: sa.Connection, former: Callable[[], Mapping[str, str]]
) -> dict[str, str]:
    """The words of a database, by name; a new one gets its former ones, or is made new ones.

    Parameters
    ----------
    connection
        A transaction.
    former
        Called if there are none: those that the study had before its database was lost.
    """
    words = _kept(connection)
    if len(words) < len(NAMES):
        known = {**former(), **words}
        set_words(connection, {name: known.get(name) or secrets.token_hex(16) for name in NAMES})
        words = _kept(connection)
    return words


def set_words(connection: sa.Connection, words: Mapping[str, str]) -> None:
    """Put words in the place of those that the database has."""
    connection.execute(META.delete().where(META.c.name.in_(NAMES)))
    connection.execute(META.insert(), [{"name": name, "value": words[name]} for name in NAMES])


def _kept(connection: sa.Connection) -> dict[str, str]:
    rows = connection.execute(sa.select(META).where(META.c.name.in_(NAMES)))
    return {row.name: row.value for row in rows}
