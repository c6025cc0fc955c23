"""A serial server reached over TCP: ser2net, a radio with Ethernet, a socket of the simulator."""

from __future__ import annotations

import asyncio
import fcntl
import socket
import struct
import termios
from array import array
from collections import deque
from contextlib import suppress
from typing import Final

from mkdaemon.errors import LinkError, LinkLostError

_CONNECT: Final = 3.0
OVERDUE: Final = 0.1
"""Bytes count as stuck if not acknowledged within this time [s]; a receiver may delay its acknowledgement by 0.04 s."""

SEND_BUFFER: Final = 2048
"""Bytes the kernel takes before they wait here, where they are seen: 0.36 s of a line; Linux doubles it."""
DEAD: Final = 3.0
"""A connection that acknowledges nothing within this time is ended, with what waits in it [s]; a FlightCtrl has
dropped the sticks by then."""


class TcpPort:
    """An open TCP connection; see `Port`."""

    def __init__(self, name: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._name = name
        self._reader = reader
        self._writer = writer
        self._written = 0
        self._marks: deque[tuple[int, float]] = deque(maxlen=1000)

    @property
    def name(self) -> str:
        """`host:port`."""
        return self._name

    @property
    def descriptor(self) -> int | None:
        """Of the open connection; None while it is not."""
        connection: socket.socket | None = self._writer.get_extra_info("socket")
        return None if connection is None or connection.fileno() < 0 else connection.fileno()

    @property
    def is_recording(self) -> bool:
        """False."""
        return False

    @property
    def backlog(self) -> int:
        """Bytes the network has not taken yet; once the oldest is overdue, also those that were not acknowledged."""
        waiting: int = self._writer.transport.get_write_buffer_size()
        unacknowledged = waiting + self._kernel_queue()
        while self._marks and self._marks[0][0] <= self._written - unacknowledged:
            self._marks.popleft()
        is_overdue = bool(self._marks) and asyncio.get_running_loop().time() - self._marks[0][1] > OVERDUE
        return unacknowledged if is_overdue else waiting

    def _kernel_queue(self) -> int:
        """Bytes the kernel keeps because the other end has not acknowledged them (tcp(7), SIOCOUTQ)."""
        if self.descriptor is None:
            return 0
        number = array("i", [0])
        with suppress(OSError):
            fcntl.ioctl(self.descriptor, termios.TIOCOUTQ, number)
        return number[0]

    async def read(self) -> bytes:
        """Return what arrived, as soon as there is something; see `Port.read`."""
        try:
            chunk = await self._reader.read(4096)
        except OSError as error:
            raise LinkLostError(f"tcp {self._name}: {error}") from error
        if not chunk:
            raise LinkLostError(f"tcp {self._name}: the other end closed the connection")
        return chunk

    def write(self, data: bytes) -> None:
        """Take bytes to send; see `Port.write`."""
        if self._writer.is_closing():
            raise LinkLostError(f"tcp {self._name}: the connection is closed")
        self._written += len(data)
        self._marks.append((self._written, asyncio.get_running_loop().time()))
        self._writer.write(data)

    def discard(self) -> None:
        """End the connection with a reset, so that the kernel delivers nothing of what waits; see `Port.discard`."""
        connection: socket.socket | None = self._writer.get_extra_info("socket")
        if connection is not None:
            with suppress(OSError):
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._writer.transport.abort()
        raise LinkLostError(f"tcp {self._name}: the connection stalled with a stick frame in it, and was closed")

    async def drain(self) -> None:
        """Wait until everything written has left; see `Port.drain`."""
        while self.backlog:  # noqa: ASYNC110 - the transport does not tell when its queue has become empty
            await asyncio.sleep(0.002)
        if self._writer.is_closing():
            raise LinkLostError(f"tcp {self._name}: the connection is closed")

    async def close(self) -> None:
        """End the connection at once; unsent bytes are thrown away."""
        self._writer.transport.abort()
        with suppress(OSError):
            await self._writer.wait_closed()


def _keep_short(connection: socket.socket) -> None:
    """Let nothing old wait in the kernel: little of it, not for company, and not for long."""
    # A setpoint must not wait for Nagle's algorithm to collect more bytes.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    for option, value in (("TCP_NOTSENT_LOWAT", SEND_BUFFER), ("TCP_USER_TIMEOUT", int(DEAD * 1000))):
        number = getattr(socket, option, None)  # Linux has them
        if number is not None:
            connection.setsockopt(socket.IPPROTO_TCP, number, value)


async def open_tcp(target: str) -> TcpPort:
    """Connect.

    Args:
        target: `host:port`.

    Raises:
        LinkLostError: no program listens there now.
        LinkError: there is no such host.
    """
    host, _, number = target.rpartition(":")
    try:
        async with asyncio.timeout(_CONNECT):
            reader, writer = await asyncio.open_connection(host.strip("[]"), int(number))
    except socket.gaierror as error:
        raise LinkError(f"tcp {target}: no host {host} known: check link.port") from error
    except TimeoutError as error:
        raise LinkLostError(f"tcp {target}: no answer within {_CONNECT:.0f} s: check address and network") from error
    except OSError as error:
        raise LinkLostError(f"tcp {target}: {error.strerror or error}: is the serial server running?") from error
    connection: socket.socket | None = writer.get_extra_info("socket")
    if connection is not None:
        _keep_short(connection)
    return TcpPort(target, reader, writer)
