"""Where things lie in the source tree; campaigns run from a checkout."""

from __future__ import annotations

from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
"""The checkout."""
CONFIGS: Final = ROOT / "configs"
"""Sample configurations, targets and cameras."""
CAPTURES: Final = ROOT / "tests" / "data" / "captures"
"""Recorded traffic of genuine boards."""
REFERENCE: Final = ROOT.parent / "shared"
"""Reference material beside the checkout; may be absent."""
