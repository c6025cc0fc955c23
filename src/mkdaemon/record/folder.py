"""The folder of recordings: names of files, the room they may take, and a file that grows by whole pieces."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from mkdaemon.files import flush_folder

_TIME: Final = "%Y%m%dT%H%M%SZ"
_NAME: Final = re.compile(r"(?P<name>.+-\d{8}T\d{6}Z)-(?P<part>\d{3,})\.mcap")


@dataclass(frozen=True, slots=True)
class RoomLimits:
    """Limits of the room for recordings.

    Attributes:
        file_bytes: a file is ended when it is so large.
        file_time: a file is ended when it is so old [s].
        total_bytes: all recordings of the folder together.
        free_bytes: stays free on the disk for other programs.
        may_delete: whether the oldest recordings are deleted to stay within `total_bytes`, and older recordings than
            the present one to stay within `free_bytes`; else recording stops there.
    """

    file_bytes: int
    file_time: float
    total_bytes: int
    free_bytes: int
    may_delete: bool


def recording_name(prefix: str, wall: float) -> str:
    """Name of a recording that begins now.

    Args:
        prefix: the vehicle, or `ground`.
        wall: Unix time [s].
    """
    return f"{prefix}-{datetime.fromtimestamp(wall, UTC):{_TIME}}"


def origin_of(path: Path) -> tuple[str, float] | None:
    """Prefix of a recording and when it began, by its name [Unix time, s]; None where it has another name."""
    form = _NAME.fullmatch(path.name)
    prefix, _, text = ("" if form is None else form["name"]).rpartition("-")
    try:
        return prefix, datetime.strptime(text, _TIME).replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None


def recordings_of(folder: Path, prefix: str) -> list[Path]:
    """All recordings of a prefix in a folder, the oldest first."""
    found = []
    for path in folder.glob(f"{prefix}-*.mcap"):
        form = _NAME.fullmatch(path.name)
        if form is not None and form["name"].rpartition("-")[0] == prefix:
            found.append((form["name"], int(form["part"]), path))
    return [path for _, _, path in sorted(found)]


def free_space(folder: Path) -> int:
    """Space that an ordinary user may still write there [bytes].

    Raises:
        OSError: there is no such folder.
    """
    found = os.statvfs(folder)
    return found.f_bavail * found.f_frsize


class RecordingFolder:
    """Files of one recorder: those of one prefix. Others in the folder are left alone.

    Attributes:
        path: the folder.
        limits: how much room there is.
    """

    def __init__(
        self, path: Path, prefix: str, limits: RoomLimits, *, free: Callable[[Path], int] = free_space
    ) -> None:
        """Name a folder; it is made when a file is.

        Args:
            path: the folder.
            prefix: how names of files begin.
            limits: how much room there is.
            free: tells how much is free on its disk.
        """
        self.path = path
        self.limits = limits
        self._prefix = prefix
        self._free = free

    def file(self, name: str, part: int) -> Path:
        """Place of a part of a recording."""
        return self.path / f"{name}-{part:03d}.mcap"

    def unused_name(self, name: str) -> str:
        """The name of a recording, a second or more later if another file has it, after a quick restart.

        Args:
            name: as `recording_name` made it.
        """
        while self.file(name, 0).exists():
            prefix, _, text = name.rpartition("-")
            time = datetime.strptime(text, _TIME).replace(tzinfo=UTC) + timedelta(seconds=1)
            name = recording_name(prefix, time.timestamp())
        return name

    def make(self) -> None:
        """Make the folder where there is none.

        Raises:
            OSError: it cannot be made.
        """
        self.path.mkdir(parents=True, exist_ok=True, mode=0o750)

    def files(self) -> list[Path]:
        """All recordings, the oldest first."""
        return recordings_of(self.path, self._prefix)

    def free_bytes(self) -> int:
        """Free space of its disk [bytes].

        Raises:
            OSError: there is no such folder.
        """
        return self._free(self.path)

    def total_bytes(self) -> int:
        """Size of all recordings together [bytes]."""
        return sum(_size(path) for path in self.files())

    def make_room(self, name: str, current: Path | None) -> str:
        """Delete what the limits allow until there is room; returns why there is none, empty where there is.

        What others fill the disk with costs older recordings, and never the one that is being made.

        Args:
            name: of the recording that is being made.
            current: its file that is being written; it stays.

        Raises:
            OSError: there is no such folder.
        """
        limits = self.limits
        files = [path for path in self.files() if path != current]
        older = [path for path in files if not path.name.startswith(f"{name}-")]
        while (total := self.total_bytes()) > limits.total_bytes:
            if not limits.may_delete or not files:
                return f"recordings take {_mega(total)}, and may take {_mega(limits.total_bytes)}"
            self._delete(files.pop(0))
        while (free := self.free_bytes()) < limits.free_bytes:
            if not limits.may_delete or not older:
                return f"{_mega(free)} are free on the disk, and {_mega(limits.free_bytes)} are left to others"
            self._delete(older.pop(0))
        return ""

    def _delete(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        flush_folder(self.path)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _mega(size: int) -> str:
    return f"{size / 1e6:.0f} MB"


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
        """Whether the file still has its name: another program may have removed it or its folder."""
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
