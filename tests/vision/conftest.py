"""What every test of the eyes starts from."""

from __future__ import annotations

import pytest

from tests.vision.views import scene


@pytest.fixture(autouse=True)
def fresh_noise() -> None:
    """No test's images depend on which tests ran before."""
    scene.cache_clear()
