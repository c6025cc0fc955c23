"""The one reader of configuration files: TOML to frozen models.

A mistake is named with its file and line, what is wrong, and the nearest valid key.
"""

from __future__ import annotations

import difflib
import re
import tomllib
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from mkdaemon.config.root import Config
from mkdaemon.errors import ConfigError

Place = tuple[str | int, ...]


def load(path: Path | None, overrides: Mapping[str, Any] | None = None) -> Config:
    """Read a configuration file and lay overrides over it.

    Args:
        path: the TOML file; None for defaults only.
        overrides: values by dotted key, for example `{"link.port": "/dev/ttyUSB0"}`, as the command line gives them.

    Raises:
        ConfigError: the file is missing, unreadable, no TOML, or holds a wrong key or value. One line names the file,
            the line, the key, what is wrong and the nearest valid key.
    """
    text = "" if path is None else _read(path)
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        msg = f"{path}: not valid TOML: {error}"
        raise ConfigError(msg) from error
    given = dict(overrides or {})
    for key, value in given.items():
        _put(tree, key.split("."), value)
    try:
        return Config.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(_explain(error, path, text, given)) from error


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*.toml")], n=1)
        hint = f"; did you mean {path.parent / near[0]}?" if near else "; configs/ in the source tree has samples"
        msg = f"{path}: no such configuration file{hint}"
        raise ConfigError(msg) from error
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        msg = f"{path}: cannot be read: {reason}"
        raise ConfigError(msg) from error


def _put(tree: dict[str, Any], keys: list[str], value: Any) -> None:
    *sections, last = keys
    node: Any = tree
    for section in sections:
        node = node.setdefault(section, {})
        if not isinstance(node, dict):
            return  # a scalar stands where a section belongs: validation names it
    node[last] = value


def _explain(error: ValidationError, path: Path | None, text: str, given: Mapping[str, Any]) -> str:
    """One line for the first mistake, unknown keys first, and how many more there are."""
    mistakes = sorted(error.errors(include_url=False), key=lambda mistake: mistake["type"] != "extra_forbidden")
    first = mistakes[0]
    place = first["loc"]
    key = ".".join(str(part) for part in place)
    if key in given:
        where = "command line"
    elif path is None:
        where = "configuration"
    else:
        line = _line_of(text, place)
        where = f"{path}:{line}" if line else str(path)
    more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
    return f"{where}: {key or 'configuration'}: {_what(first)}{more}"


def _what(mistake: ErrorDetails) -> str:
    if mistake["type"] == "extra_forbidden":
        return _unknown_key(mistake["loc"])
    reason = mistake["msg"].removeprefix("Value error, ")
    value = mistake["input"]
    shown = "" if isinstance(value, dict) or mistake["type"] in {"missing", "value_error"} else f", not {value!r}"
    return f"{reason[:1].lower()}{reason[1:]}{shown}"


def _unknown_key(place: Place) -> str:
    name = str(place[-1])
    here = _keys_at(place[:-1])
    elsewhere = [dotted for dotted in _all_keys(Config) if dotted.rpartition(".")[2] == name]
    if elsewhere:
        return f'unknown key here; "{elsewhere[0]}" is where it belongs'
    near = difflib.get_close_matches(name, here, n=1, cutoff=0.5)
    if near:
        return f'unknown key; did you mean "{near[0]}"?'
    return f"unknown key; known here: {', '.join(here)}" if here else "unknown key"


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Every model an annotation may hold."""
    parts = typing.get_args(annotation)
    if not parts and isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in parts:
        yield from _models(inner)


def _keys_at(place: Place) -> list[str]:
    """Valid keys of the section at a place; list indices and union tags are passed over."""
    models: list[type[BaseModel]] = [Config]
    for part in place:
        found = [
            inner
            for model in models
            if isinstance(part, str) and part in model.model_fields
            for inner in _models(model.model_fields[part].annotation)
        ]
        models = found or models
    return sorted({key for model in models for key in model.model_fields})


def _all_keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    for name, info in model.model_fields.items():
        yield prefix + name
        for inner in _models(info.annotation):
            yield from _all_keys(inner, f"{prefix}{name}.")


_HEADER = re.compile(r"^\s*\[\[?\s*([^\]]+?)\s*\]\]?")
_ASSIGNMENT = re.compile(r"^\s*([A-Za-z0-9_\-\".]+)\s*=")


def _line_of(text: str, place: Place) -> int | None:
    """Find the line of a key by reading headers and assignments only.

    Where the key itself does not stand in the text: the nearest section above it, or the first line below it.
    """
    wanted = [str(part) for part in place if isinstance(part, str)]
    found: dict[int, int] = {}
    section: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            here = section = [part.strip().strip('"') for part in header[1].split(".")]
        elif assignment := _ASSIGNMENT.match(line):
            here = section + [part.strip('"') for part in assignment[1].split(".")]
        else:
            continue
        shared = min(len(here), len(wanted))
        if here[:shared] == wanted[:shared]:
            found.setdefault(shared, number)
    return found[max(found)] if found else None
