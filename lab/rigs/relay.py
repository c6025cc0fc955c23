"""A machine between a client and its daemon that stops: a notebook that sleeps, a switch without power."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

CHUNK: Final = 65536
"""Bytes passed on at a time."""


class Relay:
    """Passes bytes between one client and a server until it is stopped.

    Attributes:
        endpoint: where the client connects to.
    """

    def __init__(self, server: str) -> None:
        """Listen.

        Args:
            server: its endpoint, `tcp/HOST:PORT`.
        """
        host, _, port = server.removeprefix("tcp/").rpartition(":")
        self._server = (host, int(port))
        self._is_stopped = False
        listener = socket.create_server(("127.0.0.1", 0))
        self._sockets = [listener]
        self.endpoint = f"tcp/127.0.0.1:{listener.getsockname()[1]}"
        threading.Thread(target=self._serve, args=(listener,), name="relay", daemon=True).start()

    def stop(self) -> None:
        """Pass nothing on from now on and read nothing; the connections stay."""
        self._is_stopped = True

    def close(self) -> None:
        """Close both connections."""
        self.stop()
        for one in self._sockets:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _serve(self, listener: socket.socket) -> None:
        with suppress(OSError):
            inside, _ = listener.accept()
            outside = socket.create_connection(self._server)
            self._sockets += [inside, outside]
            for source, sink in ((inside, outside), (outside, inside)):
                threading.Thread(target=self._pass_on, args=(source, sink), name="relay", daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(CHUNK):
                if self._is_stopped:
                    return
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)


@contextmanager
def relay(server: str) -> Iterator[Relay]:
    """A relay for as long as the context lasts."""
    opened = Relay(server)
    try:
        yield opened
    finally:
        opened.close()
