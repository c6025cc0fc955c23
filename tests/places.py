"""Where things lie in the source tree; what campaigns know too is theirs."""

from __future__ import annotations

from typing import Final

from lab.places import CAPTURES, CONFIGS, REFERENCE, ROOT

__all__ = ["CAPTURES", "CONFIGS", "DATA", "DOCS", "REFERENCE", "ROOT", "SIMULATOR", "SOURCE"]

SOURCE: Final = ROOT / "src" / "mkdaemon"
SIMULATOR: Final = ROOT / "src" / "mksim"
DOCS: Final = ROOT / "docs"
DATA: Final = ROOT / "tests" / "data"
"""Recorded bytes, pictures and expected values kept with the tests."""
