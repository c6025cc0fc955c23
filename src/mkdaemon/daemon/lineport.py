"""A port whose bytes are recorded on their way."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from mkdaemon.clock import Clock
from mkdaemon.errors import LinkLostError
from mkdaemon.link.link import Opener
from mkdaemon.link.ports.port import Port

if TYPE_CHECKING:
    from mkdaemon.record.tap import Tap


def record_port(opener: Opener, tap: Tap | None, clock: Clock) -> Opener:
    """What opens ports whose bytes are recorded.

    Args:
        opener: opens them.
        tap: takes the bytes; None for nobody.
        clock: stamps them.
    """
    return opener if tap is None else partial(_open, opener, tap, clock)


async def _open(opener: Opener, tap: Tap, clock: Clock, url: str, *, baud: int) -> Port:
    port = await opener(url, baud=baud)
    tap.port_opened(port.name, baud)
    return RecordedPort(port, tap, clock)


class RecordedPort:
    """An open port; see `Port`. What is written is recorded by the sink, which knows what for."""

    def __init__(self, port: Port, tap: Tap, clock: Clock) -> None:
        self._port = port
        self._tap = tap
        self._clock = clock
        self._is_lost = False
        self._backlog = 0

    @property
    def name(self) -> str:
        """As the port's."""
        return self._port.name

    @property
    def backlog(self) -> int:
        """As the port's; what waits there decides whether the next stick frame may go."""
        size = self._port.backlog
        if size != self._backlog:
            self._backlog = size
            self._tap.port_waits(size)
        return size

    @property
    def descriptor(self) -> int | None:
        """As the port's."""
        return self._port.descriptor

    @property
    def is_recording(self) -> bool:
        """As the port's."""
        return self._port.is_recording

    async def read(self) -> bytes:
        """Return what arrived; see `Port.read`."""
        try:
            data = await self._port.read()
        except LinkLostError as error:
            self._note_loss(str(error))
            raise
        self._tap.port_read(data, self._clock.monotonic())
        return data

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Port.write`."""
        try:
            self._port.write(data)
        except LinkLostError as error:
            self._note_loss(str(error))
            raise

    def discard(self) -> None:
        """Throw away what has not left; see `Port.discard`."""
        try:
            self._port.discard()
        except LinkLostError as error:
            self._note_loss(str(error))
            raise

    async def drain(self) -> None:
        """Wait until everything has left; see `Port.drain`."""
        await self._port.drain()

    async def close(self) -> None:
        """Let the device go; see `Port.close`."""
        self._note_loss("")
        await self._port.close()

    def _note_loss(self, reason: str) -> None:
        if not self._is_lost:
            self._is_lost = True
            self._tap.port_lost(reason)
