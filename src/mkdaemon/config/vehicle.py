"""Which aircraft this daemon speaks for."""

from __future__ import annotations

from pydantic import Field

from mkdaemon.config.base import Section


class VehicleConfig(Section):
    """Identity of the aircraft."""

    name: str = Field(default="mk1", pattern=r"^[a-z0-9][a-z0-9_-]{0,31}$")
    """Name in every key, `mk/<name>/...`: lower-case letters, digits, `-` and `_`."""
    note: str = Field(default="", max_length=200)
    """Free text shown by `mkctl status`, for example airframe and battery."""
