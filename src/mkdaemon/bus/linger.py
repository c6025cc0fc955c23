"""Connections that close at once, even if the peer does not answer.

Zenoh closes a TCP connection with SO_LINGER of 10 s, on one of the two threads that receive for every session of the
process. While bytes wait for a client that is stopped, or whose cable is pulled, `close(2)` holds that thread: two such
clients held up every setpoint for 10 s. Zenoh 1.10 has no setting for it (`TCP_LINGER_TIMEOUT` of zenoh-link-tcp; issue
2718 of eclipse-zenoh/zenoh), and a second session shares the two threads. So the option is taken off from outside; the
kernel then ends the connection by itself.
"""

from __future__ import annotations

import asyncio
import os
import socket
import stat
import struct
from contextlib import suppress
from pathlib import Path
from typing import Final

SWEEP_PERIOD: Final = 0.25
"""Time between two looks for new connections [s]; none is closed sooner than `bus.session.STALL` after it is full."""
DESCRIPTORS: Final = Path("/proc/self/fd")
_LINGER: Final = struct.Struct("ii")
"""`struct linger`: on or off, and for how long [s] (socket(7))."""


class LingerSweep:
    """Takes SO_LINGER off the connections of this process, each once."""

    def __init__(self) -> None:
        self._known: dict[int, int] = {}

    def sweep(self) -> int:
        """Look at every descriptor that is new; from any thread.

        Returns:
            How many connections lingered. A system without `/proc` has none.
        """
        try:
            descriptors = [int(entry.name) for entry in DESCRIPTORS.iterdir()]
        except OSError:
            return 0
        known, self._known, changed = self._known, {}, 0
        for descriptor in descriptors:
            with suppress(OSError):  # closed by now
                status = os.fstat(descriptor)
                if known.get(descriptor) != status.st_ino and stat.S_ISSOCK(status.st_mode):
                    changed += _stop_lingering(descriptor)
                self._known[descriptor] = status.st_ino
        return changed


async def keep_closing_at_once() -> None:
    """Take SO_LINGER off every connection that comes, for ever."""
    sweep = LingerSweep()
    while True:
        sweep.sweep()
        await asyncio.sleep(SWEEP_PERIOD)


def _stop_lingering(descriptor: int) -> bool:
    """Take SO_LINGER off a socket; one that resets its connection when it is closed (a time of 0) keeps it."""
    connection = socket.socket(fileno=descriptor)
    try:
        is_on, seconds = _LINGER.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER.size))
        lingers = bool(is_on and seconds)
        if lingers:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER.pack(0, 0))
        return lingers
    finally:
        connection.detach()
