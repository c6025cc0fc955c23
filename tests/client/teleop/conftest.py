"""A pad at rest, and one that flies."""

from __future__ import annotations

import pytest

from tests.client.teleop.pads import TestedPad, flown_pad

pad = pytest.fixture(lambda: TestedPad(), name="pad")
flown = pytest.fixture(lambda: flown_pad(), name="flown")
