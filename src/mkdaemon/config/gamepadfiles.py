"""Finds the mapping files of gamepads."""

from __future__ import annotations

from pathlib import Path

from mkdaemon.config.gamepad import Gamepad
from mkdaemon.config.reader import load_section, samples_folder
from mkdaemon.errors import ConfigError
from mkdaemon.files import user_folder


def own_folder() -> Path:
    """Folder of the mappings learned on this machine; they precede those of mkdaemon."""
    return user_folder("XDG_CONFIG_HOME") / "gamepads"


def shipped_folder() -> Path:
    """Folder of mkdaemon's own mappings; see `samples_folder`."""
    installed = samples_folder() / "gamepads"
    return installed if installed.is_dir() else Path("configs") / "gamepads"


def load_mapping(name: str) -> Gamepad:
    """Read the mapping of a name, for example `xbox`, or of a path that ends in `.toml`.

    Raises:
        ConfigError: there is none, or it is wrong; says what there is.
    """
    if name.endswith(".toml"):
        return load_section(Gamepad, Path(name))
    folders = [folder for folder in (own_folder(), shipped_folder()) if folder.is_dir()]
    for folder in folders:
        if (folder / f"{name}.toml").is_file():
            return load_section(Gamepad, folder / f"{name}.toml")
    known = sorted({path.stem for folder in folders for path in folder.glob("*.toml")})
    raise ConfigError(f"no gamepad mapping has the name {name!r}; there is {', '.join(known) or 'none'}")
