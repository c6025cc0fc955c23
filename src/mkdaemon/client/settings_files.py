"""Backups of parameter sets on disk: one file a set, or a folder of them."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from mkdaemon.errors import ConfigError, MkError, ProtocolError
from mkdaemon.files import refuse_existing, save
from mkdaemon.foreignfiles import LONGEST_SETTINGS, read_text
from mkdaemon.protocol.settings import ParameterSet
from mkdaemon.protocol.settings_file import SettingsFile
from mkdaemon.telemetry.settings import SettingsBackup, StoredSet

_SUFFIXES: Final = (".toml", ".json")
_ALL: Final = 5
"""Sets of a FlightCtrl."""


class SetSource(NamedTuple):
    """A parameter set and where it came from.

    Attributes:
        parameters: the set.
        name: file, or what else to call it in messages.
    """

    parameters: ParameterSet
    name: str


def check_target(target: Path, slots: Sequence[int], *, overwrite: bool = False) -> tuple[int, ...]:
    """Check where a backup goes before anything is read.

    Args:
        target: a folder, or a `.toml` or `.json` file for a single set.
        slots: numbers of the sets; all five for a file mean the active one.
        overwrite: replace files that are there.

    Returns:
        Numbers of the sets to read; none for the active one.

    Raises:
        ConfigError: a file is there already, or several sets were to go into one.
    """
    if target.suffix.lower() in _SUFFIXES:
        refuse_existing(target, overwrite=overwrite)
        if len(slots) > 1 and len(slots) < _ALL:
            raise ConfigError(f"{target}: one file holds one set, not {len(slots)}; name a folder")
        return tuple(slots) if len(slots) == 1 else ()
    if target.is_file() or (target.is_dir() and any(target.glob("set*")) and not overwrite):
        msg = f"{target}: already exists; choose another folder, a file ending in .toml or .json, or --force"
        raise ConfigError(msg)
    return tuple(slots)


def write_backup(
    target: Path, found: SettingsBackup, slots: Sequence[int], *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write sets, each file whole or not at all; returns the files.

    Raises:
        ConfigError: a file is there already, and `overwrite` is off.
        MkError: a file cannot be written; what was there is untouched.
    """
    saved = datetime.datetime.now(tz=datetime.UTC).isoformat(timespec="seconds")
    is_file = target.suffix.lower() in _SUFFIXES
    raw = {one.slot: one.raw for one in found.sets}
    paths = []
    folder = target.parent if is_file else target
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MkError(f"{folder}: cannot be created ({error.strerror}); choose another place") from error
    for slot in sorted(slots):
        content = SettingsFile(ParameterSet.from_payload(raw[slot]), slot, found.firmware, saved)
        path = target if is_file else target / f"set{slot}.toml"
        text = content.to_json() if path.suffix.lower() == ".json" else content.to_toml()
        save(path, text, overwrite=overwrite)
        paths.append(path)
    return tuple(paths)


def read_sets(source: Path) -> dict[int, SetSource]:
    """Read a backup, file or folder, by slot.

    Raises:
        ConfigError: nothing there, or a file is damaged; names the file and the fix.
    """
    if source.is_dir():
        paths = sorted(path for path in source.iterdir() if path.suffix.lower() in _SUFFIXES)
        if not paths:
            raise ConfigError(f"{source}: no .toml or .json file in this folder; name the folder of a backup")
    else:
        paths = [source]
    sets: dict[int, SetSource] = {}
    for path in paths:
        try:
            content = SettingsFile.parse(read_text(path, limit=LONGEST_SETTINGS))
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read ({error.strerror}); check the name") from error
        except UnicodeDecodeError as error:
            msg = f"{path}: not text (byte {error.start}); name a file that `mkctl settings backup` wrote"
            raise ConfigError(msg) from error
        except ProtocolError as error:
            raise ConfigError(f"{path}: {error}") from error
        if content.slot in sets:
            raise ConfigError(f"{path}: slot {content.slot} is also in {sets[content.slot].name}; keep one of them")
        sets[content.slot] = SetSource(content.parameters, str(path))
    return sets


def stored_sets(source: Path) -> tuple[StoredSet, ...]:
    """Read a backup, file or folder, as the daemon takes it.

    Raises:
        ConfigError: see `read_sets`.
    """
    return tuple(StoredSet(slot=slot, raw=one.parameters.raw) for slot, one in read_sets(source).items())
