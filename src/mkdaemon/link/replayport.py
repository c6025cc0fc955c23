"""A recorded session as a port: what the boards said, when they said it. Nothing written ever leaves.

A recording has one JSON object a line: `t` seconds, `dir` `rx` (from the board) or `tx`, `hex` the bytes of one chunk.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import NamedTuple

from mkdaemon.errors import ConfigError


class Chunk(NamedTuple):
    """Bytes of a recording.

    Attributes:
        t: seconds since its beginning.
        raw: bytes in order.
    """

    t: float
    raw: bytes


class ReplayPort:
    """A recording played once; see `Port`. After the last chunk `read` returns no bytes."""

    def __init__(self, name: str, chunks: list[Chunk], *, speed: float) -> None:
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
        wait = self._started + self._chunks[self._next].t / self._speed - now
        if wait > 0:
            await asyncio.sleep(wait)
        else:
            await asyncio.sleep(0)  # a recording played fast must not keep the loop from everything else
        chunk = self._chunks[self._next].raw
        self._next += 1
        return chunk

    def write(self, data: bytes) -> None:
        """Swallow: a recording cannot be changed."""

    async def drain(self) -> None:
        """Return at once."""

    async def close(self) -> None:
        """Forget the recording."""
        self._chunks = []


def read_recording(path: Path) -> list[Chunk]:
    """Load what the boards said.

    Raises:
        ConfigError: no such file, not a recording, or nothing in it came from a board.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ConfigError(f"replay {path}: {error.strerror}: name an existing recording in link.port") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"replay {path}: not a recording (one JSON object with t, dir, hex a line)") from error
    chunks: list[Chunk] = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
            if record["dir"] == "rx":
                chunks.append(Chunk(float(record["t"]), bytes.fromhex(record["hex"])))
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"replay {path}, line {number}: no JSON object with t, dir and hex") from error
    if not chunks:
        raise ConfigError(f"replay {path}: nothing in it came from a board")
    return chunks


def open_replay(path: Path, *, speed: float) -> ReplayPort:
    """Open a recording.

    Raises:
        ConfigError: see `read_recording`.
    """
    return ReplayPort(str(path), read_recording(path), speed=speed)
