"""A port with simulated boards at its other end, in the time of the running loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from mkdaemon.errors import LinkLostError
from mkdaemon.link.ports.port import Port
from mksim.simulation import Simulation

TICK: Final = 2e-3
"""How often bytes are carried [s]."""


class Cable:
    """The one cable to the boards."""

    def __init__(self, simulation: Simulation, moved: Callable[[float], None]) -> None:
        """Plug it in.

        Args:
            simulation: the boards, and what they fly.
            moved: called after every step with the time [s].
        """
        self.simulation = simulation
        self.moved = moved

    async def open(self, url: str, *, baud: int) -> Port:
        """Open the port; see `mkdaemon.link.ports.port.open_port`."""
        del baud
        return CablePort(self, url)


class CablePort:
    """An open port to the boards; see `Port`."""

    def __init__(self, cable: Cable, name: str) -> None:
        self._cable = cable
        self._name = name
        self._inbox = bytearray()
        self._is_closed = False
        self._arrived = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._timer = self._loop.call_later(TICK, self._tick)

    @property
    def name(self) -> str:
        """The address it was opened under."""
        return self._name

    @property
    def backlog(self) -> int:
        """Bytes that wait: none, the radio keeps what it was given."""
        return 0

    @property
    def descriptor(self) -> int | None:
        """None: there is no device."""
        return None

    @property
    def is_recording(self) -> bool:
        """False."""
        return False

    def discard(self) -> None:
        """Throw away what waits: nothing does."""

    async def read(self) -> bytes:
        """Return what arrived; see `Port.read`."""
        while not self._inbox:
            if self._is_closed:
                raise LinkLostError(f"{self._name}: closed")
            self._arrived.clear()
            await self._arrived.wait()
        chunk = bytes(self._inbox)
        self._inbox.clear()
        return chunk

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Port.write`."""
        if self._is_closed:
            raise LinkLostError(f"{self._name}: closed")
        self._cable.simulation.write(data, max(self._loop.time(), self._cable.simulation.now))

    async def drain(self) -> None:
        """Return at once: virtual bytes need no draining."""

    async def close(self) -> None:
        """End it."""
        self._is_closed = True
        self._timer.cancel()
        self._arrived.set()

    def _tick(self) -> None:
        self._timer = self._loop.call_later(TICK, self._tick)
        now = self._loop.time()
        arrived = b"".join(data for _, data in self._cable.simulation.advance(now))
        self._cable.moved(now)
        if arrived:
            self._inbox += arrived
            self._arrived.set()
