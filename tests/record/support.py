"""Doubles: a disk that fails, fills and hangs on request."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path

import msgpack

from mkdaemon.record.entry import Entry, EntryKind, TimeBase
from mkdaemon.record.folder import RawFile, RecordingFolder, RoomLimits
from mkdaemon.record.layout import Session
from mkdaemon.record.queue import EntryQueue
from mkdaemon.record.recorder import FLUSH, Recorder

BASE = TimeBase("0123abcd", 1_760_000_000_123_456_789)
SESSION = Session("blackbox", "mk1-20261122T080000Z", 0, "mkdaemon 0.1.0", "box", BASE.boot, BASE.offset_ns, "mk1")
ENCODING = "application/msgpack;mk.Attitude.v1"
ROOMY = RoomLimits(file_bytes=10**9, file_time=1e9, total_bytes=10**9, free_bytes=1, may_delete=False)


def sample(
    number: int, key: str = "mk/mk1/state/attitude", *, kind: EntryKind = EntryKind.SAMPLE, size: int = 40
) -> Entry:
    """An entry of which everything is known."""
    at = 1000.0 + number / 50
    stamp = {"monotonic": at - 0.002, "wall": 1_760_001_000.5 + number / 50, "boot": "0123abcd", "synchronised": True}
    payload = msgpack.packb({"stamp": stamp, "roll": number / 7, "raw": bytes([number % 256]) * size})
    return Entry(kind, key, payload, ENCODING, at, 1_760_001_000.5 + number / 50, BASE, number)


class Disk:
    """What a disk does to files.

    Attributes:
        error: number of the error it answers with; 0 for none.
        synced: how often something was brought to it.
    """

    def __init__(self) -> None:
        self.error = 0
        self.synced = 0
        self.written: Callable[[], None] = lambda: None

    def open(self, path: Path) -> DiskFile:
        """Make a file."""
        if self.error == errno.EACCES:
            raise OSError(self.error, "Permission denied", str(path))
        return DiskFile(path, self)


class DiskFile(RawFile):
    """A file on it."""

    def __init__(self, path: Path, disk: Disk) -> None:
        super().__init__(path)
        self._disk = disk

    def write(self, data: bytes, /) -> None:
        self._disk.written()
        if self._disk.error:
            raise OSError(self._disk.error, "No space left on device")
        super().write(data)

    def sync(self) -> None:
        self._disk.synced += 1
        super().sync()


class Bench:
    """A recorder whose time is an argument."""

    def __init__(
        self,
        folder: Path,
        *,
        limits: RoomLimits = ROOMY,
        capacity: int = 10**6,
        sync_period: float = 0.0,
        free: int = 10**12,
    ) -> None:
        self.disk, self.free, self.now = Disk(), free, 100.0
        self.queue = EntryQueue(capacity)
        self.folder = RecordingFolder(folder, "mk1", limits, free=lambda path: self.free)
        self.recorder = Recorder(self.queue, self.folder, SESSION, sync_period=sync_period, open_file=self.disk.open)

    def put(self, first: int, last: int, *, size: int = 40) -> None:
        """Put samples of these numbers."""
        for number in range(first, last + 1):
            self.queue.put(sample(number, size=size))

    def record(self, first: int, last: int) -> None:
        """Put samples of these numbers, and let them be flushed."""
        self.put(first, last)
        self.run(FLUSH + 0.1)

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end = self.now + seconds
        while self.now < end:
            self.now += self.recorder.step(self.now)
