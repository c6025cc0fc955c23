"""A file that grows by whole pieces: what could not be written in full is taken back."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Final

MODE: Final = 0o640


class RawFile:
    """A new file, open for writing.

    Attributes:
        path: where it is.
    """

    def __init__(self, path: Path) -> None:
        """Make the file.

        Raises:
            OSError: it cannot be made, or is there already.
        """
        self.path = path
        self._size = 0
        self._number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, MODE)

    def write(self, data: bytes, /) -> None:
        """Append all of it, or nothing.

        Raises:
            OSError: the disk is full or fails.
        """
        left = memoryview(data)
        try:
            while left:
                left = left[os.write(self._number, left) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._number, self._size)
                os.lseek(self._number, self._size, os.SEEK_SET)
            raise
        self._size += len(data)

    def sync(self) -> None:
        """Bring what was written to the disk itself.

        Raises:
            OSError: the disk fails.
        """
        os.fdatasync(self._number)

    def is_in_place(self) -> bool:
        """Whether the file still has its name: somebody may have removed it or its folder."""
        try:
            found = self.path.stat()
        except OSError:
            return False
        mine = os.fstat(self._number)
        return (found.st_dev, found.st_ino) == (mine.st_dev, mine.st_ino)

    def close(self) -> None:
        """Close it; never raises, safe to call twice."""
        if self._number >= 0:
            number, self._number = self._number, -1
            with suppress(OSError):
                os.close(number)

    def discard(self) -> None:
        """Close the file and take its name away; never raises."""
        self.close()
        with suppress(OSError):
            self.path.unlink()
