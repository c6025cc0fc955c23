"""Fixtures every test may use."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference material beside the checkout; tests that want it skip where it is absent."""
    if not (SHARED / "README.md").is_file():
        pytest.skip("reference material (../shared) is not beside this checkout")
    return SHARED


@pytest.fixture(scope="session")
def fixtures() -> Path:
    """Recorded bytes and expected values kept with the tests."""
    return ROOT / "tests" / "data"
