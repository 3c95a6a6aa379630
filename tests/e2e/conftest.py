"""What tests in real browsers share."""

import pytest

from pourcast.observers.browser import chromium


@pytest.fixture(scope="module")
def browser():
    with chromium() as opened:
        yield opened
