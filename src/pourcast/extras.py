"""Packages that only some work needs."""

import importlib
from typing import Any

from pourcast.errors import InputError


def optional_module(name: str, extra: str) -> Any:
    """Import a module of one of pourcast's extras.

    Parameters
    ----------
    name
        The module.
    extra
        The extra that installs it.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        package = name.partition(".")[0]
        raise InputError(
            f"this needs {package}; install pourcast's extra: pip install '.[{extra}]' in a clone, "
            f"or 'pourcast[{extra}]'"
        ) from None
