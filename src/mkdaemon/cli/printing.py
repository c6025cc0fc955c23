"""How values look on a terminal, each on one line, and as JSON lines."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from mkdaemon.cli.terminal import on_one_line


def json_line(value: object) -> str:
    """One value on one line, in ASCII so that no terminal's encoding can harm it; bytes as hexadecimal."""
    return json.dumps(value, default=_plain)


def show(fields: object, words: str, *, as_json: bool) -> None:
    """Print what a command found: one JSON value, or words."""
    print(json_line(fields) if as_json else words)


def _plain(value: object) -> object:
    return value.hex() if isinstance(value, bytes) else str(value)


def picked(value: object, *names: str) -> dict[str, Any]:
    """Some attributes of a value by their names; None each where there is no value."""
    return {name: None if value is None else getattr(value, name) for name in names}


def flat(fields: Mapping[str, Any]) -> str:
    """One value on one line of text: `name=value`, times left out, floats short."""
    skipped = {"stamp", "source", "age"}
    return " ".join(f"{on_one_line(name)}={short(value)}" for name, value in fields.items() if name not in skipped)


def short(value: Any) -> str:
    """A value in few characters."""
    match value:
        case float():
            return f"{value:.8g}"
        case bytes():
            return value.hex()
        case dict():
            return "{" + " ".join(f"{on_one_line(name)}={short(inner)}" for name, inner in value.items()) + "}"
        case list() | tuple():
            return "(" + ", ".join(short(inner) for inner in value) + ")"
        case None:
            return "-"
    return on_one_line(value)


def age_of(fields: Mapping[str, Any]) -> str:
    """How old a value from the bus is, in words."""
    age = fields.get("age")
    return "" if age is None else f"{age:.2f} s ago" if age < 60 else f"{age / 60:.0f} min ago"
