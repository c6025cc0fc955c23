"""How a limit is declared: with its value, its unit, its meaning, and where the figure comes from."""

from __future__ import annotations

from dataclasses import field
from typing import Any, Final

FLIGHTS: Final = "tuned on development flights"
STILLS: Final = "tuned on development stills"
BLIND: Final = "tuned on development flights without attitude"
NOISE: Final = "derived from read noise of 1.5 grey"
EARNED: Final = "measured, docs/vision.md"


def of(value: Any, unit: str, meaning: str, source: str) -> Any:
    """Declare a limit; unit, meaning and source can be read from the field's metadata."""
    return field(default=value, metadata={"unit": unit, "meaning": meaning, "source": source})
