"""Patterns of valid names."""

from __future__ import annotations

from typing import Final

VEHICLE_NAME: Final = r"^[a-z0-9][a-z0-9_-]{0,31}$"
"""One chunk of a key, without anything a key expression gives a meaning to."""
