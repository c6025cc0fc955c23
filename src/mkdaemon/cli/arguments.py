"""Arguments that many commands take, and their checks."""

from __future__ import annotations

import math
from typing import Annotated

from cyclopts import Parameter

from mkdaemon.errors import ConfigError

AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON, one object a line, instead of text.")]
"""Option of programs for programs; where figures are measured, the object is the last line."""


def require_length(seconds: float | None, name: str) -> None:
    """Make sure that an argument is a length of time, or was not given.

    Args:
        seconds: what was given [s].
        name: the option.

    Raises:
        ConfigError: it is zero, negative, infinite or no number.
    """
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0.0):
        raise ConfigError(f"{name} {seconds:g}: give a number above 0")


def require_count(count: int | None, name: str) -> None:
    """Make sure that an argument is a number of things, or was not given.

    Raises:
        ConfigError: it is below 1.
    """
    if count is not None and count < 1:
        raise ConfigError(f"{name} {count}: give 1 or more")
