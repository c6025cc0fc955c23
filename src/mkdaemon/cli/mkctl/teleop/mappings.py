"""The mapping files of pads: those that come with mkdaemon, and those that `mkctl teleop --learn` wrote."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section, samples_folder
from mkdaemon.errors import ConfigError

LEARN: Final = "`mkctl teleop --learn` writes one by asking for each stick, `--mapping FILE` uses one"


def own_folder() -> Path:
    """Where the mappings are that were learned on this machine; they go before those of mkdaemon."""
    base = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(base) / "mkdaemon" / "gamepads"


def shipped_folder() -> Path:
    """Where the mappings are that come with mkdaemon; see `samples_folder`."""
    installed = samples_folder() / "gamepads"
    return installed if installed.is_dir() else Path("configs") / "gamepads"


def load_mappings() -> list[tuple[Path, Gamepad]]:
    """Read every mapping file, those of this machine first.

    Raises:
        ConfigError: one of them is wrong; names file, line, key and fix.
    """
    folders = (own_folder(), shipped_folder())
    paths = [path for folder in folders if folder.is_dir() for path in sorted(folder.glob("*.toml"))]
    return [(path, load_section(Gamepad, path)) for path in paths]


def find_mapping(id_: str, name: str, known: list[tuple[Path, Gamepad]]) -> Gamepad:
    """Return the mapping of a pad.

    Args:
        id_: vendor and product, `045e:028e`.
        name: as the pad calls itself.
        known: from `load_mappings`.

    Raises:
        ConfigError: there is none; says what to do.
    """
    for _, pad in known:
        if id_ in pad.ids:
            return pad
    msg = f"no mapping for {name} ({id_}): {LEARN}"
    raise ConfigError(msg)
