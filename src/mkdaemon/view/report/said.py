"""Checked values of a recording from any source: finite numbers and short texts."""

from __future__ import annotations

from typing import Any, Final

from pydantic import ValidationError

from mkdaemon.reading import key_spec

LARGEST: Final = 1e12
"""A number beyond it is none of ours."""
_NUMBERS: Final = frozenset({float, int})
"""Types of numbers, as a payload has them; what is not a number is in no range."""
LONGEST: Final = 400
"""Of a text that is shown [characters]; ours have up to 250."""


def value_of(suffix: str, fields: Any) -> object | None:
    """The value of a key; None where it is none, as of another version or in a damaged file."""
    spec = key_spec(suffix)
    try:
        return None if spec is None or spec.carries is None else spec.carries.model_validate(fields)
    except ValidationError:
        return None


def part_of(fields: Any, path: str) -> Any:
    """A part of a value, `echo.p50_ms` or `position.0`; None where it has none."""
    for name in path.split("."):
        if isinstance(fields, dict):
            fields = fields.get(name)
        elif isinstance(fields, list) and name.isdigit() and int(name) < len(fields):
            fields = fields[int(name)]
        else:
            return None
    return fields


def number_of(fields: Any, path: str) -> float | None:
    """A part that is a finite number of a likely size; else None."""
    return next(iter(numbers_of(fields, path, 1)), None)


def numbers_of(fields: Any, path: str, count: int) -> list[float]:
    """A part that is a number, for a count of 1, or the first ones of a list of at least as many; else none."""
    found = part_of(fields, path)
    parts = [found] if count == 1 else found[:count] if isinstance(found, list) else []
    numbers = [float(one) for one in parts if type(one) in _NUMBERS and -LARGEST < one < LARGEST]
    return numbers if len(numbers) == count else []


def text_of(fields: Any, path: str) -> str:
    """A part as a short text; empty where there is none."""
    found = part_of(fields, path)
    return "" if found is None else short(found)


def short(found: Any) -> str:
    """Anything as a text that is not too long."""
    text = found if isinstance(found, str) else f"{found!r:.{LONGEST + 1}}"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} ..."
