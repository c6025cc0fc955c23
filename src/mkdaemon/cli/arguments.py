"""Arguments that many commands take. What a number may be is a part of its type, and checked before a command runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated

from cyclopts import Parameter

AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON, one object a line, instead of text.")]
"""Option of programs for programs; where figures are measured, the object is the last line."""


def fitting(fits: Callable[[float], bool], words: str) -> Parameter:
    """Refuse numbers that do not fit; an option that was not given fits.

    Args:
        fits: whether a number does.
        words: what to give instead.
    """

    def check(_: object, value: float | None) -> None:
        if value is not None and not fits(value):
            raise ValueError(words)

    return Parameter(validator=check)


Finite = Annotated[float, fitting(math.isfinite, "give a number")]
Length = Annotated[float, fitting(lambda value: 0.0 < value < math.inf, "give a number above 0")]
"""A length of time, a distance, a rate: above 0."""
Count = Annotated[int, fitting(lambda value: value >= 1, "give 1 or more")]
Port = Annotated[int, fitting(lambda value: 0 <= value <= 65535, "give one from 1 to 65535, or 0 for any that is free")]
