"""The secrets of a database: random words that links, codes and names of media are made with."""

import re
import secrets
from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa

from pourcast.experiment.storage.schema import META

NAMES = ("secret", "admin")


def made_words(connection: sa.Connection, former: Mapping[str, Any]) -> dict[str, str]:
    """Give a new database its words, and return them by name.

    Parameters
    ----------
    connection
        A transaction that writes.
    former
        Those that the study had before its database was lost; the others are made up.
    """
    known = {**_whole(former), **kept_words(connection)}
    words = {name: known.get(name) or secrets.token_hex(16) for name in NAMES}
    set_words(connection, words)
    return words


def set_words(connection: sa.Connection, words: Mapping[str, Any]) -> None:
    """Put words in the place of those that the database has; what is no such word is left alone."""
    for name, word in _whole(words).items():
        connection.execute(META.delete().where(META.c.name == name))
        connection.execute(META.insert().values(name=name, value=word))


def _whole(words: Mapping[str, Any]) -> dict[str, str]:
    """Those of some words that are such as these, whatever else a file has."""
    return {
        name: str(words[name])
        for name in NAMES
        if re.fullmatch("(?:[0-9a-f]{2}){8,64}", str(words.get(name)))
    }


def kept_words(connection: sa.Connection) -> dict[str, str]:
    """The words that a database has, by name."""
    rows = connection.execute(sa.select(META).where(META.c.name.in_(NAMES)))
    return {row.name: row.value for row in rows}
