"""Real time for the simulation: a pseudo terminal (and, if wanted, a TCP port) whose far end is the simulated board.

Every tick, a millisecond by default, the simulation advances to the wall clock; a byte comes out at the first tick
after its wire time, never before. If the host does not read, bytes that do not fit are lost, as on a line without flow
control.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import termios
import time
import tty
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any, Final

from mkdaemon.errors import LinkError
from mksim.simulation import Simulation

TICK_TIME: Final = 1e-3
"""How often bytes are carried [s]."""
_BLOCK: Final = 4096
_HANG_UP: Final = 1.0
_SLIP: Final = 0.5
"""Behind the wall clock by more than this (a suspended machine), the simulation skips the gap instead of racing."""


@contextlib.asynccontextmanager
async def running(work: Coroutine[Any, Any, None], name: str) -> AsyncIterator[None]:
    """Let work run in a task of this name while the context lasts; an error that ended it is raised on leaving."""
    job = asyncio.create_task(work, name=name)
    try:
        yield
    finally:
        job.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await job


class PseudoTerminal:
    """The host's serial port: raw, and open while the simulator runs, even if programs open and close it."""

    def __init__(self) -> None:
        """Open it.

        Raises:
            LinkError: the system has no pseudo terminals left.
        """
        try:
            self._near, self._far = os.openpty()
        except OSError as error:
            msg = f"no pseudo terminal: {error.strerror}; close some terminals or mount devpts"
            raise LinkError(msg) from error
        tty.setraw(self._far, termios.TCSANOW)
        os.set_blocking(self._near, False)
        self.name = os.ttyname(self._far)

    def fileno(self) -> int:
        """Descriptor of our end."""
        return self._near

    def read(self) -> bytes:
        """Return what the host has written; empty when nothing."""
        try:
            return os.read(self._near, _BLOCK)
        except BlockingIOError:
            return b""
        except OSError as error:
            if error.errno == errno.EIO:
                return b""
            raise

    def write(self, data: bytes) -> int:
        """Give the host bytes; return how many did not fit."""
        try:
            return len(data) - os.write(self._near, data)
        except BlockingIOError:
            return len(data)

    def close(self) -> None:
        """Close both ends."""
        for descriptor in (self._near, self._far):
            with contextlib.suppress(OSError):
                os.close(descriptor)


class Runtime:
    """Drives one simulation by the wall clock.

    Attributes:
        simulation: what is driven.
        port: path of the pseudo terminal.
        lost: bytes the host did not read in time.
        ended: set when the simulation has stopped, by itself only after an error; leaving `serve` raises that.
    """

    def __init__(
        self,
        simulation: Simulation,
        *,
        listen: str | None = None,
        clock: Callable[[], float] = time.monotonic,
        tick: float = TICK_TIME,
    ) -> None:
        """Open the port.

        Args:
            simulation: to be driven.
            listen: `host:port` of the TCP port; None offers none.
            clock: monotonic time [s].
            tick: how often bytes are carried [s].

        Raises:
            LinkError: no pseudo terminal can be opened.
        """
        self.simulation = simulation
        self._clock, self._tick = clock, tick
        self._terminal = PseudoTerminal()
        self._listen = listen
        self._client: asyncio.StreamWriter | None = None
        self._serving: asyncio.Task[None] | None = None
        self._zero = clock()
        self.port = self._terminal.name
        self.lost = 0
        self.ended = asyncio.Event()

    @contextlib.asynccontextmanager
    async def serve(self) -> AsyncIterator[Runtime]:
        """Run in the background while the context lasts.

        Raises:
            LinkError: the TCP port cannot be opened.
            ConfigError: the EEPROM file could no longer be written.
        """
        loop = asyncio.get_running_loop()
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(self._terminal.close)
            if self._listen is not None:
                await stack.enter_async_context(self._tcp(self._listen))
            loop.add_reader(self._terminal.fileno(), self._take_terminal)
            stack.callback(loop.remove_reader, self._terminal.fileno())
            self._zero = self._clock() - self.simulation.now
            async with running(self._run(), "simulation"):
                yield self

    @contextlib.asynccontextmanager
    async def _tcp(self, listen: str) -> AsyncIterator[None]:
        """Offer the line over TCP; at the end the client is hung up on, not cut off in the middle of a read."""
        host, _, port = listen.rpartition(":")
        try:
            server = await asyncio.start_server(self._take_client, host, int(port))
        except OSError as error:
            msg = f"sim.listen {listen}: {error.strerror}; choose another port"
            raise LinkError(msg) from error
        async with server:
            try:
                yield
            finally:
                server.close()
                if self._client is not None and self._serving is not None:
                    self._client.close()
                    await asyncio.wait([self._serving], timeout=_HANG_UP)

    async def _run(self) -> None:
        wake = self._clock()
        try:
            while True:
                self._step()
                wake = max(wake + self._tick, self._clock())
                await asyncio.sleep(wake - self._clock())
        finally:
            self.ended.set()

    def _time(self) -> float:
        """Simulated time that belongs to now [s]."""
        due = self._clock() - self._zero
        behind = due - self.simulation.now
        if behind > _SLIP:
            self._zero += behind
            due -= behind
        return due

    def _step(self) -> None:
        arrived = self.simulation.advance(self._time())
        if not arrived:
            return
        data = b"".join(piece for _, piece in arrived)
        self.lost += self._terminal.write(data)
        if self._client is not None:
            self._client.write(data)

    def _take_terminal(self) -> None:
        data = self._terminal.read()
        if data:
            self._take(data)

    def _take(self, data: bytes) -> None:
        now = max(self._time(), self.simulation.now)
        self.simulation.write(data, now)

    async def _take_client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one TCP client; a second one is turned away, as a serial port has one cable."""
        if self._client is not None:
            writer.close()
            return
        self._client, self._serving = writer, asyncio.current_task()
        try:
            while data := await reader.read(_BLOCK):
                self._take(data)
        except ConnectionError:
            pass
        finally:
            self._client = None
            writer.close()
