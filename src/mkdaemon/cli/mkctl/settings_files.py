"""Backups of parameter sets on disk: one file a set, or a folder of them."""

from __future__ import annotations

import datetime
from collections.abc import Collection
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.errors import ConfigError, ProtocolError
from mkdaemon.protocol.procedures.settings import Backup
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import SettingsFile

_SUFFIXES: Final = (".toml", ".json")


class Source(NamedTuple):
    """A parameter set and where it came from.

    Attributes:
        parameters: the set.
        name: file, or what else to call it in messages.
    """

    parameters: ParameterSet
    name: str


def read_target(target: Path) -> bool:
    """Whether a backup's target is one file (True) or a folder (False).

    Raises:
        ConfigError: the file exists already, or the folder holds other things.
    """
    if target.suffix.lower() in _SUFFIXES:
        if target.exists():
            msg = f"{target}: exists already; choose another name, backups are never overwritten"
            raise ConfigError(msg)
        return True
    if target.is_file() or (target.is_dir() and any(target.glob("set*"))):
        msg = f"{target}: holds something already; choose another folder, or a file ending in .toml or .json"
        raise ConfigError(msg)
    return False


def write_backup(target: Path, backup: Backup, wanted: Collection[int]) -> list[Path]:
    """Write sets; returns the files.

    Raises:
        ConfigError: the place cannot be written.
    """
    saved = datetime.datetime.now(tz=datetime.UTC).isoformat(timespec="seconds")
    is_file = target.suffix.lower() in _SUFFIXES
    paths = []
    try:
        (target.parent if is_file else target).mkdir(parents=True, exist_ok=True)
        for slot in sorted(wanted):
            parameters = ParameterSet.from_payload(backup.sets[slot])
            content = SettingsFile(parameters, slot, backup.version.release, saved)
            path = target if is_file else target / f"set{slot}.toml"
            path.write_text(
                content.to_json() if path.suffix.lower() == ".json" else content.to_toml(), encoding="utf-8"
            )
            paths.append(path)
    except OSError as error:
        msg = f"{target}: cannot be written ({error.strerror}); choose another place"
        raise ConfigError(msg) from error
    return paths


def read_sets(source: Path) -> dict[int, Source]:
    """Read a backup, file or folder, by slot.

    Raises:
        ConfigError: nothing there, or a file is damaged; names the file and the fix.
    """
    if source.is_dir():
        paths = sorted(path for path in source.iterdir() if path.suffix.lower() in _SUFFIXES)
        if not paths:
            msg = f"{source}: no .toml or .json file in this folder; name the folder of a backup"
            raise ConfigError(msg)
    else:
        paths = [source]
    sets: dict[int, Source] = {}
    for path in paths:
        try:
            content = SettingsFile.parse(path.read_text(encoding="utf-8"))
        except OSError as error:
            msg = f"{path}: cannot be read ({error.strerror}); check the name"
            raise ConfigError(msg) from error
        except UnicodeDecodeError as error:
            msg = f"{path}: not text (byte {error.start}); name a file that `mkctl settings backup` wrote"
            raise ConfigError(msg) from error
        except ProtocolError as error:
            msg = f"{path}: {error}"
            raise ConfigError(msg) from error
        if content.slot in sets:
            msg = f"{path}: slot {content.slot} is also in {sets[content.slot].name}; keep one of them"
            raise ConfigError(msg)
        sets[content.slot] = Source(content.parameters, str(path))
    return sets
