"""Packages that only some work needs."""

import importlib
import importlib.util
from typing import Any

from pourcast.errors import InputError

EXTRAS = {
    "bayes": ("numpyro", "arviz_stats"),
    "stimuli": ("pysplashsurf",),
    "experiment": ("sqlalchemy", "psutil", "starlette", "uvicorn", "httptools"),
}
"""Modules of the extras that are needed as a whole."""


def require_extra(extra: str) -> None:
    """Refuse to go on without an extra; nothing is imported yet.

    Raises
    ------
    InputError
        If a module of it is not installed.
    """
    for name in EXTRAS[extra]:
        if importlib.util.find_spec(name) is None:
            raise _missing(name, extra)


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
        raise _missing(name.partition(".")[0], extra) from None


def _missing(package: str, extra: str) -> InputError:
    return InputError(
        f"this needs {package}; install pourcast's extra: pip install '.[{extra}]' in a clone, "
        f"or 'pourcast[{extra}]'"
    )
