"""A pad at rest, and one that flies."""

from __future__ import annotations

import pytest

from tests.client.teleop.pads import TestedPad


@pytest.fixture
def pad() -> TestedPad:
    return TestedPad()


@pytest.fixture
def flown(pad: TestedPad) -> TestedPad:
    pad.fly()
    return pad
