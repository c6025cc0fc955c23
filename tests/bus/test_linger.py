"""Which sockets no longer wait for clients that vanished; that they hold up nobody is asked by `lab attack`."""

from __future__ import annotations

import socket
import struct
from contextlib import closing

from mkdaemon.bus.linger import LingerSweep

LINGER = struct.Struct("ii")


def lingering(one):
    return LINGER.unpack(one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.size))


def test_only_sockets_that_would_wait_are_changed():
    with closing(socket.socket()) as waits, closing(socket.socket()) as resets, closing(socket.socket()) as plain:
        waits.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 10))
        resets.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 0))
        sweep = LingerSweep()
        assert sweep.sweep() >= 1
        assert [lingering(one)[0] for one in (waits, resets, plain)] == [0, 1, 0]
        waits.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.pack(1, 10))
        assert sweep.sweep() == 0, "each is looked at once"
        assert waits.fileno() >= 0, "it is still open"
