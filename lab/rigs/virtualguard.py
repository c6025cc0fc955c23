"""The guard in virtual time: the rules of the process; its frames are counted and, on request, reach the boards."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence

from mkdaemon.guard import Guard, Word, beat

LOOK = 0.005
"""Time between two looks at the clock [s]."""


class VirtualGuard:
    """Hears what the link says and acts in the time of the running loop.

    Attributes:
        written: every frame it wrote, with its time [s].
    """

    def __init__(self, write: Callable[[bytes], None] = lambda data: None) -> None:
        self.guard = Guard()
        self.written: list[tuple[float, bytes]] = []
        self.write = write
        self._hears_link = True
        self._task: asyncio.Task[None] | None = None

    def port_opened(self, descriptor: int) -> None:
        """Begin to watch."""
        if self._task is None:
            self._task = asyncio.create_task(self._run(), name="virtual guard")

    def port_closed(self) -> None:
        """Nothing to let go of."""

    def frames_changed(self, release: Sequence[bytes]) -> None:
        """Take the release frames."""
        self._hear(Word.FRAMES + json.dumps([frame.hex() for frame in release]).encode())

    def frame_written(self, neutral: bytes) -> None:
        """Take a heartbeat."""
        self._hear(beat(neutral, asyncio.get_running_loop().time()))

    def released(self) -> None:
        """Nothing is owed."""
        self._hear(Word.SAFE)

    def daemon_died(self) -> None:
        """The other end of the channel is gone."""
        self._hear(b"")
        self.daemon_stopped()

    def daemon_stopped(self) -> None:
        """The link has been silent too long; the channel is open."""
        self._hears_link = False

    def stop(self) -> None:
        """End watching."""
        if self._task is not None:
            self._task.cancel()

    def _hear(self, packet: bytes) -> None:
        if self._hears_link:
            self.guard.hear(packet, asyncio.get_running_loop().time())

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            frames = self.guard.due(loop.time())
            if frames:
                self.written.append((loop.time(), b"".join(frames)))
                self.write(b"".join(frames))
            await asyncio.sleep(LOOK)
