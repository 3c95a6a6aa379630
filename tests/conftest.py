"""Fixtures shared by all tests."""

import pytest

from pourcast.scenes.scene import Scene
from tests.make import ramp_scene


@pytest.fixture
def ramp() -> Scene:
    return ramp_scene()
