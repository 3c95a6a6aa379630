"""Failures that a researcher must know of: counted, and logged when they begin and end."""

import logging

LOGGER = logging.getLogger("pourcast.experiment")
"""What the server says while it runs; on stderr, unless logging is set up otherwise."""


class Failures:
    """Failures of one thing that may come right again, such as a disk that is full.

    Parameters
    ----------
    consequence
        What they mean, in a few words; logged with each.
    """

    def __init__(self, consequence: str) -> None:
        self._consequence = consequence
        self._logged: set[str] = set()
        self.count = 0
        """How many there were."""
        self.current = ""
        """The last one; empty when the thing works, or works again."""

    def add(self, failure: str) -> None:
        """Count a failure; one of its kind is logged until the thing works again."""
        self.count += 1
        self.current = failure
        if failure not in self._logged:
            self._logged.add(failure)
            LOGGER.error("%s; %s", failure, self._consequence)

    def end(self) -> None:
        """Say that the thing works."""
        if self.current:
            LOGGER.warning("works again (failures so far: %s): %s", self.count, self.current)
        self.current = ""
        self._logged.clear()
