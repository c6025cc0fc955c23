"""Files that are whole or not there: written beside their place, flushed to the disk, then renamed."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path


def write_whole(path: Path, content: str | bytes, *, overwrite: bool = False) -> None:
    """Write a file so that its place holds the old content or all of the new, whatever happens meanwhile.

    Args:
        path: the file; its folder must exist.
        content: text is written as UTF-8.
        overwrite: replace a file that is there.

    Raises:
        FileExistsError: it is there already, and `overwrite` is off.
        OSError: it cannot be written, for example because the disk is full; what was there is untouched.
    """
    if not overwrite and path.exists():
        raise FileExistsError(17, "exists already", str(path))
    raw = content.encode() if isinstance(content, str) else content
    number, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".new", dir=path.parent)
    fresh = Path(name)
    try:
        with os.fdopen(number, "wb") as file:
            file.write(raw)
            file.flush()
            os.fsync(file.fileno())
        fresh.chmod(0o666 & ~_umask())
        fresh.replace(path)
    except BaseException:
        with suppress(OSError):
            fresh.unlink()
        raise
    flush_folder(path.parent)


def flush_folder(folder: Path) -> None:
    """Bring a folder's names to the disk, so that a power failure keeps what was renamed or removed in it."""
    with suppress(OSError):  # some file systems cannot
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def _umask() -> int:
    """What the user lets nobody do with new files; reading it means setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
