"""A fake daemon and a client of it."""

from __future__ import annotations

import pytest

from tests.client import fake


@pytest.fixture
async def _both():
    async with fake.connected() as both:
        yield both


@pytest.fixture
def daemon(_both):
    return _both[0]


@pytest.fixture
def uav(_both):
    return _both[1]
