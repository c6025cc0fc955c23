"""The WebSocket server: who is there on the bus, who looks, and what time it is."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

import foxglove
import structlog
from foxglove.websocket import Capability, ChannelView, Client, ServerListener, WebSocketServer

from mkdaemon.client import Vehicle
from mkdaemon.client.fleet import Fleet, FleetSighting
from mkdaemon.errors import ConfigError
from mkdaemon.gateways.foxglove.exhibit import Exhibit
from mkdaemon.gateways.foxglove.names import Names

HOST: Final = "127.0.0.1"
PORT: Final = 8765
"""Where Foxglove and Lichtblick look first."""
BACKLOG: Final = 256
"""Messages that wait for a viewer; the oldest is dropped when one more comes."""
TICK_NS: Final = 50_000_000
"""Interval between two times sent to viewers [ns]."""
BACK_NS: Final = 5_000_000_000
"""A time that goes back by less is a value that came late; by more, a recording goes on at another place [ns]."""
OLD_VIEWER: Final = (
    "it does not offer the WebSocket subprotocol foxglove.sdk.v1, the only one spoken here. Viewers that offer "
    "foxglove.websocket.v1 alone are too old (Lichtblick up to 1.21): update it, or open a recording that "
    "`mkctl log export --format foxglove` wrote."
)
_log = structlog.get_logger("gateway.foxglove")


class _Refusals(logging.Filter):
    """Puts the reason and the remedy in place of what the SDK logs about a connection that it answers with 400."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the SDK's own record is logged."""
        words = record.getMessage()
        if "handshake failed" not in words:
            return True
        viewer = words.removeprefix("Dropping client ").removesuffix(": handshake failed")
        _log.warning("viewer_refused", viewer=viewer, words=OLD_VIEWER)
        return False


_REFUSALS: Final = _Refusals()


class FoxgloveGateway:
    """Vehicles of one endpoint before the viewers of one server."""

    def __init__(self, through: Vehicle, vehicles: Sequence[str]) -> None:
        """Advertise the vehicles, whether they are there or not.

        Args:
            through: any client at the endpoint.
            vehicles: names; the time of the first one is the viewers' time.
        """
        self.context = foxglove.Context()
        self._fleet = Fleet(through)
        self._server: WebSocketServer | None = None
        self._now = 0
        self._shown: dict[str, FleetSighting | None] = {}
        is_one = len(vehicles) == 1
        self._exhibits = {
            name: Exhibit(self.context, Names(name, "" if is_one else f"{name}/"), self._clock_of(name, vehicles[0]))
            for name in vehicles
        }

    @asynccontextmanager
    async def following(self) -> AsyncIterator[None]:
        """Follow vehicles that appear on the bus or leave it while the context lasts."""
        try:
            async with self._fleet.watch(self._changed, lambda *_: None):
                yield
        finally:
            exhibits, self._exhibits = self._exhibits, {}  # what is said of viewers and vehicles from now on is late
            for exhibit in exhibits.values():
                await exhibit.close()

    def serve(self, host: str, port: int) -> WebSocketServer:
        """Begin to serve viewers.

        Raises:
            ConfigError: the address is in use, or not of this machine.
        """
        logging.getLogger("foxglove.websocket.server").addFilter(_REFUSALS)
        try:
            self._server = foxglove.start_server(
                name="mkdaemon",
                host=host,
                port=port,
                capabilities=[Capability.Time],
                server_listener=_Listener(self._looks),
                context=self.context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:  # the SDK's own error is one
            why = str(error).rpartition(": ")[2].partition(" (")[0]
            msg = f"--host {host} --port {port}: {why}; end what uses it, or give another one (--port 0: any)"
            raise ConfigError(msg) from error
        _send_at_once(self._server.port)
        return self._server

    def _looks(self, channel: int, client: int, is_there: bool) -> None:
        """A viewer subscribes to a channel, or ends it."""
        for exhibit in self._exhibits.values():
            if channel in exhibit.lines:
                (exhibit.subscribed if is_there else exhibit.unsubscribed)(channel, client)

    def _changed(self) -> None:
        """Update the vehicles shown; a live vehicle takes precedence over a played one.

        One that goes is followed on: its last values may come later than the word that it is gone.
        """
        for name, exhibit in self._exhibits.items():
            found = [sighting for sighting in self._fleet.here if sighting.name == name]
            best = min(found, key=lambda one: (one.is_played, one.root), default=None)
            if best is not None and best != self._shown.get(name):
                exhibit.follow(self._fleet.client(best), is_played=best.is_played)
            self._shown[name] = best

    def _clock_of(self, name: str, first: str) -> Callable[[int], None]:
        """Tells the viewers the time: that of the first vehicle, as two machines or a recording have two times."""
        return self._broadcast if name == first else lambda now: None

    def _broadcast(self, now: int) -> None:
        if self._server is not None and (now >= self._now + TICK_NS or now < self._now - BACK_NS):
            self._now = now
            self._server.broadcast_time(now)


def _send_at_once(port: int) -> None:
    """Let connections to a port of this process send small messages at once, where the system is Linux.

    The SDK leaves Nagle's algorithm on and has no option for it: a message waited up to 40 ms for the viewer's word
    that it had the one before. A connection inherits the option of the socket that listens.
    """
    with suppress(FileNotFoundError):
        for file in Path("/proc/self/fd").iterdir():
            if not file.is_socket():
                continue
            with suppress(OSError), socket.socket(fileno=os.dup(int(file.name))) as one:
                listens = one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
                if listens and one.family in (socket.AF_INET, socket.AF_INET6) and one.getsockname()[1] == port:
                    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class _Listener(ServerListener):
    """Hears of viewers on threads of the server, and tells the loop."""

    def __init__(self, looks: Callable[[int, int, bool], None]) -> None:
        self._looks = looks
        self._loop = asyncio.get_running_loop()

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """See `ServerListener`."""
        self._pass_on(channel.id, client.id, is_there=True)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """See `ServerListener`."""
        self._pass_on(channel.id, client.id, is_there=False)

    def _pass_on(self, channel: int, client: int, *, is_there: bool) -> None:
        with suppress(RuntimeError):  # the loop may be closing
            self._loop.call_soon_threadsafe(self._looks, channel, client, is_there)


@asynccontextmanager
async def serving(through: Vehicle, vehicles: Sequence[str], host: str = HOST, port: int = PORT) -> AsyncIterator[str]:
    """Serve viewers while the context lasts; the address to give them.

    Args:
        through: a client at the endpoint.
        vehicles: names of the vehicles to show, live or played.
        host: address to listen at.
        port: 0 for one that is free.

    Raises:
        ConfigError: the address is in use, or not of this machine.
    """
    gateway = FoxgloveGateway(through, vehicles)
    server = gateway.serve(host, port)
    try:
        async with gateway.following():
            yield f"ws://{host}:{server.port}"
    finally:
        await asyncio.to_thread(server.stop)
