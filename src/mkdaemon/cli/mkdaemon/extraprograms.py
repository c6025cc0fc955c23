"""Commands and sections that come with an extra of the installation: entry points, which other packages offer.

The command table names them as attributes of this module, so that nothing is looked for before one is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, Final, get_type_hints

from mkdaemon.config.root import DaemonSections
from mkdaemon.errors import ConfigError

GROUP: Final = "mkdaemon.programs"
"""Entry points of this group are commands; each names a function as the command table does."""
SECTIONS: Final = "mkdaemon.sections"
"""Entry points of this group read a file whose section has their name; the model of that file is their return type."""
EXTRAS: Final[Mapping[str, str]] = {"sim": "sim", "demo": "sim"}
"""Commands, and the extra that brings each."""


def __getattr__(name: str) -> Any:
    """Return the command of a name; see `load_program`."""
    if name not in EXTRAS:
        raise AttributeError(name)
    return load_program(name)


def load_program(name: str) -> Any:
    """Return the function of a command that an installed package offers.

    Args:
        name: one of `EXTRAS`.

    Raises:
        ConfigError: no installed package offers it; says what to install.
    """
    program = _offered(GROUP, name)
    if program is None:
        raise ConfigError(f"`mkdaemon {name}` is not installed here: pip install 'mkdaemon[{EXTRAS[name]}]'")
    return program


def file_with(section: str) -> type[DaemonSections] | None:
    """The model of a file that has a section of another package; None where that package is not installed.

    Args:
        section: its name.
    """
    read = _offered(SECTIONS, section)
    return None if read is None else get_type_hints(read)["return"]


def _offered(group: str, name: str) -> Any:
    """What an installed package offers under a name; None where none does."""
    from importlib.metadata import entry_points  # takes longer than everything else here

    for point in entry_points(group=group, name=name):
        if find_spec(point.module.partition(".")[0]) is not None:
            return point.load()
    return None
