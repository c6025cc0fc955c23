"""Which aircraft this daemon speaks for."""

from __future__ import annotations

from typing import Final

from pydantic import Field

from mkdaemon.config.base import Section

NAME_PATTERN: Final = r"^[a-z0-9][a-z0-9_-]{0,31}$"
"""One chunk of a key, without anything a key expression gives a meaning to."""


class VehicleConfig(Section):
    """Identity of the aircraft."""

    name: str = Field(default="mk1", pattern=NAME_PATTERN)
    """Name in every key, `mk/<name>/...`: lower-case letters, digits, `-` and `_`."""
    note: str = Field(default="", max_length=200)
    """Free text shown by `mkctl status`, for example airframe and battery."""
