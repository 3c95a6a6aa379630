"""The secrets of a database: random words that links, codes and names of media are made with."""

import re
import secrets
from collections.abc import Callable, Mapping
from typing import Any

import sqlalchemy as sa

from pourcast.experiment.storage.schema import META

NAMES = ("secret", "admin")


def secret_words(
    connection: sa.Connection, former: Callable[[], Mapping[str, Any]]
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
        made = {name: secrets.token_hex(16) for name in NAMES}
        set_words(connection, made | _whole(former()) | words)
        words = _kept(connection)
    return words


def set_words(connection: sa.Connection, words: Mapping[str, Any]) -> None:
    """Put words in the place of those that the database has; what is no such word is left alone."""
    for name, word in _whole(words).items():
        connection.execute(META.delete().where(META.c.name == name))
        connection.execute(META.insert().values(name=name, value=word))


def _whole(words: Mapping[str, Any]) -> dict[str, str]:
    return {
        name: str(words[name])
        for name in NAMES
        if re.fullmatch("(?:[0-9a-f]{2}){8,64}", str(words.get(name)))
    }


def _kept(connection: sa.Connection) -> dict[str, str]:
    rows = connection.execute(sa.select(META).where(META.c.name.in_(NAMES)))
    return {row.name: row.value for row in rows}
