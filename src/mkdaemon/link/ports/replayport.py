"""A recorded session as a port: what the boards said, when they said it. Nothing written ever leaves.

A recording is a capture, see `capture.py`; its first line is the time it began.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Final

from mkdaemon.errors import ConfigError, MkError
from mkdaemon.foreignfiles import open_regular
from mkdaemon.protocol.boards import Direction
from mkdaemon.protocol.capture import read_chunks


class ReplayPort:
    """A recording played once; see `Port`. After the last chunk `read` returns no bytes."""

    def __init__(self, name: str, chunks: list[tuple[float, bytes]], *, speed: float) -> None:
        self._name = name
        self._chunks = chunks
        self._next = 0
        self._speed = speed
        self._started: float | None = None

    @property
    def name(self) -> str:
        """The file."""
        return self._name

    @property
    def descriptor(self) -> int | None:
        """None: no device is behind it."""
        return None

    @property
    def is_recording(self) -> bool:
        """True."""
        return True

    @property
    def backlog(self) -> int:
        """Always 0."""
        return 0

    async def read(self) -> bytes:
        """Return the chunks whose time has come; nothing after the last one."""
        now = asyncio.get_running_loop().time()
        if self._started is None:
            self._started = now
        if self._next >= len(self._chunks):
            return b""
        due, chunk = self._chunks[self._next]
        wait = self._started + due / self._speed - now
        if wait > 0:
            await asyncio.sleep(wait)
        else:
            await asyncio.sleep(0)  # a recording played fast must not keep the loop from everything else
        self._next += 1
        return chunk

    def write(self, data: bytes) -> None:
        """Swallow: a recording cannot be changed."""

    def discard(self) -> None:
        """Do nothing."""

    async def drain(self) -> None:
        """Return at once."""

    async def close(self) -> None:
        """Forget the recording."""
        self._chunks = []


LONGEST: Final = 1 << 29
"""Longest recording that is replayed [bytes]: it is held in memory, and a line of 115,200 baud fills it in a day."""


def read_recording(path: Path) -> list[tuple[float, bytes]]:
    """Load what the boards said: seconds since the recording began, and bytes.

    Raises:
        ConfigError: no such file, not a capture, or nothing in it came from a board.
    """
    try:
        with open_regular(path, LONGEST) as stream:
            chunks = list(read_chunks(stream, str(path)))
    except OSError as error:
        raise ConfigError(f"replay {path}: {error.strerror}: name an existing recording in link.port") from error
    except MkError as error:
        raise ConfigError(f"replay {error}") from error
    began = chunks[0].t
    if began is None:
        raise ConfigError(f"replay {path}: raw bytes tell no times; a capture has lines of t, dir and hex")
    records = [
        (t - began, raw) for t, direction, raw in chunks if direction is Direction.FROM_BOARD and raw and t is not None
    ]
    if not records:
        raise ConfigError(f"replay {path}: nothing in it came from a board")
    return records


def open_replay(path: Path, *, speed: float) -> ReplayPort:
    """Open a recording.

    Raises:
        ConfigError: see `read_recording`.
    """
    return ReplayPort(str(path), read_recording(path), speed=speed)
