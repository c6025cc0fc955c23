"""The one reader of configuration files: TOML to frozen models; `mistakes` says what is wrong with one."""

from __future__ import annotations

import difflib
import json
import sysconfig
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from mkdaemon.config.base import Section
from mkdaemon.config.mistakes import explain
from mkdaemon.config.root import Config
from mkdaemon.errors import ConfigError
from mkdaemon.foreignfiles import LONGEST_SETTINGS, parse_toml, read_text

_Section = TypeVar("_Section", bound=Section)
COMMAND_LINE: Final = "command line"


def load(path: Path | None, overrides: Mapping[str, Any] | None = None) -> Config:
    """Read a configuration file and lay overrides over it.

    Args:
        path: the TOML file; None for defaults only.
        overrides: values by dotted key, for example `{"link.port": "/dev/ttyUSB0"}`, as the command line gives them.

    Raises:
        ConfigError: the file is missing, unreadable, no TOML, or holds a wrong key or value. One line names the file,
            the line, the key, what is wrong and the nearest valid key.
    """
    return load_section(Config, path, overrides)


def load_section(kind: type[_Section], path: Path | None, overrides: Mapping[str, Any] | None = None) -> _Section:
    """Read a file of another kind, for example the mapping of a gamepad.

    Args:
        kind: what the file holds.
        path: the TOML file; None for defaults only.
        overrides: see `load`.

    Raises:
        ConfigError: see `load`.
    """
    given = dict(overrides or {})
    return validated(kind, path, "" if path is None else read_file(path), given, dict.fromkeys(given, COMMAND_LINE))


def validated(
    kind: type[_Section], path: Path | None, text: str, given: Mapping[str, Any], origins: Mapping[str, str]
) -> _Section:
    """Make the models of a text and of what goes before it.

    Args:
        kind: what the file holds.
        path: the file, for the messages about mistakes.
        text: what stands in it.
        given: values that go before it, by dotted key.
        origins: where each of these comes from.

    Raises:
        ConfigError: see `load`.
    """
    try:
        tree = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        msg = f"{path}: not valid TOML: {error}"
        raise ConfigError(msg) from error
    for key, value in given.items():
        _put(tree, key.split("."), value)
    try:
        # TOML has types: a number in quotes or a 1 for true is a mistake. Of pydantic's strict modes, the one for JSON
        # knows that a file holds arrays for tuples and strings for paths. Dates, which no key takes, become what no key
        # takes.
        return kind.model_validate_json(json.dumps(tree, default=lambda date: [str(date)]), strict=True)
    except ValidationError as error:
        raise explain(error, path, text, origins, kind) from error


def samples_folder() -> Path:
    """Folder of the sample configurations: in the source tree of this module, or installed beside the package."""
    tree = Path(__file__).parents[3] / "configs"
    return tree if tree.is_dir() else Path(sysconfig.get_path("data")) / "share" / "mkdaemon" / "configs"


def read_file(path: Path) -> str:
    """Read a configuration file.

    Raises:
        ConfigError: it is missing or unreadable; says what is like it.
    """
    try:
        return read_text(path, limit=LONGEST_SETTINGS)
    except FileNotFoundError as error:
        near = difflib.get_close_matches(path.name, [p.name for p in path.parent.glob("*.toml")], n=1)
        hint = f"did you mean {path.parent / near[0]}?" if near else f"samples are in {samples_folder()}"
        msg = f"{path}: no such configuration file; {hint}"
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
