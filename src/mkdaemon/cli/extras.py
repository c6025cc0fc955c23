"""What needs an extra of the installation says which."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mkdaemon.errors import ConfigError


@contextmanager
def needing(what: str, library: str, extra: str, module: str = "") -> Iterator[None]:
    """Import what an extra brings while the context lasts.

    Args:
        what: does not work without it.
        library: as its package is called.
        extra: of mkdaemon.
        module: that is imported; the extra's name by default.

    Raises:
        ConfigError: it is not installed; says how to install it.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != (module or extra):
            raise
        raise ConfigError(f"{what} needs {library}: pip install 'mkdaemon[{extra}]'") from None
