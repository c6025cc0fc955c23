"""Patterns of valid names."""

from __future__ import annotations

import re
from typing import Final

from mkdaemon.errors import ConfigError

VEHICLE_NAME: Final = r"^[a-z0-9][a-z0-9_-]{0,31}$"
"""One chunk of a key, without anything a key expression gives a meaning to."""


def require_vehicle_name(name: str, option: str) -> None:
    """Make sure that a name can be a vehicle's.

    Args:
        name: what was given.
        option: where.

    Raises:
        ConfigError: it cannot.
    """
    if re.fullmatch(VEHICLE_NAME, name) is None:
        raise ConfigError(f"{option} {name!r}: a name has lower-case letters, digits, - and _")
