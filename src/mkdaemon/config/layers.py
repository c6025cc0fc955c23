"""A configuration in layers: defaults, file, environment, command line; and where each value comes from."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from pydantic import BaseModel

from mkdaemon.config.keys import ConfigKey, keys_of, section_model
from mkdaemon.config.mistakes import line_of
from mkdaemon.config.reader import COMMAND_LINE, read_file, validated
from mkdaemon.config.root import Config, DaemonSections
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import parse_toml

PREFIX: Final = "MKDAEMON_"
"""Of variables of the environment that are keys: `MKDAEMON_LINK__PORT` is `link.port`."""
_DOT: Final = "__"
CLIENTS: Final = "MK_VEHICLE"
"""The name that clients use for the vehicle; without a file it is the daemon's, too."""
DEFAULT: Final = "default"


class Layered(NamedTuple):
    """A configuration, and where it comes from.

    Attributes:
        cfg: all of it.
        origins: where each key that is no default was set, by dotted key: `command line`, `environment NAME`,
            `FILE:LINE`.
    """

    cfg: Config
    origins: Mapping[str, str]

    def origin(self, dotted: str) -> str:
        """Source of a key's value."""
        return self.origins.get(dotted, DEFAULT)


class Value(NamedTuple):
    """One value of a configuration.

    Attributes:
        section: where it stands; of a list of tables with its number, `cameras.0`.
        name: the key.
        value: what it is; None where it is unset.
        origin: where it comes from.
    """

    section: str
    name: str
    value: Any
    origin: str


def load_layers(
    path: Path | None,
    options: Mapping[str, Any],
    environment: Mapping[str, str],
    whole: type[DaemonSections] | None = None,
) -> Layered:
    """Read a configuration file, and lay the environment and the command line over it.

    Args:
        path: the TOML file; None for none.
        options: values of the command line, by dotted key.
        environment: of the process.
        whole: a model of more sections than the daemon reads; the mistakes in all of them come together.

    Raises:
        ConfigError: a file, key or value is wrong; one line names where it was given, the key, what is wrong and the
            nearest valid key.
    """
    text = "" if path is None else read_file(path)
    named = dict(_from_environment(environment))
    if path is None and environment.get(CLIENTS):
        named.setdefault("vehicle.name", (CLIENTS, environment[CLIENTS]))
    given = {key: value for key, (_, value) in named.items()} | dict(options)
    origins = {key: f"environment {name}" for key, (name, _) in named.items()} | dict.fromkeys(options, COMMAND_LINE)
    if whole is not None:
        validated(whole, path, text, given, origins)
    cfg = validated(Config, path, text, given, origins)
    in_file = {key: f"{path}:{line_of(text, place)}" for key, place in _leaves(parse_toml(text), Config)}
    return Layered(cfg, in_file | origins)


def values_of(layered: Layered) -> Iterator[Value]:
    """Every value of a configuration, section by section, as the file would have it."""
    for name in DaemonSections.model_fields:
        yield from _values(name, getattr(layered.cfg, name), layered)


def find_key(dotted: str, known: Iterable[ConfigKey] | None = None) -> ConfigKey:
    """The key of a name.

    Args:
        dotted: section and key, or the key alone where one section has it.
        known: the keys to look in; None for those that the daemon reads.

    Raises:
        ConfigError: there is none; names the nearest.
    """
    keys = {key.dotted: key for key in (keys_of(DaemonSections) if known is None else known)}
    if dotted in keys:
        return keys[dotted]
    alone = [key for key in keys.values() if key.name == dotted]
    if len(alone) == 1:
        return alone[0]
    near = [key.dotted for key in alone] or difflib.get_close_matches(dotted, keys, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else "`mkdaemon config explain` lists all"
    msg = f"{dotted}: no such key; {hint}"
    raise ConfigError(msg)


def _from_environment(environment: Mapping[str, str]) -> Iterator[tuple[str, tuple[str, Any]]]:
    """Keys of the environment, each with the name of its variable and its value."""
    for name, text in sorted(environment.items()):
        if name.startswith(PREFIX):
            dotted = name.removeprefix(PREFIX).lower().replace(_DOT, ".")
            try:
                key = find_key(dotted)
            except ConfigError as error:
                msg = f"environment {name}: {error}"
                raise ConfigError(msg) from error
            if key.dotted != dotted or key.section.startswith(("cameras", "positions")):
                msg = f"environment {name}: {dotted} is no single key; write it into the file"
                raise ConfigError(msg)
            yield dotted, (name, _value_in(text, key))


def _value_in(text: str, key: ConfigKey) -> Any:
    """A value as the environment has it: texts and paths without quotes, all else as in a file."""
    if key.kind in ("text", "path"):
        return text
    try:
        tree = parse_toml(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return tree["value"] if tree.keys() == {"value"} else text


def _leaves(tree: Mapping[str, Any], model: type[BaseModel], above: tuple[str | int, ...] = ()) -> Iterator[Any]:
    """Every key that stands in a file: dotted, and its place."""
    for name, value in tree.items():
        part = section_model(model.model_fields[name].annotation) if name in model.model_fields else None
        place = (*above, name)
        if part is not None and isinstance(value, dict):
            yield from _leaves(value, part, place)
        elif part is not None and isinstance(value, list):
            for number, table in enumerate(value):
                yield from _leaves(table, part, (*place, number))
        else:
            yield ".".join(map(str, place)), place


def _values(section: str, value: Any, layered: Layered) -> Iterator[Value]:
    """The values of a section; its own keys first, then the sections in it."""
    if isinstance(value, tuple):
        for number, table in enumerate(value):
            yield from _values(f"{section}.{number}", table, layered)
        return
    inner = []
    for name in type(value).model_fields:
        part = getattr(value, name)
        if isinstance(part, BaseModel):
            inner.append(name)
        else:
            yield Value(section, name, part, layered.origin(f"{section}.{name}"))
    for name in inner:
        yield from _values(f"{section}.{name}", getattr(value, name), layered)
